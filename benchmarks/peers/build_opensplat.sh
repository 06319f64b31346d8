#!/usr/bin/env bash
# Build OpenSplat for the CPU from its source, against Debian's libraries and pip's torch.
#   benchmarks/peers/build_opensplat.sh SOURCE TARGET [PYTHON]
# SOURCE is a clone of github.com/pierotofy/OpenSplat, TARGET a new folder, PYTHON one with torch.
# Needs: build-essential cmake git nlohmann-json3-dev libcxxopts-dev libnanoflann-dev libopencv-dev
# libglm-dev. Its own description of the build downloads three header libraries; here Debian's are
# found instead. Its CPU rasteriser reads depths by a data pointer as if they lay side by side, though
# they are a column of a larger tensor, and so draws splats in a wrong order; here they are copied
# first. Takes about 20 minutes on one core; JOBS=2 builds with two.
set -euo pipefail
source=$1 target=$2 python=${3:-.venv/bin/python}
mkdir -p "$target"
cp -r "$source/." "$target/source"
cd "$target/source"
# every FetchContent call, to its closing bracket, gives way to three packages
"$(command -v python3)" - <<'PY'
import re
from pathlib import Path

path = Path("CMakeLists.txt")
text = re.sub(r"^[ \t]*FetchContent_\w+\([^)]*\)", "", path.read_text(), flags=re.MULTILINE)
found = "find_package(nlohmann_json REQUIRED)\nfind_package(nanoflann REQUIRED)\nfind_package(cxxopts REQUIRED)"
path.write_text(text.replace("include(FetchContent)", found))

path = Path("rasterizer/gsplat-cpu/gsplat_cpu.cpp")
column = 'torch::Tensor camDepths = pProj.index({"...", 2})'
if f"{column};" not in (text := path.read_text()):
    raise SystemExit(f"{path}: expected the line `{column};`, found none: see whether it is mended")
path.write_text(text.replace(f"{column};", f"{column}.contiguous();"))
PY
cd - > /dev/null
torch=$("$python" -c "import torch; print(torch.utils.cmake_prefix_path)")
cmake -S "$target/source" -B "$target/build" -DCMAKE_BUILD_TYPE=Release -DGPU_RUNTIME=CPU -DCMAKE_PREFIX_PATH="$torch"
cmake --build "$target/build" --target opensplat --parallel "${JOBS:-1}"
"$target/build/opensplat" --version

"""ONNX files: opened for one thread that sleeps when it has nothing to do, written and compared."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.segment.onnx_files.optimized_model import (
    CPU_FILE,
    cpu_flags,
    open_optimized,
    open_session,
)

TOLERANCE = 1e-3  # on probabilities: float32 sums in another order, through a hundred layers
OPSET = 17  # understood by every ONNX Runtime since 1.12

# Without it x86 CPUs that lack VNNI add products of eight bits in sixteen, which overflow. It costs
# most of the gain in speed, on CPUs with VNNI too, where nothing overflows.
EXACT_PRODUCTS = "session.x64quantprecision"
BUNDLED = Path(__file__).resolve().parents[2] / "bundled" / "segmenter"


def open_model(path: Path, threads: int, what: str) -> Any:
    """Open ``path`` in ONNX Runtime; ``what`` names the kind of model in errors.

    What ONNX Runtime makes of a bundled file is kept (``optimized_model.py``). Raises
    :class:`InputError` where there is no file, or none that ONNX Runtime can read.
    """
    import onnxruntime

    if not path.is_file():
        raise InputError(f"{path}: expected {what} (ONNX), found no such file")
    exact = not has_vnni()

    def options() -> Any:
        chosen = onnxruntime.SessionOptions()
        chosen.intra_op_num_threads = threads
        chosen.inter_op_num_threads = 1
        chosen.log_severity_level = 3  # errors only
        # idle threads must sleep: spinning starves everything else on a shared machine
        chosen.add_session_config_entry("session.intra_op.allow_spinning", "0")
        if exact:
            chosen.add_session_config_entry(EXACT_PRODUCTS, "1")
        return chosen

    try:
        if path.parent == BUNDLED:
            return open_optimized(path, options, like={"exact": exact})
        return open_session(path, options())
    except Exception as error:  # ONNX Runtime's own types are not public
        raise InputError(f"{path}: expected {what} (ONNX): {error}") from error


def has_vnni(cpu_file: Path = CPU_FILE) -> bool:
    """Whether the CPU adds products of eight bits in 32 (AVX-512 VNNI or AVX-VNNI); Linux only."""
    return not {"avx512_vnni", "avx_vnni"}.isdisjoint(cpu_flags(cpu_file).split())


def write_model(
    module: Any,
    path: Path,
    names: tuple[str, str],
    example: NDArray[np.float32],
    free: Mapping[int, str],
) -> float:
    """Write a torch module of one input and one output; return how far ONNX Runtime is from torch.

    ``names`` are the input's and the output's, ``free`` the axes whose size stays open. Both are
    compared on ``example``. Raises :class:`StageError` for more than ``TOLERANCE``.
    """
    import torch

    module = module.eval().cpu()
    asked = torch.from_numpy(example)
    with warnings.catch_warnings():
        # the TorchScript exporter is deprecated; its successor needs one more package
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        warnings.filterwarnings("ignore", category=torch.jit._trace.TracerWarning)
        torch.onnx.export(
            module,
            (asked,),
            str(path),
            dynamo=False,
            opset_version=OPSET,
            input_names=[names[0]],
            output_names=[names[1]],
            dynamic_axes={name: dict(free) for name in names},
        )
    (found,) = open_model(path, 1, "a model").run(None, {names[0]: example})
    with torch.no_grad():
        difference = float(np.abs(found - module(asked).numpy()).max())
    if difference > TOLERANCE:
        raise StageError(
            f"{path}: expected ONNX Runtime to agree with torch within {TOLERANCE}, "
            f"found a difference of {difference:.2g}"
        )
    return difference

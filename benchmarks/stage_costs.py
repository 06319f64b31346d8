"""What finished stages cost: seconds, bytes and files per stage, read from a store's manifests.

    python benchmarks/stage_costs.py OUT…

``OUT`` are output folders of ``mattgs run``. Seconds are those of the stage's process, start and
imports included, on whatever machine did it, beside whatever else ran there.
"""

import argparse
import json
from collections import defaultdict
from pathlib import Path
from statistics import median

STAGES = ("prepare", "segment", "sfm", "agree", "train", "truth", "evaluate", "measure")


def main() -> None:
    """Print one line per stage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="+")
    found: dict[str, list[tuple[float, float, int]]] = defaultdict(list)
    for out in parser.parse_args().out:
        for path in sorted((out / "store").glob("*/*/manifest.json")):
            manifest = json.loads(path.read_text(encoding="utf-8"))
            sizes = [row["bytes"] for row in manifest["files"].values()]
            cost = (float(manifest["extra"]["seconds"]), sum(sizes) / 1e6, len(sizes))
            found[manifest["stage"]].append(cost)
    print("| stage | artifacts | median s | most s | median MB | most MB | median files |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for stage in STAGES:
        if stage not in found:
            continue
        seconds, sizes, files = (list(column) for column in zip(*found[stage], strict=True))
        cells = [f"{median(seconds):.1f}", f"{max(seconds):.1f}"]
        cells += [f"{median(sizes):.1f}", f"{max(sizes):.1f}", f"{median(files):.0f}"]
        print(f"| {stage} | {len(seconds)} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()

"""Segmentation: photos per second, and agreement with the bundled captures' true masks.

    python benchmarks/segment.py [--threads 2] [--captures rover,hexapod,lattepanda]
        [--masks alone,grabcut,no-network,votes]

Prints two Markdown tables. The first times U²-NetP at 320 × 320, reading and resizing included,
writing not; the second scores the bundled model alone, refined by GrabCut, GrabCut without a
network, and the votes of all views, cameras estimated as in a benchmark (a few minutes a capture).
"""

import argparse
import shutil
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.config import BUNDLED, CaptureConfig, SegmentConfig, SfmConfig
from mattgs_ops.segment.infer import segment
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.segment.network.export import export
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork
from mattgs_ops.segment.network.u2net import U2Net

PHOTOS, REPEATS = 8, 3
GAIN = 100  # of the timed network's last layer: untrained maps are flat, and refused as empty
MASKS = {
    "alone": SegmentConfig(source="u2net", refine="none"),
    "grabcut": SegmentConfig(source="u2net", refine="grabcut"),
    "no-network": SegmentConfig(source="grabcut"),
}
VOTES = "votes"


def speed(path: Path, threads: int) -> tuple[int, float]:
    """Return the network's side and the fastest photos per second over ``REPEATS``."""
    network = SaliencyNetwork(path, threads=threads)
    rng = np.random.default_rng(0)
    photos = [rng.integers(0, 256, (480, 640, 3)).astype(np.uint8) for _ in range(PHOTOS)]
    names = [str(i) for i in range(PHOTOS)]
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        network.soft_maps(photos, names)
        seconds.append(time.perf_counter() - start)
    return network.width, PHOTOS / min(seconds)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--captures", default=",".join(BUNDLED))
    parser.add_argument("--masks", default=",".join([*MASKS, VOTES]))
    options = parser.parse_args()
    masks = options.masks.split(",")
    unknown = set(masks) - {*MASKS, VOTES}
    if unknown:
        parser.error(f"--masks: expected some of {', '.join([*MASKS, VOTES])}, found {unknown}")
    with tempfile.TemporaryDirectory() as folder:
        torch.manual_seed(0)
        at_320 = Path(folder) / "u2netp-320.onnx"
        timed = U2Net("u2netp").eval()
        with torch.no_grad():
            timed.outconv.weight.mul_(GAIN)
        export(timed, at_320, size=320)
        print("| model | side | threads | photos/s |\n|---|---|---|---|")
        for name, path in (("U²-NetP", at_320), ("bundled", BUNDLED_MODEL)):
            for threads in dict.fromkeys((1, options.threads)):
                side, rate = speed(path, threads)
                print(f"| {name} | {side} | {threads} | {rate:.1f} |")
        print("\n| capture | masks | IoU | worst | F | MAE | boundary F | flagged |")
        print("|---|---|---|---|---|---|---|---|")
        for capture in filter(None, options.captures.split(",")):
            quality_rows(capture, Path(folder), options.threads, masks)


def quality_rows(name: str, folder: Path, threads: int, masks: Sequence[str]) -> None:
    """Print a capture's rows."""
    from mattgs_ops.capture import prepare

    prepared = prepare.prepare(CaptureConfig(name=name), folder / name, test_every=8)
    for label, config in MASKS.items():
        if label in masks:
            print_row(name, label, segment(prepared, config, folder / f"{name}-{label}"))
    if VOTES in masks:
        alone = folder / f"{name}-alone"
        if "alone" not in masks:
            segment(prepared, MASKS["alone"], alone)
        print_row(name, VOTES, voted(prepared, alone, folder, threads))


def voted(capture: PreparedCapture, alone: Path, folder: Path, threads: int) -> MaskReport:
    """Return the masks' report after structure-from-motion and the views' agreement."""
    from mattgs_ops import sfm
    from mattgs_ops.object_masks.cross_view import agree

    solved, out = folder / f"{capture.name}-solved", folder / f"{capture.name}-agreed"
    scene = sfm.reconstruct(
        capture, alone / "masks", SfmConfig(), solved, soft=alone / "soft", threads=threads
    )
    shutil.copyfile(alone / "masks.json", solved / "masks.json")
    agree(scene, capture, out, threads=threads)
    return MaskReport.load(out / "masks.json")


def print_row(name: str, label: str, report: MaskReport) -> None:
    """Print one row of the second table."""
    m = report.means()
    print(
        f"| {name} | {label} | {m['iou']:.3f} | {m['worst_iou']:.3f} | {m['f_measure']:.3f} "
        f"| {m['mae']:.4f} | {m['boundary_f']:.3f} | {len(report.flagged)} |",
        flush=True,
    )


if __name__ == "__main__":
    main()

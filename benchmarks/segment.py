"""Segmentation: how well masks agree with the truth, and photos per second.

    python benchmarks/segment.py [--captures rover,hexapod,lattepanda] [--sets FOLDER] [--views 24]
        [--also dino=PATH:MASKS …] [--masks alone,delivered] [--model FILE] [--threads 2] [--speed]

Prints a Markdown table, a line for each capture: the network's own masks (``alone``) and those that
the pipeline delivers (``delivered``: cameras, then the agreement of all views). Each has mean IoU
and the worst view's, F-measure, MAE of the map, F1 of the outlines within 0.75 % of the diagonal
and within two pixels, how many views carry a flag, and what made the masks: votes or maps.

``--sets`` is a folder of captures, as `mattgs captures evaluation` renders it; ``--views`` takes
that many of each walk, evenly. ``--also NAME=PATH[:MASKS]`` adds a capture whose true masks lie
beside it, are its alpha, or are in ``MASKS``; without any it has no scores. True masks only score.
Cameras that come with a capture are kept, bundled ones are estimated.

``--model`` names an ONNX file instead of the bundled network. ``--masks`` also takes ``grabcut``
(the network's masks refined by colour) and ``no-network``. ``--speed`` times U²-NetP at 320 × 320,
one of the bundled networks in single precision and the bundled file, reading and resizing included.
"""

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch

from mattgs_ops.capture.masks import boundary_f, mask_name
from mattgs_ops.capture.scene import PreparedCapture
from mattgs_ops.config import BUNDLED, CaptureConfig, SegmentConfig, SfmConfig
from mattgs_ops.segment.infer import segment
from mattgs_ops.segment.mask_report import MaskReport
from mattgs_ops.segment.network.export import export
from mattgs_ops.segment.network.saliency import BUNDLED_MODEL, SaliencyNetwork
from mattgs_ops.segment.network.u2net import U2Net

PHOTOS, REPEATS = 8, 3
GAIN = 100  # of the timed network's last layer: untrained maps are flat, and refused as empty
DELIVERED = "delivered"
MASKS = {
    "alone": SegmentConfig(source="u2net", refine="none"),
    "grabcut": SegmentConfig(source="u2net", refine="grabcut"),
    "no-network": SegmentConfig(source="grabcut"),
}
MEASURES = ("iou", "worst_iou", "f_measure", "mae", "boundary_f")
OUTLINE = 2  # pixels that an outline may be off


@dataclass(frozen=True)
class Masks:
    """Masks of a capture on disk, the report on them, and by view's name the true ones."""

    folder: Path
    report: MaskReport
    true: dict[str, Path | None]
    made_by: str = ""


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


def print_speed(threads: int, folder: Path) -> None:
    """Print the table of photos per second."""
    torch.manual_seed(0)
    at_320 = folder / "u2netp-320.onnx"
    timed = U2Net("u2netp").eval()
    with torch.no_grad():
        timed.outconv.weight.mul_(GAIN)
    export(timed, at_320, size=320)
    print("| model | side | threads | photos/s |\n|---|---|---|---|")
    one = BUNDLED_MODEL.with_name("u2netp-rooms.onnx")
    timed_files = (
        ("U²-NetP", at_320),
        ("one of the bundled, float32", one),
        ("bundled", BUNDLED_MODEL),
    )
    for name, path in timed_files:
        for count in dict.fromkeys((1, threads)):
            side, rate = speed(path, count)
            print(f"| {name} | {side} | {count} | {rate:.1f} |")


def chosen(options: argparse.Namespace, folder: Path) -> Iterator[CaptureConfig]:
    """Yield the captures that the command line names."""
    for name in filter(None, options.captures.split(",")):
        yield CaptureConfig(name=name)
    sets = sorted(options.sets.iterdir()) if options.sets else []
    for path in sets:
        if (path / "transforms.json").is_file():
            source = fewer(path, options.views, folder / "fewer" / path.name)
            yield CaptureConfig(name=path.name.replace("_", "-"), path=source)
    for text in options.also:
        name, _, place = text.partition("=")
        path, _, masks = place.partition(":")
        yield CaptureConfig(name=name, path=Path(path), masks=Path(masks) if masks else None)


def fewer(path: Path, views: int | None, out: Path) -> Path:
    """Copy a capture with ``views`` of its frames, evenly by their order; all without a number."""
    listing = json.loads((path / "transforms.json").read_text(encoding="utf-8"))
    frames = listing["frames"]
    if views is None or views >= len(frames):
        return path
    listing["frames"] = [frames[k * len(frames) // views] for k in range(views)]
    for frame in listing["frames"]:
        for key in ("file_path", "mask_path"):
            (out / frame[key]).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path / frame[key], out / frame[key])
    (out / "transforms.json").write_text(json.dumps(listing), encoding="utf-8")
    return out


def masks_of(
    capture: PreparedCapture, kinds: list[str], folder: Path, threads: int, model: Path | None
) -> dict[str, Masks]:
    """Make the asked-for kinds of masks; ``delivered`` needs the network's own."""
    made: dict[str, Masks] = {}
    for kind in dict.fromkeys(["alone", *kinds] if DELIVERED in kinds else kinds):
        out = folder / f"{capture.name}-{kind}"
        if kind == DELIVERED:
            made[kind] = delivered(capture, made["alone"], out, threads)
        else:
            config = MASKS[kind].model_copy(update={"model": model})
            report = segment(capture, config, out, threads=threads)
            made[kind] = Masks(out, report, {view.name: view.mask for view in capture.views})
    return made


def delivered(capture: PreparedCapture, alone: Masks, out: Path, threads: int) -> Masks:
    """Find cameras and let the views agree, as a benchmark does."""
    from mattgs_ops import sfm
    from mattgs_ops.object_masks.cross_view import agree

    solved = out.with_name(f"{capture.name}-solved")
    scene = sfm.reconstruct(
        capture,
        alone.folder / "masks",
        SfmConfig(),
        solved,
        soft=alone.folder / "soft",
        threads=threads,
    )
    shutil.copyfile(alone.folder / "masks.json", solved / "masks.json")
    agreed = agree(scene, capture, out, threads=threads)
    agreement = agreed.extra.get("agreement", {})
    made_by = str(agreement.get("none") or agreement.get("masks", "votes"))
    # without the lens's distortion, as the scene's photos are
    true = {view.name: view.coverage for view in agreed.views}
    return Masks(out, MaskReport.load(out / "masks.json"), true, made_by)


def scores(capture: PreparedCapture, masks: Masks) -> str:
    """Return the cells of one kind of masks, from the mean IoU to the number of flagged views."""
    flagged = f"{len(masks.report.flagged)} of {len(masks.report.views)}"
    means = masks.report.means()
    if not means:
        return "- | " * (len(MEASURES) + 1) + flagged
    outlines = []
    for view in capture.views:
        found, true = (
            cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            for path in (masks.folder / "masks" / mask_name(view.name), masks.true[view.name])
        )
        if found is not None and true is not None:
            outlines.append(
                boundary_f(np.asarray(found, np.uint8), np.asarray(true, np.uint8), OUTLINE)
            )
    values = [*(means[key] for key in MEASURES), float(np.mean(outlines))]
    return " | ".join(f"{value:.3f}" for value in values) + f" | {flagged}"


def print_masks(options: argparse.Namespace, kinds: list[str], folder: Path) -> None:
    """Print the table of masks, a line as soon as a capture is done."""
    from mattgs_ops.capture import prepare

    columns = ["capture", "views", "masks", "mean IoU", "worst", "F-measure", "MAE", "boundary F"]
    columns += [f"outlines, {OUTLINE} px", "flagged", "by"]
    print("| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|", flush=True)
    for config in chosen(options, folder):
        capture = prepare.prepare(config, folder / config.name, test_every=8)
        if capture.masks_are != "none":  # whatever came along is the truth here
            capture = replace(capture, masks_are="truth")
        made = masks_of(capture, kinds, folder, options.threads, options.model)
        for kind, masks in made.items():
            cells = scores(capture, masks)
            head = f"| {capture.name} | {len(capture.views)} | {kind}"
            print(f"{head} | {cells} | {masks.made_by} |", flush=True)


def main() -> None:
    """Print the tables that the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--captures", default=",".join(BUNDLED))
    parser.add_argument("--sets", type=Path)
    parser.add_argument("--views", type=int)
    parser.add_argument("--also", action="append", default=[], metavar="NAME=PATH[:MASKS]")
    parser.add_argument("--masks", default=f"alone,{DELIVERED}")
    parser.add_argument("--model", type=Path)
    parser.add_argument("--speed", action="store_true")
    options = parser.parse_args()
    kinds, known = options.masks.split(","), [*MASKS, DELIVERED]
    if set(kinds) - set(known):
        parser.error(f"--masks: expected some of {', '.join(known)}, found {options.masks}")
    with tempfile.TemporaryDirectory() as folder:
        if options.speed:
            print_speed(options.threads, Path(folder))
        print_masks(options, kinds, Path(folder))


if __name__ == "__main__":
    main()

"""Measure structure-from-motion: modes, mappers and settings, on bundled and other captures.

    python benchmarks/sfm/modes.py rover hexapod lattepanda
    python benchmarks/sfm/modes.py fox=../photos/fox --modes shared masked --set max_features=2048

Masks are the capture's own where it has any, otherwise those of the segmentation stage. Prints one
Markdown row per capture and setting. Seconds are wall-clock seconds of one thread.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mattgs_ops import sfm
from mattgs_ops.capture import prepare, sparse
from mattgs_ops.capture.scene import PreparedCapture, Scene
from mattgs_ops.config import CaptureConfig, SegmentConfig, SfmConfig
from mattgs_ops.errors import MattgsError

HEADER = (
    "capture", "setting", "registered", "key points (in masks)", "matches", "points",
    "on object", "of those in ≥ 80 % of true masks", "error px", "rotation ° mean / max",
    "position % mean / max", "focal %", "seconds: extract + match + map + triangulate", "total s",
)  # fmt: skip


def main() -> None:
    """Parse arguments, run the grid, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("captures", nargs="+", help="bundled names, or NAME=FOLDER")
    parser.add_argument("--modes", nargs="+", default=["shared", "masked", "original"])
    parser.add_argument("--mappers", nargs="+", default=["incremental"])
    parser.add_argument("--set", nargs="*", default=[], help="KEY=VALUE of SfmConfig")
    parser.add_argument("--keep", type=Path, help="folder for the scenes; none: thrown away")
    arguments = parser.parse_args()
    settings = dict(item.split("=", 1) for item in arguments.set)
    print("| " + " | ".join(HEADER) + " |")
    print("|" + "---|" * len(HEADER))
    with tempfile.TemporaryDirectory() as scratch:
        for text in arguments.captures:
            capture, masks = prepared(text, Path(scratch))
            for mode in arguments.modes:
                for mapper in arguments.mappers:
                    config = SfmConfig.model_validate({"mode": mode, "mapper": mapper, **settings})
                    out = (arguments.keep or Path(scratch)) / f"{capture.name}-{mode}-{mapper}"
                    print(row(capture, masks, config, out), flush=True)


def prepared(text: str, scratch: Path) -> tuple[PreparedCapture, Path]:
    """Prepare a capture and find or make its masks."""
    name, _, path = text.partition("=")
    config = CaptureConfig(name=name, path=Path(path) if path else None)
    capture = prepare.prepare(config, scratch / name, test_every=8)
    masks = capture.folder / "masks"
    if capture.masks_are == "none":
        from mattgs_ops.segment.infer import segment

        segment(capture, SegmentConfig(), scratch / f"{name}-masks")
        masks = scratch / f"{name}-masks" / "masks"
    return capture, masks


def row(capture: PreparedCapture, masks: Path, config: SfmConfig, out: Path) -> str:
    """Run one setting and describe it as a row of the table."""
    began = time.perf_counter()
    setting = f"{config.mode}, {config.mapper}"
    try:
        scene = sfm.reconstruct(capture, masks, config, out)
    except MattgsError as error:
        reason = str(error).splitlines()[0]
        return f"| {capture.name} | {setting} | failed: {reason} |" + " |" * (len(HEADER) - 3)
    total = time.perf_counter() - began
    e = scene.extra
    print(json.dumps(dict(e)), file=sys.stderr)
    pose = e["pose_error"]
    cells = [
        capture.name,
        setting,
        f"{e['registered']} / {e['views']}",
        f"{e['keypoints']['original']} ({e['keypoints']['masked']})",
        " + ".join(f"{n} {count}" for n, count in e["matches"].items()),
        str(e["points"]),
        str(e["object_points"]),
        f"{true_share(scene):.1%}",
        "-" if e["reprojection_error"] is None else f"{e['reprojection_error']:.2f}",
        *pose_cells(pose),
        "-" if pose is None else f"{pose['focal']:+.2%}",
        " + ".join(
            f"{e['seconds'].get(step, 0):.0f}"
            for step in ("extract", "match", "map", "triangulate")
        ),
        f"{total:.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def pose_cells(pose: Mapping[str, float] | None) -> tuple[str, str]:
    """Return mean and largest errors of rotations and of positions in words."""
    if pose is None:
        return "-", "-"
    return (
        f"{pose['rotation_deg_mean']:.2f} / {pose['rotation_deg_max']:.2f}",
        f"{pose['position_mean']:.2%} / {pose['position_max']:.2%}",
    )


def true_share(scene: Scene) -> float:
    """Return the share of points kept for the object that project into ≥ 80 % of *all* masks.

    Harder than the vote that kept them, in which only the views that saw a point took part: here a
    point on a hidden side must still fall on the object's silhouette.
    """
    from mattgs_ops.sfm.checks import read_mask

    xyz = sparse.on_object(scene.points()).xyz
    hits: list[Any] = []
    for view in scene.views:
        if view.camera is not None and view.mask is not None:
            mask = read_mask(view.mask.parent, view)
            hits.append(sparse.inside(mask, *view.camera.project(xyz)))
    return float(np.mean(np.mean(hits, axis=0) >= sparse.OBJECT_SHARE)) if len(xyz) else 0.0


if __name__ == "__main__":
    main()

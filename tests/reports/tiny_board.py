"""A tiny benchmark that runs from photos to rows, with any part of it replaced."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import mattgs_ops
from benchmarks import gate_runs
from mattgs_ops.capture import visual_hull
from mattgs_ops.capture.prepare import prepare
from mattgs_ops.capture.scene import Scene, SparsePoints, View
from mattgs_ops.config import (
    BenchmarkConfig,
    CaptureConfig,
    SegmentConfig,
    TrainConfig,
)
from mattgs_ops.method import MethodConfig
from mattgs_ops.segment import infer
from mattgs_ops.segment.mask_report import MaskReport
from reports.rows.schema import Row
from tasks.stages.stage import Cell

BOARD = Path(mattgs_ops.__file__).parent / "bundled" / "lattepanda"


EVERY = 2  # of its photos one is taken


SIZE = (128, 96)  # to which photos are reduced, pixels


ITERATIONS, POINTS = 100, 2000


EXTRA = {"mode": "shared", "registered": 24, "views": 24}  # what structure-from-motion would say


CELLS = (
    Cell("board", "original-3dgs", 0),
    Cell("board", "original-ours", 0),
    Cell("board", "nobg-3dgs", 0),
)


AGAIN = Cell("again", "original-3dgs", 0)


OURS = MethodConfig(weighting="paper", prune="pixel", prune_initial=True, prune_attention=0.2)


SPEED = ("fps", "calibration", "fps_calibrated", "fps_noise")


# Of the time that a rendering takes, added to it: four times as slow is named beside any neighbour.
SLEEP = 3.0


def part_of_the_board(folder: Path) -> Path:
    """Write a capture of every other training photo: small, with masks and poses, no split."""
    document = json.loads((BOARD / "transforms.json").read_text())
    training = document.pop("train_filenames")[::EVERY]
    del document["test_filenames"]
    frames = [frame for frame in document["frames"] if frame["file_path"] in training]
    for frame in frames:
        name = Path(frame["file_path"]).name
        for path in (Path("images") / name, Path("masks") / f"{name}.png"):
            (folder / path.parent).mkdir(parents=True, exist_ok=True)
            with Image.open(BOARD / path) as image:
                small = image.resize(SIZE, Image.Resampling.BOX)
            if path.parent.name == "masks":
                small = small.point(lambda value: 255 * (value >= 128))
            small.save(folder / path, quality=95)  # of JPEG alone
    shrink = SIZE[0] / document["w"]
    lens = {name: document[name] * shrink for name in ("fl_x", "fl_y", "cx", "cy")}
    smaller = {"w": SIZE[0], "h": SIZE[1], "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(document | lens | smaller))
    return folder


def starting_points(views: Sequence[View]) -> SparsePoints:
    """Return points in the hull, and pixels of training photos at random depths about it."""
    inside = visual_hull.fill(views, POINTS, seed=0)
    centre, rng = inside.xyz.mean(axis=0), np.random.default_rng(0)
    xyz, rgb = [], []
    for view in views:
        if view.split != "train" or view.camera is None:
            continue
        lens = view.camera.intrinsics
        pixels = rng.uniform(0, SIZE, (POINTS // len(views) * 4, 2))
        ray = (pixels - [lens.cx, lens.cy]) / [lens.fx, lens.fy]
        depth = np.linalg.norm(view.camera.centre - centre) * rng.uniform(0.8, 1.8, len(pixels))
        seen = np.column_stack([ray, np.ones(len(pixels))]) * depth[:, None]
        xyz.append((seen - view.camera.translation) @ view.camera.rotation)
        with Image.open(view.photo) as photo:
            cells = pixels.astype(int)
            rgb.append(np.asarray(photo)[cells[:, 1], cells[:, 0]])
    count = sum(map(len, xyz))
    outside = SparsePoints(
        np.concatenate(xyz),
        np.concatenate(rgb),
        np.zeros(count, np.float32),
        np.ones(count, np.int32),
    )
    return visual_hull.joined(inside, outside)


class Line:
    """The scene, and experiments on it."""

    def __init__(self, root: Path) -> None:
        photos = part_of_the_board(root / "photos")
        self.root, self.count = root, 0
        self.config = BenchmarkConfig(
            name="planted",
            captures=tuple(
                CaptureConfig(name=name, path=photos, kind="nerfstudio")
                for name in ("board", "again")
            ),
            conditions=tuple(dict.fromkeys(cell.condition for cell in CELLS)),
            iterations=ITERATIONS,
            resolution=64,
            test_every=2,
            segment=SegmentConfig(source="given"),
            # without D-SSIM the attention's weights are all that the loss has
            train=TrainConfig(max_splats=5000, ssim_lambda=0.0),
            methods={"ours": OURS},
        )
        capture = self.config.captures[0]
        self.prepared = prepare(capture, root / "prepared", test_every=self.config.test_every)
        self.masks = self.cut_out()
        self.scene = Scene("board", self.prepared.folder, self.prepared.views, EXTRA)
        self.scene.save(starting_points(self.prepared.views))

    def cut_out(self) -> MaskReport:
        """Cut out once more, scored against the masks that came with the photos."""
        known = replace(self.prepared, masks_are="truth")
        self.count += 1
        return infer.segment(known, self.config.segment, self.root / f"masks-{self.count}")

    def run(
        self,
        cell: Cell,
        *,
        scene: Scene | None = None,
        masks: MaskReport | None = None,
        speed: dict[str, float] | None = None,
    ) -> Row:
        self.count += 1
        out = self.root / f"run-{self.count}"
        scene, masks = scene or self.scene, masks or self.masks
        row = gate_runs.experiment(self.config, cell, scene, masks, out, speed=speed)
        return row | {"artifacts": {"train": out.name}}


Planted = tuple[Line, list[Row]]

"""Rows and artifact folders as a benchmark leaves them, drawn on the spot: plainly synthetic.

The pictures show a striped box before a chequered wall; "renders" are blurred copies whose blur
depends on the method, and scores are computed from them, so that every number has a picture.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageFilter

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import Scene, SparsePoints, View
from mattgs_ops.segment.mask_report import MaskReport, ViewReport

Row = dict[str, Any]
SIZE = (96, 72)  # width, height
VIEWS = 12
BLUR = {"3dgs": 1.4, "ours": 0.8, "ours+": 0.5}
COLOURS = {"rover": (200, 60, 40), "hexapod": (40, 90, 190), "lattepanda": (30, 140, 70)}


def cell_row(capture: str, background: str, method: str, seed: int = 0, **more: Any) -> Row:
    """One finished row with plausible numbers that depend on its cell; no pictures."""
    rng = np.random.default_rng([len(capture), len(background), len(method), seed])
    base = 23.0 + len(capture) / 10 + (background == "nobg") * 4 + rng.normal(0, 0.02)
    views = [
        {
            "view": f"{index * 8:04d}.jpg",
            "split": "test",
            "psnr": base + np.sin(index),
            "ssim": 0.85 + 0.01 * np.sin(index),
            "l1": 0.03,
            "mask_psnr": base - 3 + np.sin(index),
            "mask_ssim": 0.8 + 0.01 * np.sin(index),
            "mask_l1": 0.05,
        }
        for index in range(6)
    ]
    means = {
        name: float(np.mean([view[name] for view in views]))
        for name in views[0].keys() - {"view", "split"}
    }
    size = (9.0 if background == "original" else 4.0) * (0.8 if method == "ours" else 1.0)
    row = {
        "schema": 1,
        "benchmark": "toy",
        "capture": capture,
        "condition": f"{background}-{method}",
        "background": background,
        "method": method,
        "seed": seed,
        "iterations": 1000,
        "resolution": 320,
        "status": "finished",
        "reason": None,
        "metrics": {
            **means,
            "loss": 0.04,
            "fps": 55.0 + len(method),
            "time": 790.0 if background == "original" else 42.0,
            "size_mb": size,
            "splats": round(size * 4000),
            "train_psnr": means["psnr"] + 2,
        },
        "per_view": views,
        "registration": {
            "registered": 48,
            "views": 48,
            "points": 12_345,
            "mode": "shared",
            "missing": [],
        },
        "masks": {"mean_iou": 0.953, "source": "u2net"},
        "provenance": {
            "code_version": "0.1.0",
            "config_digest": "c0ffee",
            "cpu": "A CPU",
            "threads": 1,
            "calibration": {"seconds": 0.5},
            "inputs": {"capture": "d1"},
            "outputs": {},
        },
        "digests": dict.fromkeys(("prepare", "segment", "agree", "split", "truth", "masks"), "d1"),
        "artifacts": {},
        "seconds": {"prepare": 1.0, "segment": 20.0, "sfm": 65.0, "train": 42.0, "evaluate": 3.0},
        "run_id": f"{capture[:4]}{background[:2]}{method}{seed}".ljust(32, "0"),
    }
    return row | more


def failed_row(capture: str, background: str, method: str, reason: str, seed: int = 0) -> Row:
    row = cell_row(capture, background, method, seed)
    return row | {"status": "failed", "reason": reason, "metrics": {}, "per_view": []}


def grid(
    captures: tuple[str, ...] = ("rover", "hexapod", "lattepanda"),
    methods: tuple[str, ...] = ("3dgs", "ours"),
    seeds: int = 1,
) -> list[Row]:
    return [
        cell_row(capture, background, method, seed)
        for capture in captures
        for background in ("original", "nobg")
        for method in methods
        for seed in range(seeds)
    ]


def draw(capture: str, index: int) -> tuple[Image.Image, Image.Image]:
    """Draw a photo and its mask: a striped box that moves a little from view to view."""
    width, height = SIZE
    y, x = np.mgrid[:height, :width]
    angle = 2 * np.pi * index / VIEWS
    wall = 120 + 60 * (((x // 8 + index) + y // 8) % 2)[..., None] * np.array([1.0, 0.9, 0.7])
    cx, cy = width / 2 + 12 * np.cos(angle), height / 2 + 6 * np.sin(angle)
    inside = (abs(x - cx) < 22) & (abs(y - cy) < 16)
    stripes = 0.55 + 0.45 * ((x + y + 2 * index) // 3 % 2)
    box = np.array(COLOURS.get(capture, (128, 128, 40))) * stripes[..., None]
    photo = np.where(inside[..., None], box, wall).clip(0, 255).astype(np.uint8)
    return Image.fromarray(photo), Image.fromarray((inside * 255).astype(np.uint8))


def write_scene(folder: Path, capture: str) -> None:
    (folder / "photos").mkdir(parents=True)
    (folder / "masks").mkdir()
    views = []
    for index in range(VIEWS):
        name = f"{index:04d}.jpg"
        photo, mask = draw(capture, index)
        photo.save(folder / "photos" / f"{name}.png")
        mask.save(folder / "masks" / f"{name}.png")
        angle = 2 * np.pi * index / VIEWS
        views.append(
            View(
                name,
                "test" if index % 4 == 0 else "train",
                *SIZE,
                folder / "photos" / f"{name}.png",
                folder / "masks" / f"{name}.png",
                look_at(np.array([3 * np.cos(angle), 3 * np.sin(angle), 1.5])),
            )
        )
    rng = np.random.default_rng(3)
    points = SparsePoints(
        xyz=rng.uniform(-0.7, 0.7, (300, 3)),
        rgb=rng.integers(0, 255, (300, 3)).astype(np.uint8),
        object_share=rng.uniform(0, 1, 300).astype(np.float32),
        views_seen=np.full(300, 3, np.int32),
    )
    Scene(capture, folder, tuple(views), {"mode": "shared"}).save(points)
    flags = [("frame",) if index == 1 else () for index in range(VIEWS)]
    reports = (ViewReport(v.name, 0.3, f, None) for v, f in zip(views, flags, strict=True))
    MaskReport("u2net", "votes", None, tuple(reports)).save(folder / "masks.json")


def look_at(centre: np.ndarray) -> Camera:
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    width, height = SIZE
    intrinsics = Intrinsics(width, height, 90.0, 90.0, width / 2, height / 2)
    return Camera(intrinsics, rotation, -rotation @ centre)


PROPERTIES = (
    ["x", "y", "z", "nx", "ny", "nz"]
    + [f"f_dc_{i}" for i in range(3)]
    + [f"f_rest_{i}" for i in range(45)]
    + ["opacity"]
    + [f"scale_{i}" for i in range(3)]
    + [f"rot_{i}" for i in range(4)]
)


def write_ply(path: Path, capture: str, count: int, seed: int) -> None:
    """Flat splats on the faces of a box, in the original 3DGS layout."""
    rng = np.random.default_rng(seed)
    data = np.zeros(count, dtype=[(name, "<f4") for name in PROPERTIES])
    position = rng.uniform(-1, 1, (count, 3))
    face = rng.integers(0, 3, count)
    position[np.arange(count), face] = np.sign(position[np.arange(count), face])
    position *= [1.0, 0.6, 0.4]
    stripes = 0.5 + 0.5 * (np.floor(position.sum(1) * 6) % 2)
    rgb = np.array(COLOURS.get(capture, (128, 128, 40))) / 255 * stripes[:, None]
    for axis, name in enumerate("xyz"):
        data[name] = position[:, axis]
        data[f"f_dc_{axis}"] = (rgb[:, axis] - 0.5) / 0.28209479177387814
        data[f"scale_{axis}"] = np.where(face == axis, -6.0, -3.4)
    data["opacity"] = 2.0
    data["rot_0"] = 1.0
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {name}" for name in PROPERTIES] + ["end_header\n"]
    path.write_bytes("\n".join(header).encode() + data.tobytes())


def write_artifacts(row: Row, root: Path) -> None:
    """Write one row's folders and set its scores to those of its pictures."""
    capture, background, method = row["capture"], row["background"], row["method"]
    name = f"{capture}-{background}-{method}-{row['seed']}"
    scene = root / "scene" / capture
    if not scene.is_dir():
        write_scene(scene, capture)
    train, evaluate = root / "train" / name, root / "evaluate" / name
    train.mkdir(parents=True)
    write_ply(train / "splats.ply", capture, row["metrics"]["splats"] // 20, row["seed"])
    steps = np.arange(0, 1001, 100)
    lines = [
        f"{s},{0.2 * np.exp(-s / 300):.5f},{0.1 * np.exp(-s / 300):.5f},"
        f"{1 - 0.3 * np.exp(-s / 300):.5f},{24 - 10 * np.exp(-s / 300 * BLUR[method]):.4f},"
        f"{1000 + 3 * s}"
        for s in steps
    ]
    (train / "curve.csv").write_text("step,loss,l1,ssim,psnr,splats\n" + "\n".join(lines) + "\n")
    row["per_view"] = []
    for index in range(0, VIEWS, 4):
        truth, mask = draw(capture, index)
        if background == "nobg":
            truth = Image.composite(truth, Image.new("RGB", SIZE, "white"), mask)
        render = truth.filter(ImageFilter.GaussianBlur(BLUR[method]))
        for kind, image in (("truth", truth), ("renders", render)):
            folder = evaluate / kind / "test"
            folder.mkdir(parents=True, exist_ok=True)
            image.save(folder / f"{index:04d}.jpg.png")
        row["per_view"].append(
            {"view": f"{index:04d}.jpg", "split": "test", **scores(truth, render, mask)}
        )
    for key in ("psnr", "l1", "mask_psnr", "mask_l1"):
        row["metrics"][key] = float(np.mean([view[key] for view in row["per_view"]]))
    row["artifacts"] = {
        "train": f"train/{name}",
        "evaluate": f"evaluate/{name}",
        "scene": f"scene/{capture}",
        "masks": f"scene/{capture}",
    }


def scores(truth: Image.Image, render: Image.Image, mask: Image.Image) -> dict[str, float]:
    a, b = (np.asarray(image, np.float64) / 255 for image in (truth, render))
    inside = np.asarray(mask) > 127
    return {
        "psnr": float(-10 * np.log10(((a - b) ** 2).mean())),
        "l1": float(abs(a - b).mean()),
        "mask_psnr": float(-10 * np.log10(((a - b)[inside] ** 2).mean())),
        "mask_l1": float(abs(a - b)[inside].mean()),
        "ssim": 0.9,
        "mask_ssim": 0.85,
    }


@pytest.fixture(scope="module")
def rough_figures() -> Iterator[None]:
    """Have figures drawn coarsely, letters as outlines: for tests of what else a report has."""
    from reports.figures import plots

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots, "PNG_DPI", 30)
        patch.setitem(plots.STYLE, "pdf.fonttype", 3)
        yield


@pytest.fixture(scope="session")
def make_row() -> Callable[..., Row]:
    return cell_row


@pytest.fixture(scope="session")
def make_failed() -> Callable[..., Row]:
    return failed_row


@pytest.fixture(scope="session")
def make_grid() -> Callable[..., list[Row]]:
    return grid


@pytest.fixture(scope="session")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Row], Path]:
    """Make a grid with artifacts: one capture, four conditions, one seed; and their root."""
    root = tmp_path_factory.mktemp("artifacts")
    rows = grid(captures=("rover",))
    for row in rows:
        write_artifacts(row, root)
    return rows, root


@pytest.fixture(scope="session")
def built(pictured: tuple[list[Row], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the report of ``pictured`` once; the path of its page."""
    from reports.page.build import build

    rows, root = pictured
    out = tmp_path_factory.mktemp("report")
    return build(rows, out, title="Toy <benchmark>", artifacts_root=root, summary={"CPU": "one"})

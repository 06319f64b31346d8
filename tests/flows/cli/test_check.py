"""``mattgs check``: what it prints, the sheet, and the exit code."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from flows.cli.app import app
from flows.cli.check import A_STEP, A_TRAINING, estimate
from mattgs_ops.capture.scene import PreparedCapture, View
from mattgs_ops.config import BUNDLED, BenchmarkConfig
from mattgs_ops.errors import InputError
from tests.mattgs_ops.capture.conftest import NAMES, disc, write_colmap, write_masks
from tests.mattgs_ops.conftest import photographed

PHOTOS = Path(__file__).resolve().parents[3] / "mattgs_ops" / "bundled" / BUNDLED[0] / "images"
SQUARE = np.pad(np.full((60, 60), 255, np.uint8), ((30, 30), (50, 50)))


def some(folder: Path, count: int) -> Path:
    folder.mkdir()
    for path in sorted(PHOTOS.iterdir())[:count]:
        (folder / path.name).write_bytes(path.read_bytes())
    return folder


def masks_for(photos: Path, folder: Path) -> list[str]:
    """Return the options for exact masks, squares of other photos: no network is asked."""
    folder.mkdir()
    for photo in photos.iterdir():
        known = PHOTOS.parent / "masks" / f"{photo.name}.png"
        if known.is_file():
            (folder / known.name).write_bytes(known.read_bytes())
        else:
            cv2.imwrite(str(folder / known.name), SQUARE)
    return ["--masks", str(folder)]


def checked(photos: Path, out: Path, *options: str) -> Result:
    return CliRunner().invoke(app, ["check", str(photos), "--out", str(out), *options])


def test_photos_are_looked_at_and_masks_drawn(tmp_path: Path) -> None:
    photos = some(tmp_path / "photos", 3)
    result = checked(photos, tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "3 photos, 800x600 pixels as they are used\n" in result.output
    assert "about 3 of 3 photos will get a camera" in result.output
    assert "a full run takes about" in result.output
    assert "; where photos without a camera are sought anew, up to " in result.output
    sheet = tmp_path / "out" / "checks" / "photos" / "masks.png"
    assert np.asarray(cv2.imread(str(sheet))).shape[1] > 500
    assert [path.name for path in sheet.parent.glob("masks.*")] == ["masks.png"]


def test_masks_that_hold_another_half_in_each_photo_contradict_each_other(tmp_path: Path) -> None:
    photos = some(tmp_path / "photos", 4)
    for folder in ("halves", "exact"):
        (tmp_path / folder).mkdir()
    for index, path in enumerate(sorted(photos.iterdir())):
        half = np.zeros((600, 800), np.uint8)
        half[:, 400 * (index % 2) : 400 + 400 * (index % 2)] = 255
        name = f"{path.name}.png"
        cv2.imwrite(str(tmp_path / "halves" / name), half)
        (tmp_path / "exact" / name).write_bytes((PHOTOS.parent / "masks" / name).read_bytes())

    def with_masks(folder: str) -> str:
        options = ["--masks", str(tmp_path / folder), "--out", str(tmp_path / "out")]
        result = CliRunner().invoke(app, ["check", str(photos), *options])
        assert result.exit_code == 0, result.output
        return result.output

    halves = with_masks("halves")
    assert "! masks that contradict other photos' at points that both show: " in halves
    assert "one mask holds, both masks hold only" in halves
    assert "contradict" not in with_masks("exact")


def test_photos_that_have_nothing_in_common_end_with_two(tmp_path: Path) -> None:
    folder, rng = tmp_path / "noise", np.random.default_rng(0)
    folder.mkdir()
    for path in some(tmp_path / "photos", 1).iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    for index in range(4):
        noise = rng.integers(0, 256, (120, 160, 3)).astype(np.uint8)
        cv2.imwrite(str(folder / f"n{index}.png"), noise)
    masks = masks_for(folder, tmp_path / "masks")
    result = checked(folder, tmp_path / "out", *masks)
    assert result.exit_code == 2, result.output
    assert "too few for a run" in result.output


def test_photos_that_will_be_sought_anew_take_longer(tmp_path: Path) -> None:
    photos, rng = some(tmp_path / "photos", 4), np.random.default_rng(0)
    noise = rng.integers(0, 256, (120, 160, 3)).astype(np.uint8)
    cv2.imwrite(str(photos / "noise.png"), noise)
    result = checked(photos, tmp_path / "out", *masks_for(photos, tmp_path / "masks"))
    assert "pixels as they are used; masks came with them\n" in result.output
    assert "about 4 of 5 photos will get a camera" in result.output
    assert "; as photos without a camera are sought anew, up to " in result.output


def test_all_captures_of_a_file_are_looked_at(tmp_path: Path) -> None:
    file, out = tmp_path / "benchmark.toml", tmp_path / "out"
    entry = '[[captures]]\nname = "{0}"\npath = "{0}"\nmasks = "masks"\n'
    for name in ("cat", "dog"):
        some(tmp_path / name, 4)
    masks_for(tmp_path / "cat", tmp_path / "masks")  # both have the same photos
    file.write_text("".join(map(entry.format, ("cat", "dog"))))
    result = CliRunner().invoke(app, ["check", "--config", str(file), "--out", str(out)])
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert [line for line in lines if line in ("cat:", "dog:")] == ["cat:", "dog:"]
    assert result.output.count("  about 4 of 4 photos will get a camera") == 2
    assert [line for line in lines if "a full run takes" in line] == lines[-1:]
    assert {path.parent.name for path in out.glob("checks/*/masks.png")} == {"cat", "dog"}
    file.write_text("".join(map(entry.format, ("lost", "dog"))))
    result = CliRunner().invoke(app, ["check", "--config", str(file), "--out", str(out)])
    assert isinstance(result.exception, InputError), "which main() ends with exit code 2"
    assert str(tmp_path / "lost") in str(result.exception)
    assert "dog:" in result.output, "the others are looked at all the same"
    assert "a full run takes" not in result.output


@pytest.mark.parametrize("command", ["check", "run"])
def test_photos_may_be_named_or_not(tmp_path: Path, command: str) -> None:
    out = ["--out", str(tmp_path / "out")]
    missing = str(tmp_path / "missing")
    for given in ([missing], ["--photos", missing]):
        result = CliRunner().invoke(app, [command, *given, *out])
        assert isinstance(result.exception, InputError)
        assert "missing: expected a folder of photos, found nothing" in str(result.exception)
    assert not list(tmp_path.glob("out/prefect/server-*")), "no service is started for it"
    result = CliRunner().invoke(app, [command, "a", "--photos", "b", *out])
    assert str(result.exception) == f"{command}: expected one folder of photos, found a and b"


@pytest.mark.parametrize(("posed", "code"), [(4, 2), (8, 0)])
def test_cameras_that_a_run_would_refuse_are_refused(tmp_path: Path, posed: int, code: int) -> None:
    """A COLMAP model of some of ten photos; masks come along, so that no network is asked."""
    write_colmap(tmp_path / "in", NAMES[:posed])
    write_masks(tmp_path / "in" / "masks", disc())
    options = ["--capture", str(tmp_path / "in"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["check", *options])
    if code:
        assert "found 4 of 10; without one: " in str(result.exception)
    else:
        assert f"about {posed} of 10 photos will get a camera" in result.output
        assert "2 came without a camera: " in result.output


def posed(
    folder: Path, source: PreparedCapture, change: Callable[[np.ndarray], np.ndarray]
) -> Path:
    """Write a capture with `transforms.json`, camera-to-world [4, 4] in OpenGL's axes, changed."""
    frames = []
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    for view in source.views:
        assert view.camera is not None
        assert view.mask is not None
        name = f"{view.name}.png"
        (folder / "images" / name).write_bytes(view.photo.read_bytes())
        (folder / "masks" / f"{name}.png").write_bytes(view.mask.read_bytes())
        to_world = np.linalg.inv(view.camera.matrix) @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append(
            {"file_path": f"images/{name}", "transform_matrix": change(to_world).tolist()}
        )
        i = view.camera.intrinsics
    lens = {"w": i.width, "h": i.height, "fl_x": i.fx, "fl_y": i.fy, "cx": i.cx, "cy": i.cy}
    (folder / "transforms.json").write_text(json.dumps(lens | {"frames": frames}))
    return folder


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> PreparedCapture:
    return photographed(tmp_path_factory.mktemp("box"), seed=7)


def scaled(pose: np.ndarray, factor: float) -> np.ndarray:
    """Return a pose [4, 4] with its position in other units."""
    return pose * [1, 1, 1, factor] - np.diag([0, 0, 0, factor - 1])


def checked_capture(folder: Path, out: Path) -> Result:
    return CliRunner().invoke(app, ["check", "--capture", str(folder), "--out", str(out)])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda pose: scaled(pose, 1e-4), "is nearer than 0.2 units.*multiply camera positions"),
        (
            lambda pose: pose @ np.diag([1.0, -1, -1, 1]),
            "no common volume.*must be camera-to-world",
        ),
        (np.linalg.inv, 'no common volume.*sfm.poses = "estimate"'),
    ],
)
def test_cameras_without_points_that_a_run_would_refuse_are_refused(
    tmp_path: Path,
    box: PreparedCapture,
    change: Callable[[np.ndarray], np.ndarray],
    words: str,
) -> None:
    result = checked_capture(posed(tmp_path / "in", box, change), tmp_path / "out")
    assert isinstance(result.exception, InputError), result.output
    assert re.search(words, str(result.exception))


def test_right_cameras_without_points_are_fine(tmp_path: Path, box: PreparedCapture) -> None:
    result = checked_capture(posed(tmp_path / "in", box, lambda pose: pose), tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "volume" not in result.output
    assert "nearer" not in result.output


def test_masks_that_share_no_volume_are_told_where_cameras_are_right(
    tmp_path: Path, box: PreparedCapture
) -> None:
    """A run triangulates points all the same."""
    folder = posed(tmp_path / "in", box, lambda pose: pose)
    for index, path in enumerate(sorted((folder / "masks").iterdir())):
        corner = np.zeros((180, 240), np.uint8)
        corner[60:90, 60:90] = 255 * (index % 2)
        corner[-40:-10, -40:-10] = 255 * (1 - index % 2)
        cv2.imwrite(str(path), corner)
    result = checked_capture(folder, tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "! unless a run triangulates points enough on the object" in result.output


def test_a_hull_that_is_a_little_near_is_told(tmp_path: Path, box: PreparedCapture) -> None:
    """The nearest of the hull may hold no point that a run finds."""
    depths = np.concatenate([v.camera.depths(np.zeros((1, 3))) for v in box.views if v.camera])
    factor = 0.22 / float(np.median(depths))
    folder = posed(tmp_path / "in", box, lambda pose: scaled(pose, factor))
    result = checked_capture(folder, tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "! a run may refuse this, by the points that it finds: " in result.output


def test_without_photos_there_is_nothing_to_check(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["check", "--out", str(tmp_path)])
    assert isinstance(result.exception, InputError)


def test_more_photos_and_more_steps_take_longer(tmp_path: Path) -> None:
    def of(count: int) -> PreparedCapture:
        view = View("a.jpg", "train", 640, 480, tmp_path / "a", None, None)
        return PreparedCapture("x", tmp_path, (view,) * count, "none", "none")

    def takes(count: int, config: BenchmarkConfig) -> float:
        return estimate(of(count), config, count, given=False).seconds

    short, long = BenchmarkConfig(), BenchmarkConfig(iterations=30_000)
    assert takes(60, short) > takes(30, short)
    assert takes(30, long) == pytest.approx(takes(30, short) + 6 * 29_000 * A_STEP / 2, rel=0.01)
    two = BenchmarkConfig(budgets=(5000, 10_000))
    trainings = 6 * (1000 * A_STEP + A_TRAINING) / 2
    assert takes(30, two) == pytest.approx(takes(30, short) + trainings)
    # cameras that came along are not sought anew
    assert estimate(of(30), short, 30, given=True).further_attempts == 0
    assert not estimate(of(30), short, 30, given=False).likely_again
    assert estimate(of(30), short, 20, given=False).likely_again

"""What one stage writes the next one reads, unchanged."""

import json
from pathlib import Path

import numpy as np
import pytest

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.capture.scene import PreparedCapture, Scene, SparsePoints, View
from mattgs_ops.errors import InputError


def views(folder: Path) -> tuple[View, ...]:
    camera = Camera(Intrinsics(8, 6, 10.0, 10.0, 4.0, 3.0), np.eye(3), np.array([0.0, 1.0, 2.0]))
    photo, ids = folder / "photos/a.jpg.png", folder / "ids/a.jpg.png"
    first = View("a.jpg", "test", 8, 6, photo, None, None, ids)
    mask = folder / "masks/b.jpg.png"
    return first, View("b.jpg", "train", 8, 6, folder / "photos/b.jpg.png", mask, camera)


def test_a_prepared_capture_survives_the_disk(tmp_path: Path) -> None:
    PreparedCapture("toy", tmp_path, views(tmp_path), "given", "none").save()
    back = PreparedCapture.load(tmp_path)
    assert (back.name, back.masks_are, back.cameras_are) == ("toy", "given", "none")
    assert [v.name for v in back.views] == ["a.jpg", "b.jpg"]
    assert back.views[0].mask is None
    assert back.views[1].mask == tmp_path / "masks/b.jpg.png"
    assert [v.ids for v in back.views] == [tmp_path / "ids/a.jpg.png", None]


def test_a_scene_can_be_moved_and_knows_which_views_are_registered(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    points = SparsePoints(
        xyz=np.arange(6, dtype=np.float64).reshape(2, 3),
        rgb=np.array([[0, 1, 2], [3, 4, 255]], dtype=np.uint8),
        object_share=np.array([0.0, 1.0], dtype=np.float32),
        views_seen=np.array([2, 3], dtype=np.int32),
    )
    Scene("toy", here, views(here), {"mode": "shared"}).save(points)
    there = here.rename(tmp_path / "there")
    scene = Scene.load(there)
    assert scene.extra == {"mode": "shared"}
    assert scene.registered("test") == ()
    (view,) = scene.registered("train")
    assert view.photo == there / "photos/b.jpg.png"
    assert view.camera is not None
    np.testing.assert_array_equal(view.camera.translation, [0, 1, 2])
    for key, value in vars(points).items():
        np.testing.assert_array_equal(getattr(scene.points(), key), value)


def test_a_dropped_view_is_neither_trained_on_nor_scored(tmp_path: Path) -> None:
    scene = Scene("toy", tmp_path, views(tmp_path), {"dropped": ["b.jpg"]})
    assert scene.registered("train") == ()
    assert scene.dropped == ("b.jpg",)


def test_a_file_of_another_schema_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text('{"schema": 99}', encoding="utf-8")
    with pytest.raises(InputError, match=r"scene\.json: expected schema 1, found 99"):
        Scene.load(tmp_path)
    with pytest.raises(InputError, match=r"capture\.json: expected a readable JSON file"):
        PreparedCapture.load(tmp_path)


@pytest.mark.parametrize("text", ["[]", "1", '{"schema": 1, "views": 3}'])
def test_json_of_another_form_is_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "scene.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"scene\.json: expected a JSON object with a list"):
        Scene.load(tmp_path)


def test_bytes_that_are_no_text_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "capture.json").write_bytes('{"name": "Gerät"}'.encode("latin-1"))
    with pytest.raises(InputError, match=r"capture\.json: expected a readable JSON file.*utf-8"):
        PreparedCapture.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"name": "../../evil.jpg"}, "`name`: expected the name of a file, found '../../evil.jpg'"),
        ({"name": "/evil.jpg"}, "`name`: expected the name of a file, found '/evil.jpg'"),
        ({"photo": "/etc/hostname"}, "`photo` of a.jpg: expected a path below its folder"),
        ({"ids": "../ids.png"}, "`ids` of a.jpg: expected a path below its folder"),
        ({"mask": "masks/../../m.png"}, "`mask` of a.jpg: expected a path below its folder"),
    ],
)
def test_a_scene_of_somebody_else_stays_in_its_folder(
    tmp_path: Path, change: dict[str, str], says: str
) -> None:
    """Scenes come from shared stores; views name the renders that are written later."""
    PreparedCapture("toy", tmp_path, views(tmp_path), "given", "none").save()
    path = tmp_path / "capture.json"
    document = json.loads(path.read_text())
    document["views"][0] |= change
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=says) as caught:
        PreparedCapture.load(tmp_path)
    assert str(path) in str(caught.value)


class Attack:
    """Something whose unpickling would write a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[Path]]:
        return Path.touch, (self.path,)


def test_points_that_would_run_code_are_refused_and_do_not_run(tmp_path: Path) -> None:
    points = np.empty(1, dtype=object)
    points[0] = Attack(tmp_path / "ran")
    np.savez(tmp_path / "points.npz", xyz=points, allow_pickle=True)
    scene = Scene("toy", tmp_path, (), {})
    with pytest.raises(InputError, match=r"points\.npz: expected arrays xyz.*pickle"):
        scene.points()
    assert not (tmp_path / "ran").exists()
    (tmp_path / "points.npz").write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"points\.npz: expected arrays xyz"):
        scene.points()

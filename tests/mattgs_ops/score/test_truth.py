"""What renders are compared with is stored once, and is the same wherever it is linked."""

import json
from pathlib import Path

import pytest

from mattgs_ops.capture.scene import Scene
from mattgs_ops.errors import InputError
from mattgs_ops.score.evaluate import EVALUATION_FILE, render_views, score
from mattgs_ops.score.truth import TRUTH_FILE, StoredTruth, link_truth, store_truth
from tests.mattgs_ops.score.conftest import NOBG, ORIGINAL, WIDTH


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*.png")}


def test_scores_against_a_stored_truth_are_the_same_to_the_bit(
    scene: Scene, ply: Path, tmp_path: Path
) -> None:
    stored, own, linked = (tmp_path / name for name in ("stored", "own", "linked"))
    store_truth(scene, "nobg", WIDTH, stored)
    render_views(scene, ply, NOBG, WIDTH, own)
    render_views(scene, ply, NOBG, WIDTH, linked, truth=stored)
    for folder in (own, linked):
        score(folder)
    assert (own / EVALUATION_FILE).read_bytes() == (linked / EVALUATION_FILE).read_bytes()
    assert names(own) == names(linked) > names(stored)


def test_a_linked_truth_takes_no_room(scene: Scene, tmp_path: Path) -> None:
    store_truth(scene, "original", WIDTH, tmp_path / "stored")
    for name in ("one", "two", "two"):  # again, as after an interruption
        link_truth(tmp_path / "stored", tmp_path / name)
    (file, *_) = sorted(names(tmp_path / "stored"))
    assert (tmp_path / "stored" / file).stat().st_nlink == 3


def test_between_file_systems_it_is_copied(
    scene: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    store_truth(scene, "original", WIDTH, tmp_path / "stored")
    monkeypatch.setattr("os.link", refuse)
    link_truth(tmp_path / "stored", tmp_path / "out")
    assert names(tmp_path / "out") == names(tmp_path / "stored")
    for name in names(tmp_path / "out"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "stored" / name).read_bytes()


def test_a_share_of_the_training_views_is_stored_and_said(scene: Scene, tmp_path: Path) -> None:
    stored = store_truth(scene, "original", WIDTH, tmp_path, train_every=3)
    training = [view.name for view in scene.registered("train")]
    assert [view.name for view in stored.views if view.split == "train"] == training[::3]
    assert StoredTruth.load(tmp_path) == stored


def test_a_truth_of_other_settings_is_refused(scene: Scene, ply: Path, tmp_path: Path) -> None:
    store_truth(scene, "nobg", WIDTH, tmp_path / "stored")
    with pytest.raises(InputError, match=r"stored: expected truth of .*'original'.*found .*'nobg'"):
        render_views(scene, ply, ORIGINAL, WIDTH, tmp_path / "out", truth=tmp_path / "stored")
    (tmp_path / "stored" / TRUTH_FILE).write_text(json.dumps({"schema": 1}))
    with pytest.raises(InputError, match=r"truth\.json: expected the list of stored views"):
        link_truth(tmp_path / "stored", tmp_path / "out")

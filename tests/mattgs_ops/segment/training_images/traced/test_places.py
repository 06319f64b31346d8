"""Traced training views: plain grounds with and without an object, exact masks, a known camera."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the `captures` extra is not installed")

from mattgs_ops.errors import InputError
from mattgs_ops.segment.network.train_config import RenderedConfig
from mattgs_ops.segment.training_images.traced import places
from mattgs_ops.segment.training_images.traced.backdrops import load_backdrops
from mattgs_ops.segment.training_images.traced.places import MIXING, PLAIN, _place, render_places
from mattgs_ops.synthetic import tracer
from mattgs_ops.synthetic.made_file import write_made
from mattgs_ops.synthetic.surroundings.grounds import PLATE_HEIGHT
from mattgs_ops.synthetic.tracer import choose_variant

CONFIG = RenderedConfig(desks=1, plain=len(PLAIN), objects=1, views=2, empty=1, width=32)


TOPS = {"black-cloth": 0.0, "dark-flash": 0.0, "turntable": PLATE_HEIGHT}  # centimetres


@pytest.mark.parametrize("figures", [0.0, 1.0])
@pytest.mark.parametrize("ground", sorted(TOPS))
def test_a_plain_place_gives_views_masks_and_a_backdrop(
    tmp_path: Path, ground: str, figures: float
) -> None:
    choose_variant("scalar_rgb")
    for folder in ("images", "masks", "empty"):
        (tmp_path / folder).mkdir()
    place = CONFIG.desks + PLAIN.index(ground)
    config = CONFIG.model_copy(update={"figures": figures})
    cameras = _place(config, place, tmp_path)
    (tmp_path / f"place{place:02d}.json").write_text(json.dumps(cameras))
    views = sorted(path.name for path in (tmp_path / "images").iterdir())
    assert views == [f"{place:02d}_01_{k:02d}.jpg" for k in range(2)]
    for name in views:
        image = cv2.imread(str(tmp_path / "images" / name))
        mask_file = tmp_path / "masks" / Path(name).with_suffix(".png")
        mask = cv2.imread(str(mask_file), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        assert mask is not None
        assert image.shape == (24, 32, 3)
        found = np.argwhere(mask > 127)
        assert 0.02 < len(found) / mask.size < 0.7
        assert np.abs(found.mean(0) / mask.shape - 0.5).max() < 0.25
    (backdrop,) = load_backdrops(tmp_path)
    assert backdrop.top == TOPS[ground]
    assert backdrop.image.shape == (24, 32, 3)


def test_a_room_gives_views_of_one_object_in_the_middle(tmp_path: Path) -> None:
    choose_variant("scalar_rgb")
    for folder in ("images", "masks", "empty"):
        (tmp_path / folder).mkdir()
    config = RenderedConfig(desks=1, rooms=1, objects=2, views=1, empty=1, width=48)
    assert config.places == 2
    cameras = _place(config, 1, tmp_path)
    assert list(cameras) == ["01_00_00.jpg"]
    for name in ("01_01_00", "01_02_00"):
        image = cv2.imread(str(tmp_path / "images" / f"{name}.jpg"))
        mask = cv2.imread(str(tmp_path / "masks" / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        assert mask is not None
        found = np.argwhere(mask > 127)
        assert 0.02 < len(found) / mask.size < 0.7
        assert np.abs(found.mean(0) / mask.shape - 0.5).max() < 0.25
        assert 5 < image.mean() < 250  # exposed by what is seen


def test_places_that_are_there_need_no_mitsuba(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba", None)  # as if it were not installed
    config = RenderedConfig(desks=1, plain=1)
    with pytest.raises(InputError, match="expected Mitsuba to trace training views"):
        render_places(config, tmp_path)
    assert not list(tmp_path.iterdir())
    traced_before(tmp_path, config)
    render_places(config, tmp_path)
    assert not (tmp_path / "images").exists()


def traced_before(folder: Path, config: RenderedConfig) -> None:
    """Leave what an earlier tracing of all places leaves, but for its images."""
    write_made(folder / "made.json", config.model_dump(mode="json", exclude=MIXING))
    for place in range(config.places):
        (folder / f"place{place:02d}.json").write_text("{}")


@pytest.mark.parametrize(("field", "value"), [("desks", 1), ("plain", 0), ("width", 64)])
def test_places_of_another_configuration_are_refused(
    tmp_path: Path, field: str, value: int
) -> None:
    config = RenderedConfig(desks=2, plain=1, width=32)
    traced_before(tmp_path, config)
    message = rf"made\.json: expected images made with {field} {value}, found {field} \d+$"
    with pytest.raises(InputError, match=message):
        render_places(config.model_copy(update={field: value}), tmp_path)
    render_places(config.model_copy(update={"share": 0.1, "backdrops": 0, "pasted": 1}), tmp_path)


def test_places_that_tell_of_no_configuration_are_refused(tmp_path: Path) -> None:
    config = RenderedConfig(desks=1)
    traced_before(tmp_path, config)
    (tmp_path / "made.json").unlink()
    with pytest.raises(InputError, match=r"expected made\.json beside the images"):
        render_places(config, tmp_path)


def test_a_kill_while_cameras_are_written_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(places, "_place", lambda *_: {"a.jpg": {"top": 0.0}})
    monkeypatch.setattr(tracer, "choose_variant", lambda: "scalar_rgb")
    config, write = RenderedConfig(desks=2), Path.write_text

    def killed(path: Path, data: str, **options: str) -> int:
        if path.name.startswith("place01"):
            write(path, data[:5], **options)
            raise KeyboardInterrupt
        return write(path, data, **options)

    monkeypatch.setattr(Path, "write_text", killed)
    with pytest.raises(KeyboardInterrupt):
        render_places(config, tmp_path)
    assert [path.name for path in tmp_path.glob("place*")] == ["place00.json"]
    monkeypatch.setattr(Path, "write_text", write)
    render_places(config, tmp_path)
    assert json.loads((tmp_path / "place01.json").read_text()) == {"a.jpg": {"top": 0.0}}

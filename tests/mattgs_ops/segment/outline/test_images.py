"""What the outline is trained on: images of the asked-for configuration, each of them whole."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from mattgs_ops.errors import InputError
from mattgs_ops.segment.outline.images import draw_images
from mattgs_ops.segment.outline.train_config import OutlineTrainConfig, PaintedConfig
from mattgs_ops.segment.training_images.composites import Composites
from mattgs_ops.segment.training_images.textures import Bank


def config(**painted: int) -> OutlineTrainConfig:
    return OutlineTrainConfig(painted=PaintedConfig(**{"count": 2, "size": 48, **painted}))


def test_images_that_are_there_are_kept(tmp_path: Path) -> None:
    (folder,) = draw_images(config(), tmp_path)
    image = folder / "images" / "0001.png"
    before = image.read_bytes()
    image.unlink()
    (folder / "images" / "0000.png").write_bytes(b"kept")
    assert draw_images(config(), tmp_path) == [folder]
    assert image.read_bytes() == before
    assert (folder / "images" / "0000.png").read_bytes() == b"kept"
    names = sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())
    pairs = [f"{kind}/000{k}.png" for kind in ("images", "masks") for k in range(2)]
    assert names == sorted([*pairs, "made.json"])


@pytest.mark.parametrize("field", ["count", "size", "seed"])
def test_images_of_another_configuration_are_refused(tmp_path: Path, field: str) -> None:
    draw_images(config(), tmp_path)
    message = rf"painted/made\.json: expected images made with {field} 50, found {field} \d+$"
    with pytest.raises(InputError, match=message):
        draw_images(config(**{field: 50}), tmp_path)


def test_images_that_tell_of_no_configuration_are_refused(tmp_path: Path) -> None:
    draw_images(config(), tmp_path)
    (tmp_path / "painted" / "made.json").unlink()
    with pytest.raises(InputError, match=r"painted: expected made\.json beside the images"):
        draw_images(config(), tmp_path)


def test_a_kill_while_an_image_is_written_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_images(config(), tmp_path / "whole")
    write, written = Path.write_bytes, 0

    def killed(path: Path, data: bytes) -> int:
        nonlocal written
        written += 1
        if written == 4:  # the second image, after its mask
            write(path, data[: len(data) // 2])
            raise KeyboardInterrupt
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", killed)
    with pytest.raises(KeyboardInterrupt):
        draw_images(config(), tmp_path / "broken")
    monkeypatch.undo()
    whole, broken = (tmp_path / name / "painted" for name in ("whole", "broken"))
    assert [path.name for path in (broken / "images").iterdir()] == ["0000.png"]
    draw_images(config(), tmp_path / "broken")
    for path in whole.rglob("*.png"):
        assert path.read_bytes() == (broken / path.relative_to(whole)).read_bytes()


def test_files_hold_what_was_painted(tmp_path: Path) -> None:
    (folder,) = draw_images(config(), tmp_path)
    painted = config().painted
    assert painted is not None
    source = Composites(painted.seed, painted.size, Bank(painted.seed), world=painted.world)
    image, mask = source.sample(1)
    found = cv2.imread(str(folder / "images" / "0001.png"))
    assert found is not None
    assert np.array_equal(found[..., ::-1], image)
    truth = cv2.imread(str(folder / "masks" / "0001.png"), cv2.IMREAD_GRAYSCALE)
    assert truth is not None
    assert np.array_equal(truth, mask)

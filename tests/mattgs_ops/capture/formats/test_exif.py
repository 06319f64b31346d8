"""The focal length and the camera that EXIF tells, and what it does not tell."""

import numpy as np
import pytest
from PIL import Image

from mattgs_ops.capture.formats.exif import exif_focal, exif_lens


def test_the_focal_length_comes_from_the_35_mm_equivalent() -> None:
    exif = Image.Exif()
    assert exif_focal(exif, (400, 300)) is None
    details = exif.get_ifd(0x8769)
    details[0xA405] = 28
    assert exif_focal(exif, (400, 300)) == pytest.approx(28 * 500 / np.hypot(36, 24))
    details[0xA002], details[0xA003] = 4000, 3000
    assert exif_focal(exif, (400, 300)) == pytest.approx(28 * 500 / np.hypot(36, 24))
    assert exif_focal(exif, (300, 400)) is not None  # turned since, by a program that left EXIF
    assert exif_focal(exif, (300, 300)) is None  # cut since: nobody knows from how much
    for nonsense in (0, 1, 9999):  # 0: unknown, says EXIF; the others no lens has
        details[0xA405] = nonsense
        assert exif_focal(exif, (400, 300)) is None


def test_a_camera_goes_by_its_name_and_focal_length() -> None:
    exif = Image.Exif()
    assert exif_lens(exif) == ""
    exif[0x010F], exif[0x0110] = "Maker", "Camera 1\0\0"
    assert exif_lens(exif) == "Maker Camera 1"
    exif.get_ifd(0x8769)[0x920A] = 55.0
    assert exif_lens(exif) == "Maker Camera 1 55.0 mm"


def test_where_there_is_no_equivalent_the_sensor_tells_the_focal_length() -> None:
    """A compact camera of 4.3 mm whose sensor is 6.2 mm wide, as its maker writes it."""
    exif = Image.Exif()
    details = exif.get_ifd(0x8769)
    details[0x920A], details[0xA20E], details[0xA210] = 4.3, 21159.18, 2
    details[0xA002], details[0xA003] = 5184, 3888
    focal = 4.3 * 21159.18 / 25.4  # of the photo as it was taken
    assert exif_focal(exif, (5184, 3888)) == pytest.approx(focal)
    assert exif_focal(exif, (1600, 1200)) == pytest.approx(focal * 1600 / 5184)
    assert exif_focal(exif, (1200, 1600)) == pytest.approx(focal * 1600 / 5184)
    assert exif_focal(exif, (1200, 1200)) is None
    del details[0xA210]  # inches, says EXIF, where it is not told
    assert exif_focal(exif, (1600, 1200)) == pytest.approx(focal * 1600 / 5184)
    details[0xA20E], details[0xA210] = 8330.39, 3  # per centimetre
    assert exif_focal(exif, (1600, 1200)) == pytest.approx(focal * 1600 / 5184, rel=1e-4)
    for unit in (1, 9):  # no unit, and none that EXIF knows
        details[0xA210] = unit
        assert exif_focal(exif, (1600, 1200)) is None
    details[0xA210], details[0xA405] = 3, 28
    assert exif_focal(exif, (1600, 1200)) == pytest.approx(28 * 2000 / np.hypot(36, 24))

"""Undistortion against the formula itself, written out plainly."""

import numpy as np
import pytest

from mattgs_ops.capture.camera import Intrinsics
from mattgs_ops.capture.undistortion import Lens, undistortion
from mattgs_ops.errors import InputError

SIZE = (120, 90)
INTRINSICS = Intrinsics(*SIZE, fx=100.0, fy=102.0, cx=61.5, cy=44.0)
LENSES = {
    "barrel": (-0.2, 0.05, 0.0, 0.0, 0.0),
    "pincushion": (0.15, 0.02, 0.0, 0.0, 0.0),
    "tangential": (-0.05, 0.01, 0.004, -0.006, 0.0),
}


def distort(i: Intrinsics, c: tuple[float, ...], plane: np.ndarray) -> np.ndarray:
    """Brown–Conrady, from the plane [N, 2] to pixels with centres at +0.5."""
    k1, k2, p1, p2, k3 = c
    x, y = plane[:, 0], plane[:, 1]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([i.fx * u + i.cx, i.fy * v + i.cy], 1)


@pytest.mark.parametrize("kind", LENSES)
def test_every_new_pixel_reads_where_the_lens_put_it(kind: str) -> None:
    result = undistortion(Lens(INTRINSICS, LENSES[kind]))
    new = result.intrinsics
    rows, columns = np.mgrid[: new.height, : new.width]
    u, v = columns.ravel() + 0.5, rows.ravel() + 0.5
    plane = np.stack([(u - new.cx) / new.fx, (v - new.cy) / new.fy], 1)
    expected = distort(INTRINSICS, LENSES[kind], plane)
    found = np.stack([result.map_x.ravel() + 0.5, result.map_y.ravel() + 0.5], 1)
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize("kind", LENSES)
def test_nothing_outside_the_photo_is_seen_and_little_is_lost(kind: str) -> None:
    result = undistortion(Lens(INTRINSICS, LENSES[kind]))
    width, height = SIZE
    slack = 0.02  # pixels; undistortPoints iterates
    assert result.map_x.min() >= -slack
    assert result.map_x.max() <= width - 1 + slack
    assert result.map_y.min() >= -slack
    assert result.map_y.max() <= height - 1 + slack
    touched = [result.map_x.min(), width - 1 - result.map_x.max()]
    touched += [result.map_y.min(), height - 1 - result.map_y.max()]
    assert min(touched) < 0.3  # at least one edge is used up to the rim


def test_no_distortion_is_the_identity() -> None:
    result = undistortion(Lens(INTRINSICS))
    assert result.intrinsics.fx == pytest.approx(INTRINSICS.fx)
    assert result.intrinsics.cy == pytest.approx(INTRINSICS.cy)
    rgb = np.random.default_rng(0).integers(0, 256, (90, 120, 3), dtype=np.uint8)
    assert np.abs(result.photo(rgb).astype(int) - rgb).max() <= 1


def test_a_photographed_straight_line_becomes_straight() -> None:
    lens = Lens(INTRINSICS, LENSES["barrel"])
    t = np.linspace(-0.9, 0.9, 4000)
    line = distort(INTRINSICS, lens.coefficients, np.stack([t, np.full_like(t, 0.3)], 1))
    bent = np.interp(np.arange(120) + 0.5, line[:, 0], line[:, 1]) - 0.5  # row in each column
    assert np.ptp(bent) > 1.5
    down = np.arange(90.0)[:, None]
    ink = 255 * np.exp(-((down - bent) ** 2) / 2)
    photo = np.repeat(np.round(ink)[..., None], 3, axis=2).astype(np.uint8)
    result = undistortion(lens)
    ink = result.photo(photo)[..., 0].astype(float)
    rows = (ink * down).sum(0) / ink.sum(0)
    expected = result.intrinsics.fy * 0.3 + result.intrinsics.cy - 0.5
    np.testing.assert_allclose(rows, expected, atol=0.08)  # OpenCV samples at 32nds of a pixel


def test_masks_stay_binary() -> None:
    mask = np.zeros((90, 120), np.uint8)
    mask[30:60, 40:80] = 255
    out = undistortion(Lens(INTRINSICS, LENSES["tangential"])).mask(mask)
    assert set(np.unique(out)) == {0, 255}


def test_coefficients_that_fold_the_photo_are_refused() -> None:
    with pytest.raises(InputError, match="check the coefficients"):
        undistortion(Lens(INTRINSICS, (-9.0, 0.0, 0.0, 0.0, 0.0)))


def test_a_strong_lens_loses_no_more_than_it_must() -> None:
    """With OpenCV's default of five steps 40 % of the width was left of this one."""
    wide = Intrinsics(160, 120, 50.0, 50.0, 80.0, 60.0)
    lens = Lens(wide, (-0.25, 0.07))
    corners = np.array([[0.5, 0.5], [159.5, 119.5]])
    np.testing.assert_allclose(lens.to_pixels(lens.to_plane(corners)), corners, atol=1e-3)
    result = undistortion(lens)
    assert result.map_x.min() < 0.02
    assert result.map_x.max() > 158.98


def test_a_pinhole_never_shows_what_lies_beyond_the_fold() -> None:
    """Along the diagonal the distance from the middle grows, in the photo as on the plane."""
    lens = Lens(Intrinsics(160, 120, 120.0, 120.0, 80.0, 60.0), (-0.3,))
    result = undistortion(lens)
    for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        rows = np.linspace(60, corner[0] % 120, 50).round().astype(int)
        columns = np.linspace(80, corner[1] % 160, 50).round().astype(int)
        shown = np.hypot(result.map_x[rows, columns] - 79.5, result.map_y[rows, columns] - 59.5)
        assert (np.diff(shown) > 0).all()


# ---------------------------------------------------------------- rational and fisheye lenses

RATIONAL = (0.3, -0.1, 0.002, -0.003, 0.02, 0.35, -0.05, 0.01)
FISHEYE = (0.05, -0.01, 0.004, -0.001)
WIDE = Intrinsics(*SIZE, fx=30.0, fy=31.0, cx=61.5, cy=44.0)  # 230 degrees across, as a fisheye


def fisheye(i: Intrinsics, k: tuple[float, ...], plane: np.ndarray) -> np.ndarray:
    """Kannala and Brandt's model, written out plainly."""
    r = np.hypot(plane[:, 0], plane[:, 1])
    t = np.arctan(r)
    radius = t + k[0] * t**3 + k[1] * t**5 + k[2] * t**7 + k[3] * t**9
    scale = np.where(r > 0, radius / np.maximum(r, 1e-12), 1.0)[:, None]
    return plane * scale * [i.fx, i.fy] + [i.cx, i.cy]


def grid(new: Intrinsics) -> np.ndarray:
    rows, columns = np.mgrid[: new.height, : new.width]
    u, v = columns.ravel() + 0.5, rows.ravel() + 0.5
    return np.stack([(u - new.cx) / new.fx, (v - new.cy) / new.fy], 1)


@pytest.mark.parametrize("intrinsics", [INTRINSICS, WIDE])
def test_a_fisheye_reads_where_its_lens_put_it(intrinsics: Intrinsics) -> None:
    result = undistortion(Lens(intrinsics, FISHEYE, fisheye=True))
    expected = fisheye(intrinsics, FISHEYE, grid(result.intrinsics))
    found = np.stack([result.map_x.ravel() + 0.5, result.map_y.ravel() + 0.5], 1)
    np.testing.assert_allclose(found, expected, atol=2e-3)
    assert found.min() >= 0.48
    assert (found.max(axis=0) <= np.array(SIZE) - 0.48).all()


def test_a_wide_fisheye_keeps_half_of_its_resolution_in_the_middle() -> None:
    result = undistortion(Lens(WIDE, FISHEYE, fisheye=True))
    assert result.intrinsics.fx == pytest.approx(WIDE.fx / 2)


def test_a_rational_lens_reads_where_its_lens_put_it() -> None:
    result = undistortion(Lens(INTRINSICS, RATIONAL))
    plane = grid(result.intrinsics)
    k1, k2, p1, p2, k3, k4, k5, k6 = RATIONAL
    r2 = (plane**2).sum(1)
    above, below = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3, 1 + k4 * r2 + k5 * r2**2 + k6 * r2**3
    radial = above / below
    x, y = plane.T
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    i = INTRINSICS
    expected = np.stack([i.fx * u + i.cx, i.fy * v + i.cy], 1)
    found = np.stack([result.map_x.ravel() + 0.5, result.map_y.ravel() + 0.5], 1)
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize(
    "lens",
    [
        Lens(INTRINSICS),
        Lens(INTRINSICS, LENSES["tangential"]),
        Lens(INTRINSICS, RATIONAL),
        Lens(INTRINSICS, FISHEYE, fisheye=True),
        Lens(INTRINSICS, (), fisheye=True),
    ],
)
def test_pixels_and_the_plane_are_inverse(lens: Lens) -> None:
    pixels = np.random.default_rng(1).uniform([1, 1], [119, 89], (200, 2))
    pixels[0] = [INTRINSICS.cx, INTRINSICS.cy]
    np.testing.assert_allclose(lens.to_pixels(lens.to_plane(pixels)), pixels, atol=2e-3)
    assert lens.to_plane(np.zeros((0, 2))).shape == (0, 2)


def test_a_fisheyes_coefficients_that_fold_the_photo_are_refused() -> None:
    with pytest.raises(InputError, match="check the coefficients"):
        undistortion(Lens(WIDE, (-9.0, 0.0, 0.0, 0.0), fisheye=True))

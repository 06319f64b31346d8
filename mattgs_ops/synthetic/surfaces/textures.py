"""Grown and made surfaces: wood, cutting mat, cloth, cardboard, plaster, floor, worn metal.

All functions return [H, W, 3] uint8 sRGB images drawn with the generator given to them.
"""

from itertools import pairwise
from math import ceil

import cv2
import numpy as np
from numpy.random import Generator

from mattgs_ops.synthetic.surfaces.materials import Image
from mattgs_ops.synthetic.surfaces.print import Sheet, noise, phrase

BLUR_REACH = 8  # standard deviations: twice as far as OpenCV's filter


def _image(values: np.ndarray) -> Image:
    image: Image = np.clip(values, 0, 255).astype(np.uint8)
    return image


def wood(
    rng: Generator, width: int, height: int, tone: tuple[float, float, float], planks: int = 5
) -> Image:
    """Return planks with growth rings, pores and scratches, the grain running along x."""
    out = np.zeros((height, width, 3), dtype=np.float32)
    edges = np.linspace(0, height, planks + 1).astype(int)
    for top, bottom in pairwise(edges):
        h = bottom - top
        y = np.linspace(-1, 1, h, dtype=np.float32)[:, None]
        bend = cv2.resize(noise(rng, width // 8 + 1, h, h / 1.5, 3), (width, h))
        rings = np.sin((y * rng.uniform(1, 3) + 1.1 * bend + rng.uniform(0, 9)) * 16)
        fibres = cv2.resize(
            rng.standard_normal((h, width // 24 + 1)).astype(np.float32), (width, h)
        )
        fine = cv2.resize(rng.standard_normal((h, width // 6 + 1)).astype(np.float32), (width, h))
        pores = cv2.resize(rng.random((h, width // 40 + 1)).astype(np.float32), (width, h)) > 0.985
        value = 1 + 0.075 * rings + 0.035 * fibres + 0.03 * fine - 0.22 * pores
        value *= 1 + 0.07 * rng.standard_normal() + 0.06 * noise(rng, width, h, width / 6)
        yellower = 1 - (0.05 * rings).astype(np.float64)
        for channel, colour in enumerate(tone):
            plane = value * colour
            out[top:bottom, :, channel] = plane * yellower if channel == 2 else plane
        out[top : top + 2] *= 0.45
    for _ in range(60):
        a = rng.uniform(0, [width, height])
        b = a + rng.normal(0, width / 25, 2)
        shade = tuple(float(c) for c in np.array(tone) * rng.uniform(0.7, 1.25))
        cv2.line(out, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), shade, 1, cv2.LINE_AA)
    for _ in range(4):
        centre = rng.uniform(0, [width, height]).astype(int)
        radius = int(width * rng.uniform(0.012, 0.02))
        _stain(out, (int(centre[0]), int(centre[1])), radius)
    return _image(out)


def _stain(out: np.ndarray, centre: tuple[int, int], radius: int) -> None:
    """Darken [H, W, 3] floats along a soft ring, as a cup leaves it, in place."""
    thickness, blur = max(radius // 8, 1), 1.5
    reach = radius + thickness + ceil(BLUR_REACH * blur)  # all else stays as it is
    left, top = (max(place - reach, 0) for place in centre)
    part = out[top : centre[1] + reach + 1, left : centre[0] + reach + 1]
    ring = np.zeros(part.shape[:2], dtype=np.float32)
    cv2.circle(ring, (centre[0] - left, centre[1] - top), radius, 1.0, thickness)
    part *= 1 - 0.13 * cv2.GaussianBlur(ring, (0, 0), blur)[..., None]


def cutting_mat(rng: Generator, width_cm: int, depth_cm: int, density: int) -> Image:
    """Return a cutting mat with its grid in centimetres, numbers, angles and cuts."""
    w, h = width_cm * density, depth_cm * density
    ink, base = (206, 214, 160), (33, 92, 76)
    sheet = Sheet(w, h, base)
    m = density
    for k in range(width_cm - 1):
        x = m + k * density
        sheet.draw.line((x, m, x, h - m), fill=ink if k % 5 == 0 else (70, 125, 105), width=1)
        sheet.centred(x, m * 0.55, str(k), density * 0.33, ink, "DejaVuSans")
        for tick in range(10):
            xx = x + tick * density / 10
            sheet.draw.line((xx, m, xx, m + density * (0.25 if tick == 5 else 0.14)), fill=ink)
    for k in range(depth_cm - 1):
        y = h - m - k * density
        sheet.draw.line((m, y, w - m, y), fill=ink if k % 5 == 0 else (70, 125, 105), width=1)
        sheet.centred(m * 0.55, y, str(k), density * 0.33, ink, "DejaVuSans")
    for angle in (30, 45, 60):
        reach = min(w, h) - 2 * m
        dx, dy = reach * np.cos(np.radians(angle)), reach * np.sin(np.radians(angle))
        sheet.draw.line((m, h - m, m + dx, h - m - dy), fill=ink, width=1)
        sheet.centred(m + dx * 0.9, h - m - dy * 0.9, f"{angle}°", density * 0.5, ink)
    sheet.text(
        w * 0.6, h * 0.06, "SELF-HEALING CUTTING MAT", density * 0.55, ink, "DejaVuSans-Bold"
    )
    sheet.text(w * 0.6, h * 0.1, f"A3  {phrase(rng, 3)}", density * 0.4, ink)
    out = sheet.array().astype(np.float32)
    for _ in range(90):
        a = rng.uniform(0, [w, h])
        b = a + rng.normal(0, density * 3, 2)
        shade = (22.0, 70.0, 58.0) if rng.random() < 0.7 else (90.0, 140.0, 120.0)
        cv2.line(out, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), shade, 1, cv2.LINE_AA)
    out += 5 * noise(rng, w, h, w / 3)[..., None] + rng.normal(0, 3, (h, w, 1))
    return _image(out)


def cloth(rng: Generator, width: int, height: int, tone: tuple[float, float, float]) -> Image:
    """Return a woven cloth with stripes."""
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    weave = 0.5 * np.sin(x * 1.3) * np.sin(y * 1.3)
    stripes = (np.sin(x / width * 55) > 0.75) | (np.sin(y / height * 38 + 1) > 0.8)
    base = np.where(stripes[..., None], np.array(tone) * 0.55 + 90, np.array(tone))
    value = 1 + 0.12 * weave + 0.06 * rng.standard_normal((height, width))
    return _image(base * value[..., None] + 8 * noise(rng, width, height, width / 3)[..., None])


def cardboard(rng: Generator, width: int, height: int) -> Image:
    """Return brown cardboard with print, tape and flutes shining through."""
    sheet = Sheet(width, height, (176, 140, 98))
    ink = (70, 50, 38)
    sheet.text(
        width * 0.08, height * 0.1, phrase(rng, 2).upper(), height * 0.15, ink, "DejaVuSans-Bold"
    )
    sheet.text(
        width * 0.08,
        height * 0.3,
        f"QTY {rng.integers(2, 99)}  {phrase(rng, 3)}",
        height * 0.07,
        ink,
    )
    sheet.draw.rectangle(
        (width * 0.62, height * 0.5, width * 0.93, height * 0.9), fill=(232, 230, 224)
    )
    for k in range(6):
        y = height * (0.53 + 0.055 * k)
        sheet.text(width * 0.64, y, phrase(rng, 3), height * 0.035, (30, 30, 30))
    sheet.draw.rectangle((0, height * 0.42, width, height * 0.48), fill=(190, 160, 112))
    out = sheet.array().astype(np.float32)
    flutes = 3.0 * np.sin(np.arange(width) * 2 * np.pi / 9)[None, :, None]
    out += (
        flutes + rng.normal(0, 5, (height, width, 1)) + 7 * noise(rng, width, height, 80)[..., None]
    )
    return _image(out)


def plaster(rng: Generator, width: int, height: int, tone: tuple[float, float, float]) -> Image:
    """Return a painted wall with roller marks and stains."""
    coarse = noise(rng, width, height, width / 5)
    fine = noise(rng, width, height, 12, 3)
    return _image(np.array(tone) * (1 + 0.035 * coarse + 0.03 * fine)[..., None])


def smudged(rng: Generator, width: int, height: int, tone: tuple[float, float, float]) -> Image:
    """Return paint or anodised metal as it looks after use: scratches, dust, finger marks."""
    out = np.array(tone) * (1 + 0.06 * noise(rng, width, height, width / 3)[..., None])
    out = np.ascontiguousarray(out, dtype=np.float32)
    for _ in range(40):
        a = rng.uniform(0, [width, height])
        b = a + rng.normal(0, width / 12, 2)
        shade = tuple(float(min(c * rng.uniform(0.75, 1.5), 255)) for c in tone)
        cv2.line(out, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), shade, 1, cv2.LINE_AA)
    return _image(out + rng.normal(0, 2.5, (height, width, 1)))


def bark(rng: Generator, width: int, height: int) -> Image:
    """Return furrowed bark, its furrows along y, with moss."""
    furrows = cv2.resize(noise(rng, width, 128, 20), (width, height))
    fibres = cv2.resize(
        rng.standard_normal((height // 4, width)).astype(np.float32), (width, height)
    )
    value = 1 + 0.35 * furrows + 0.15 * noise(rng, width, height, 14) + 0.12 * fibres
    moss = np.clip(noise(rng, width, height, width / 8) - 0.3, 0, 1)[..., None]
    tone = (1 - moss) * np.array((104, 84, 66)) + moss * np.array((88, 104, 52))
    return _image(value[..., None] * tone)


def granite(rng: Generator, width: int, height: int, tone: tuple[float, float, float]) -> Image:
    """Return dull, speckled stone with stains."""
    value = 1 + 0.25 * noise(rng, width, height, width / 12)
    value += 0.18 * noise(rng, width, height, 8) + 0.1 * rng.standard_normal((height, width))
    return _image(value[..., None] * np.array(tone))


def fallen_leaves(rng: Generator, width: int, height: int, leaves: int) -> Image:
    """Return earth under that many leaves of four tones."""
    value = 1 + 0.3 * noise(rng, width, height, 50) + 0.35 * noise(rng, width, height, 9)
    image = _image(value[..., None] * np.array((92, 86, 50)))
    tones = np.array([(134, 92, 44), (96, 112, 48), (168, 128, 66), (70, 58, 40)])
    for _ in range(leaves):
        x, y = rng.uniform(0, [width, height])
        long, wide, turn = rng.uniform(4, 16), rng.uniform(2, 7), rng.uniform(0, 180)
        tone = tones[rng.integers(len(tones))] * rng.uniform(0.6, 1.2)
        shade = tuple(float(c) for c in tone)
        cv2.ellipse(
            image, ((float(x), float(y)), (2 * long, 2 * wide), turn), shade, -1, cv2.LINE_AA
        )
    return image


def foliage(rng: Generator, width: int, height: int) -> Image:
    """Return undergrowth seen from afar."""
    value = 1 + 0.4 * noise(rng, width, height, 30) + 0.4 * noise(rng, width, height, 6)
    return _image(value[..., None] * np.array((64, 80, 44)))

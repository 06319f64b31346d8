"""Printed matter: text, pictures, pages, newspapers, posters, covers, labels.

All functions draw with a generator given to them and return [H, W, 3] uint8 sRGB images; the fonts
are those that Matplotlib ships, so the same seed draws the same page everywhere.
"""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.random import Generator
from PIL import Image as PilImage
from PIL import ImageDraw, ImageFont

from mattgs_ops.synthetic.surfaces.materials import Image, rgb

TEXT = (
    "servo motor torque board signal clock power ground sensor wheel axle bracket panel gear"
    " torque output input digital analog header voltage current limit supply battery charge"
    " control loop sample filter image camera depth point cloud pose map robot field test garden"
    " river market council winter harbour bridge station morning city paper season league final"
    " record library school music theatre coffee island engine summer report about after between"
    " within under without during against toward across every other and the of to in for with on"
    " from by at as is was has are will can not new long high"
)
WORDS = np.array(TEXT.split())  # an array: a list is made into one for every word drawn
Rgb = tuple[int, int, int]


@cache
def font(size: int, face: str = "DejaVuSans") -> ImageFont.FreeTypeFont:
    """Return a font that Matplotlib ships, ``size`` pixels high."""
    import matplotlib

    path = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / f"{face}.ttf"
    return ImageFont.truetype(str(path), max(size, 4))


class Sheet:
    """A drawing surface of ``width`` × ``height`` pixels."""

    def __init__(self, width: int, height: int, paper: Rgb) -> None:
        self.image = PilImage.new("RGB", (width, height), paper)
        self.draw = ImageDraw.Draw(self.image)
        self.width, self.height = width, height

    def text(
        self, x: float, y: float, words: str, size: float, ink: Rgb, face: str = "DejaVuSans"
    ) -> float:
        """Write a line with its top left at (x, y); return its length in pixels."""
        letters = font(round(size), face)
        self.draw.text((x, y), words, fill=ink, font=letters)
        return float(letters.getlength(words))

    def centred(
        self, x: float, y: float, words: str, size: float, ink: Rgb, face: str = "DejaVuSans-Bold"
    ) -> None:
        """Write a line centred on (x, y)."""
        self.draw.text((x, y), words, fill=ink, font=font(round(size), face), anchor="mm")

    def paste(self, picture: Image, x: float, y: float) -> None:
        """Put an image with its top left at (x, y)."""
        self.image.paste(PilImage.fromarray(picture), (round(x), round(y)))

    def array(self) -> Image:
        """Return the drawing, [H, W, 3] uint8."""
        return np.asarray(self.image).copy()


def phrase(rng: Generator, count: int) -> str:
    """Return ``count`` words."""
    return " ".join(rng.choice(WORDS) for _ in range(count))


def paragraph(
    sheet: Sheet,
    rng: Generator,
    box: tuple[float, float, float, float],
    size: float,
    ink: Rgb = (45, 44, 43),
    face: str = "DejaVuSerif",
) -> None:
    """Fill a box (left, top, right, bottom) with justified-looking lines of words."""
    left, top, right, bottom = box
    letters = font(round(size), face)
    space = letters.getlength(" ")
    y = top
    while y + size < bottom:
        x = left
        if rng.random() < 0.12:
            x += 2.5 * size
        end = right - (rng.random() * 0.6 * (right - left) if rng.random() < 0.12 else 0)
        while True:
            word = str(rng.choice(WORDS))
            length = letters.getlength(word)
            if x + length > end:
                break
            sheet.draw.text((x, y), word, fill=ink, font=letters)
            x += length + space
        y += size * 1.35


def noise(rng: Generator, width: int, height: int, scale: float, octaves: int = 4) -> np.ndarray:
    """Return fractal value noise [H, W] float32 in about -1..1; ``scale`` pixels per first cell."""
    out = np.zeros((height, width), dtype=np.float32)
    for octave in range(octaves):
        cell = max(scale / 2**octave, 1.0)
        grid = rng.standard_normal((int(height / cell) + 3, int(width / cell) + 3))
        layer = cv2.resize(grid.astype(np.float32), None, fx=cell, fy=cell, interpolation=2)
        out += layer[:height, :width] / 2**octave
    return out / 2


def picture(rng: Generator, width: int, height: int, *, grey: bool = False) -> Image:
    """Return something that reads as a photo from afar: sky, hills, buildings, trees, lights."""
    sky = np.array([[120, 160, 205], [205, 150, 110], [90, 110, 140], [180, 195, 205]])
    top = sky[rng.integers(4)] + rng.normal(0, 12, 3)
    fade = np.linspace(0, 1, height)[:, None]
    haze = 14 * noise(rng, width, height, width / 3)
    # a plane for each colour: NumPy is several times slower where the last axis is three long
    planes = [(1 - fade) * tone + fade * (tone * 0.3 + 170) + haze for tone in top]
    for layer in range(3):
        crest = height * (0.35 + 0.17 * layer) + 0.12 * height * noise(rng, width, 1, width / 4)[0]
        below = np.arange(height)[:, None] > crest[None]
        tones = rng.uniform(30, 130, 3) * (1 - 0.2 * layer)
        grain = 1 + 0.35 * noise(rng, width, height, 18)
        for plane, tone in zip(planes, tones, strict=True):
            np.copyto(plane, tone * grain, where=below)
    sheet = PilImage.fromarray(_image(planes))
    draw = ImageDraw.Draw(sheet)
    for _ in range(int(rng.integers(4, 14))):
        x, w = rng.uniform(0, width), rng.uniform(0.02, 0.12) * width
        h, base = rng.uniform(0.1, 0.5) * height, rng.uniform(0.7, 1.0) * height
        colour = rgb(rng.uniform(25, 215, 3))
        if rng.random() < 0.6:
            draw.rectangle((x, base - h, x + w, base), fill=colour)
            for row in np.arange(base - h + 3, base - 3, 6):
                for column in np.arange(x + 2, x + w - 2, 5):
                    lit = (235, 220, 160) if rng.random() < 0.4 else (35, 38, 45)
                    draw.rectangle((column, row, column + 2, row + 3), fill=lit)
        else:
            draw.ellipse((x, base - h, x + w * 1.6, base - h * 0.3), fill=colour)
    image = np.asarray(sheet)
    strays = rng.normal(0, 5, (height, width))
    planes = [image[..., channel] + strays for channel in range(3)]
    if grey:
        planes = [(planes[0] + planes[1] + planes[2]) / 3] * 3
    return _image(planes)


def _image(planes: list[np.ndarray]) -> Image:
    """Return three planes [H, W] of red, green and blue as an image."""
    return np.stack([np.clip(plane, 0, 255).astype(np.uint8) for plane in planes], axis=2)


def aged(image: Image, rng: Generator, amount: float = 1.0) -> Image:
    """Return the sheet with folds, blotches and the paper's grain."""
    height, width = image.shape[:2]
    tone = 5 * noise(rng, width, height, width / 2) + rng.normal(0, 2.0, (height, width))
    for _ in range(2):
        at = int(rng.uniform(0.2, 0.8) * width)
        tone[:, max(at - 2, 0) : at + 2] -= 9
        tone[:, at + 2 : at + 4] += 6
    tone *= amount
    return _image([image[..., 0] + tone, image[..., 1] + tone, image[..., 2] + tone * 1.15])


def newspaper(rng: Generator, width: int, height: int) -> Image:
    """Return a front page: masthead, headlines, columns, grey and coloured pictures."""
    paper: Rgb = (222, 216, 203)
    sheet = Sheet(width, height, paper)
    margin, ink = width * 0.035, (38, 36, 36)
    title = str(rng.choice(["THE EVENING HERALD", "DAILY COURIER", "MORNING POST", "THE GAZETTE"]))
    sheet.centred(width / 2, height * 0.045, title, width * 0.072, ink, "DejaVuSerif-Bold")
    sheet.draw.line((margin, height * 0.085, width - margin, height * 0.085), fill=ink, width=3)
    sheet.text(
        margin, height * 0.09, "No. 18,402     Saturday edition     1.60", width * 0.016, ink
    )
    head = phrase(rng, 4).capitalize()
    sheet.text(margin, height * 0.115, head, width * 0.055, ink, "DejaVuSerif-Bold")
    columns, top = 5, height * 0.185
    pitch = (width - 2 * margin) / columns
    used = [top] * columns
    for _ in range(4):
        span, start = int(rng.integers(1, 4)), int(rng.integers(0, columns))
        start = min(start, columns - span)
        y = max(used[start : start + span])
        w, h = int(span * pitch - 10), int(pitch * rng.uniform(0.6, 1.1))
        if y + h + 40 < height - margin:
            sheet.paste(picture(rng, w, h, grey=rng.random() < 0.5), margin + start * pitch, y)
            for column in range(start, start + span):
                if y > used[column] + 20:
                    x = margin + column * pitch
                    paragraph(sheet, rng, (x, used[column], x + pitch - 12, y - 6), width * 0.0125)
                used[column] = y + h + 8
    for column in range(columns):
        x = margin + column * pitch
        y = used[column]
        sheet.text(x, y, phrase(rng, 2).capitalize(), width * 0.021, ink, "DejaVuSerif-Bold")
        body = (x, y + width * 0.03, x + pitch - 12, height - margin)
        paragraph(sheet, rng, body, width * 0.0125)
    return aged(sheet.array(), rng)


def page(rng: Generator, width: int, height: int) -> Image:
    """Return a data sheet: title, paragraphs, a plot, a table."""
    sheet = Sheet(width, height, (236, 235, 230))
    margin, ink = width * 0.08, (40, 40, 44)
    accent = rgb(rng.uniform(20, 160, 3))
    sheet.draw.rectangle((margin, margin * 0.55, width - margin, margin * 0.75), fill=accent)
    title = f"{phrase(rng, 2).title()} {rng.integers(100, 9999)}"
    sheet.text(margin, margin, title, width * 0.045, ink, "DejaVuSans-Bold")
    small = width * 0.0165
    middle, y = width / 2, height * 0.13
    paragraph(sheet, rng, (margin, y, middle - 8, height * 0.45), small)
    box = (middle + 12, y + 8, width - margin, height * 0.36)
    sheet.draw.rectangle(box, outline=ink, width=2)
    xs = np.linspace(box[0], box[2], 80)
    for colour in ((190, 40, 40), (30, 80, 170), (30, 130, 60)):
        wave = np.cumsum(rng.normal(0, 0.05, 80)) + 0.5
        wave = (wave - wave.min()) / (np.ptp(wave) + 1e-6) * 0.85 + 0.07
        ys = box[3] - wave * (box[3] - box[1])
        sheet.draw.line(list(zip(xs.tolist(), ys.tolist(), strict=True)), fill=colour, width=2)
    for k in range(1, 6):
        gy = box[1] + (box[3] - box[1]) * k / 6
        sheet.draw.line((box[0], gy, box[2], gy), fill=(190, 190, 190))
    paragraph(sheet, rng, (middle + 12, height * 0.38, width - margin, height * 0.45), small)
    top, rows = height * 0.48, 14
    step = height * 0.017
    for row in range(rows + 1):
        yy = top + row * step * 1.25
        if row % 2 == 0:
            sheet.draw.rectangle(
                (margin, yy, width - margin, yy + step * 1.25), fill=(218, 220, 224)
            )
        for column in range(5):
            value = phrase(rng, 1) if column == 0 or row == 0 else f"{rng.uniform(0, 400):.2f}"
            face = "DejaVuSans-Bold" if row == 0 else "DejaVuSansMono"
            sheet.text(margin + 6 + column * (width - 2 * margin) / 5, yy, value, small, ink, face)
    paragraph(sheet, rng, (margin, height * 0.82, width - margin, height * 0.95), small)
    return aged(sheet.array(), rng, 0.6)


def cover(rng: Generator, width: int, height: int) -> Image:
    """Return a magazine's or book's cover, or a poster: a picture, a big title, small lines."""
    out = Sheet(width, height, rgb(rng.uniform(20, 235, 3)))
    if rng.random() < 0.75:
        out.paste(picture(rng, width, int(height * 0.7)), 0, height * 0.3)
    for _ in range(int(rng.integers(2, 6))):
        x, y, r = rng.uniform(0, width), rng.uniform(0, height), rng.uniform(0.03, 0.16) * width
        colour = rgb(rng.uniform(10, 250, 3))
        out.draw.ellipse(
            (x - r, y - r, x + r, y + r), fill=colour, outline=(240, 240, 235), width=3
        )
    ink: Rgb = (245, 243, 235) if rng.random() < 0.6 else (25, 25, 30)
    out.draw.rectangle((0, 0, width, height * 0.2), fill=rgb(rng.uniform(20, 200, 3)))
    out.text(
        width * 0.05, height * 0.03, phrase(rng, 1).upper(), width * 0.15, ink, "DejaVuSans-Bold"
    )
    out.text(width * 0.05, height * 0.15, phrase(rng, 4), width * 0.04, ink)
    for k in range(6):
        y = height * (0.32 + 0.1 * k)
        out.text(width * 0.05, y, phrase(rng, 3).title(), width * 0.048, ink, "DejaVuSans-Bold")
        out.text(width * 0.05, y + width * 0.06, phrase(rng, 5), width * 0.028, ink)
    return aged(out.array(), rng, 0.7)


def label(
    lines: list[str],
    width: int,
    height: int,
    paper: Rgb,
    ink: Rgb,
    *,
    bars: Generator | None = None,
) -> Image:
    """Return a label with centred lines, the first one large, and with ``bars`` a bar code."""
    sheet = Sheet(width, height, paper)
    usable = height * (0.72 if bars is not None else 0.94)
    weights = [1.7] + [1.0] * (len(lines) - 1)
    y = height * 0.03
    for line, weight in zip(lines, weights, strict=True):
        tall = usable * weight / sum(weights)
        size = min(tall * 0.86, 1.5 * width / max(len(line), 1))
        sheet.centred(width / 2, y + tall / 2, line, size, ink)
        y += tall
    if bars is not None:
        x = width * 0.1
        while x < width * 0.9:
            w = float(bars.integers(1, 5)) * width / 220
            sheet.draw.rectangle((x, height * 0.78, x + w, height * 0.95), fill=ink)
            x += w + float(bars.integers(1, 4)) * width / 160
    return sheet.array()

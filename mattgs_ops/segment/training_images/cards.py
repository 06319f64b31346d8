"""Cards beside an object, as photogrammetry lays them out: coded targets, charts, scale bars.

They are small, flat, sharp and of more contrast than anything else in a photo, so that a network
that has never seen them takes them for a part of what they lie beside. They are painted on finished
training images, behind the object, and are not part of its mask.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

CELL = 8  # pixels of a drawn card's smallest cell
MOST = 8  # cards beside one object
SIDES = (0.03, 0.16)  # of a card, as a share of the image's shorter side
FLATTEST = 0.3  # of the lengths of a card seen from low above the ground
AWAY = 1.5  # farthest a card's middle lies from the object, as a share of the object's width
STEPS = 7  # shades of a scale of grey or of colours


def lay_cards(rng: np.random.Generator, image: Image, mask: Image) -> Image:
    """Return the image [H, W, 3] with one to eight cards around the object of the mask [H, W]."""
    inside = mask > 127
    if not inside.any() or inside.all():
        return image
    away = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 3)
    width = float(np.sqrt(inside.sum()))
    ground = _ground(rng)
    laid = image.copy()
    kind = int(rng.integers(len(KINDS)))
    for _ in range(int(rng.integers(1, MOST + 1))):
        side = float(rng.uniform(*SIDES)) * min(mask.shape)
        spots = np.flatnonzero((away > 0.4 * side) & (away < max(AWAY * width, side)))
        if spots.size == 0:
            continue
        y, x = np.unravel_index(int(rng.choice(spots)), mask.shape)
        if rng.random() < 0.2:  # most captures have one kind
            kind = int(rng.integers(len(KINDS)))
        _paint(laid, KINDS[kind](rng), np.array([x, y], float), side, ground, rng)
    share = mask[..., None].astype(np.float32) / 255
    return np.asarray(image * share + laid * (1 - share), dtype=np.uint8)


def _ground(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return how the ground's directions lie in the image [2, 2]: foreshortened, then turned."""
    angle = rng.normal(0, 0.15)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]]) @ np.diag([1.0, rng.uniform(FLATTEST, 1.0)])


def _paint(
    image: Image,
    card: Image,
    middle: NDArray[np.float64],
    side: float,
    ground: NDArray[np.float64],
    rng: np.random.Generator,
) -> None:
    """Paint a card into the image, turned on the ground, as bright as what it lies on."""
    height, width = card.shape[:2]
    angle = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    turn = side / min(height, width) * ground @ np.array([[c, -s], [s, c]])
    shift = middle - turn @ np.array([width, height]) / 2
    matrix = np.concatenate([turn, shift[:, None]], axis=1)
    size = (image.shape[1], image.shape[0])
    shown = cv2.warpAffine(card, matrix, size, flags=cv2.INTER_AREA)
    solid = cv2.warpAffine(np.full((height, width), 255, np.uint8), matrix, size)
    under = image[solid > 0]
    if under.size == 0:
        return
    bright = float(np.clip(under.mean() / 255 * rng.uniform(1.0, 2.5), 0.1, 1.0))
    share = solid[..., None].astype(np.float32) / 255
    image[:] = (image * (1 - share) + shown * bright * share).astype(np.uint8)


def _coded_square(rng: np.random.Generator) -> Image:
    """Draw a square code in a black frame on white, as ArUco's and AprilTag's are."""
    cells = int(rng.integers(4, 8))
    code = np.zeros((cells + 2, cells + 2), np.uint8)
    code[1:-1, 1:-1] = 255 * rng.integers(0, 2, (cells, cells))
    return _enlarged(np.pad(code, int(rng.integers(0, 2)), constant_values=255))


def _ring(rng: np.random.Generator) -> Image:
    """Draw a dot in a broken ring, as circular coded targets are; at times white on black."""
    side = 12 * CELL
    card = np.full((side, side), 255, np.uint8)
    centre, start = (side // 2, side // 2), float(rng.uniform(0, 360))
    cv2.circle(card, centre, side // 8, 0, -1)
    for k in range(12):
        if rng.random() < 0.5:
            first = start + 30 * k
            cv2.ellipse(card, centre, (side // 3, side // 3), 0, first, first + 30, 0, side // 8)
    return _coloured(card if rng.random() < 0.7 else 255 - card)


def _scale_bar(rng: np.random.Generator) -> Image:
    """Draw a bar of fields that are dark and light in turn, with a white rim."""
    fields = int(rng.integers(3, 11))
    bar = np.tile(np.array([0, 255], np.uint8), fields)[None, :fields]
    if rng.random() < 0.5:
        bar = np.concatenate([bar, 255 - bar])
    return _enlarged(np.pad(np.repeat(bar, 2, axis=1), 1, constant_values=255))


def _chart(rng: np.random.Generator) -> Image:
    """Draw a chart of colours, or a scale of greys, on black, grey or white."""
    rows = int(rng.integers(1, 5))
    colours = rng.integers(10, 246, (rows, STEPS, 3)).astype(np.uint8)
    if rng.random() < 0.4:
        colours = np.tile(np.linspace(20, 240, STEPS).astype(np.uint8)[None, :, None], (rows, 1, 3))
    tiles = np.kron(colours, np.ones((2 * CELL, 2 * CELL, 1), np.uint8))
    paper = int(rng.choice([15, 120, 235]))
    tiles[:: 2 * CELL], tiles[:, :: 2 * CELL] = paper, paper
    rim = ((CELL, CELL), (CELL, CELL), (0, 0))
    return np.asarray(np.pad(tiles, rim, constant_values=paper), dtype=np.uint8)


def _quarters(rng: np.random.Generator) -> Image:
    """Draw a disc or a square of four quarters, black and white in turn."""
    side = 8 * CELL
    y, x = np.indices((side, side)) - (side - 1) / 2
    card = np.where((x > 0) ^ (y > 0), 0, 255)
    if rng.random() < 0.5:
        card = np.where(np.hypot(x, y) < 0.45 * side, card, 255)
    return _coloured(card.astype(np.uint8))


def _enlarged(cells: NDArray[np.uint8]) -> Image:
    return _coloured(np.kron(cells, np.ones((CELL, CELL), np.uint8)))


def _coloured(card: NDArray[np.uint8]) -> Image:
    return np.repeat(card[..., None], 3, axis=2)


KINDS = (_coded_square, _coded_square, _ring, _scale_bar, _chart, _quarters)

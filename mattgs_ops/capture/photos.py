"""One photo on disk: find it, refuse what later stages would misread, decode it upright.

A photo is an 8-bit colour picture (JPEG, PNG, TIFF, WebP or BMP), with straight alpha or without.
COLMAP and ONNX Runtime skip or quietly misread anything else, so it is refused here, by name, with
what to do about it. Decoding applies the EXIF orientation once; nothing downstream looks at it.
"""

import struct
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image, UnidentifiedImageError

from mattgs_ops.capture.camera import sizes_of_their_own
from mattgs_ops.capture.formats.exif import exif_focal, exif_lens
from mattgs_ops.capture.formats.not_read import advice
from mattgs_ops.capture.formats.split_lists import LIST_FILES, NERF_LISTS
from mattgs_ops.errors import InputError, StageError
from mattgs_ops.naming import listed_names, numbers_by_value

FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP")
SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", ".mpo"})
# Files that operating systems and other tools leave beside photos; everything else is named.
SYSTEM_FILES = frozenset({"thumbs.db", "desktop.ini"})
IGNORED_FILES = SYSTEM_FILES | {"transforms.json"} | LIST_FILES
# What phones, editors and Google Takeout write about a photo: IMG_1.AAE, IMG_1.xmp, IMG_1.jpg.json
NOTES = ("", ".supplemental-metadata")
SIDECARS = (".aae", ".xmp", *(f"{kind}{note}.json" for kind in SUFFIXES for note in NOTES))
IGNORED_FOLDERS = frozenset({"masks", "sparse"})
OUTPUT_MARK = ".mattgs-out"  # an empty file in folders of our own output
PNG_BIT_DEPTH_OFFSET = 24  # byte of IHDR, PNG specification section 11.2.2
TIFF_BITS_PER_SAMPLE = 258
NAMED = 8  # photos in one sentence
UPRIGHT, SIDEWAYS = 1, frozenset({5, 6, 7, 8})  # EXIF 2.32, orientation
# What Pillow raises for files that are damaged, a few of which only its own format's code does
BROKEN = (OSError, SyntaxError, ValueError, TypeError, LookupError, struct.error)
UNREADABLE = (*BROKEN, Image.DecompressionBombError)
TURNS = {  # EXIF 2.32, orientation: how pixels as stored become upright
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
# Stands for the slash in the name of a view whose photo lies in a folder of its own: later stages
# keep all views of a capture in one folder.
FOLDER_MARK = "__"
LONGEST_NAME = 251  # bytes; stages add `.png`, and file systems end at 255


@dataclass(frozen=True)
class Photo:
    """A decoded photo: ``rgb`` [H, W, 3] uint8; ``alpha`` [H, W] uint8, straight, or None.

    ``focal`` is the focal length in pixels that its EXIF tells, None where it tells none; ``lens``
    is what EXIF says of the camera, empty where it says nothing.
    """

    rgb: NDArray[np.uint8]
    alpha: NDArray[np.uint8] | None
    focal: float | None = None
    lens: str = ""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels, upright."""
        return self.rgb.shape[1], self.rgb.shape[0]


def list_photos(folder: Path, masks: Path | None = None) -> tuple[list[Path], list[str]]:
    """Return the files of ``folder`` that should be photos, sorted by name, and the problems.

    Folders within are read too; numbers in names count by their value. Hidden files and folders,
    :data:`IGNORED_FILES`, :data:`SIDECARS`, NeRF's lists among photos, folders ``masks/`` and
    ``sparse/``, our own output, and the folder ``masks`` that the user named are passed over. Any
    other file that is not an image is a problem: photos that are silently left out would change the
    split.
    """
    photos, problems = [], []
    for path in sorted(_files(folder, masks, set()), key=lambda p: numbers_by_value(str(p))):
        lower = path.name.lower()
        if lower in IGNORED_FILES or lower.endswith(SIDECARS) or _lists_photos_beside(path):
            continue
        named = _name_problem(path, folder)
        if named:
            problems.append(named)
        elif path.suffix.lower() in SUFFIXES or _is_image(path):
            photos.append(path)
        else:
            problems.append(
                f"{path}: not an image; remove it or move it to another folder{advice(lower)}"
            )
    return photos, problems


def perhaps_cropped(
    sizes: Mapping[str, tuple[int, int]], mended: Collection[str] = ()
) -> list[str]:
    """Name photos whose (width, height) no other has, either way up, in a sentence; [] if none.

    The lens's axis meets the middle of a picture as the camera took it, but not of a part of it.
    Photos that were cropped to shapes of their own give themselves away by that. Those whose axis
    was found (``mended``) are left out.
    """
    names, alone = list(sizes), sizes_of_their_own(list(sizes.values()))
    found = [names[place] for place in alone if names[place] not in mended]
    if not found:
        return []
    told = f"{len(found)} have a size that no other photo has: {listed_names(found, NAMED)}"
    return [f"{told}; if they are cropped, their cameras may be wrong: use them as they were taken"]


def mark_output(folder: Path) -> None:
    """Mark a folder as our own output: it may lie among the photos, and holds none."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / OUTPUT_MARK).touch()


def _files(folder: Path, masks: Path | None, seen: set[Path]) -> Iterator[Path]:
    """Yield files that are not hidden; ``seen`` keeps links to folders from leading in circles."""
    real = folder.resolve()
    if real in seen or (masks is not None and real == masks.resolve()):
        return
    seen.add(real)
    for path in folder.iterdir():
        if path.name.startswith("."):
            continue
        if not path.is_dir():
            yield path
        elif path.name.lower() not in IGNORED_FOLDERS and not (path / OUTPUT_MARK).is_file():
            yield from _files(path, masks, seen)


def exif_orientation(path: Path) -> int:
    """Return how the file asks to be turned or mirrored, ``UPRIGHT`` if it does not."""
    with Image.open(path, formats=FORMATS) as image:
        return image.getexif().get(ExifTags.Base.Orientation, 0) or UPRIGHT


def decode(path: Path, *, as_stored: bool = False) -> Photo:
    """Decode a photo upright, or ``as_stored``; an alpha channel that is opaque counts as none.

    Raises :class:`InputError` naming the file and what to do.
    """
    try:
        with Image.open(path, formats=FORMATS) as image:
            _refuse_unsuitable(path, image)
            turned = image if as_stored else upright(image)
            transparent = turned.has_transparency_data
            focal, lens = exif_focal(image.getexif(), image.size), exif_lens(image.getexif())
            pixels = np.asarray(turned.convert("RGBA" if transparent else "RGB"))
    except UnidentifiedImageError as error:
        raise InputError(
            f"{path}: cannot be read as an image; replace it by an intact copy or remove it"
        ) from error
    except Image.DecompressionBombError as error:
        raise InputError(f"{path}: too large to be read ({error}); reduce it") from error
    except UNREADABLE as error:
        raise InputError(
            f"{path}: damaged or cut short ({error}); replace it by an intact copy or remove it"
        ) from error
    rgb = np.ascontiguousarray(pixels[..., :3])
    alpha = np.ascontiguousarray(pixels[..., 3]) if transparent else None
    if alpha is not None and bool((alpha == 255).all()):
        alpha = None
    if alpha is None and _has_no_colour(rgb):
        raise InputError(_grey(path))
    return Photo(rgb, alpha, focal, lens)


def upright(image: Image.Image) -> Image.Image:
    """Return an image turned as its EXIF asks for.

    Pillow's ``exif_transpose`` also writes all EXIF anew, which ends in an error where a camera or
    a program has left a tag of the wrong type.
    """
    image.load()  # a TIFF is turned then, and asks for nothing any more
    turn = TURNS.get(image.getexif().get(ExifTags.Base.Orientation, UPRIGHT))
    return image if turn is None else image.transpose(turn)


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Read a photo that a stage has written, [H, W, 3] RGB as stored.

    Raises :class:`InputError` naming the file.
    """
    bgr = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if bgr is None:
        raise InputError(f"{path}: expected a readable photo, found something else")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def write_png(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write a photo [H, W, 3] RGB, or a mask or map [H, W], lossless; folders are made.

    OpenCV takes half of Pillow's time. Raises :class:`StageError` with the reason when that fails.
    """
    stored = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR)
    try:  # OpenCV itself would not say why it cannot write a file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(cv2.imencode(".png", stored)[1].data)
    except OSError as error:
        raise StageError(f"{path}: could not be written: {error.strerror}") from error


def on_white(photo: Photo) -> NDArray[np.uint8]:
    """Composite straight alpha over white, rounded to 8 bits: ``a * rgb + (1 - a) * 255``."""
    if photo.alpha is None:
        return photo.rgb
    alpha = photo.alpha[..., None].astype(np.uint32)
    blend = photo.rgb * alpha + 255 * (255 - alpha)
    return ((blend + 127) // 255).astype(np.uint8)


def bit_depth(path: Path, image: Image.Image) -> int:
    """Bits per channel as stored; Pillow alone would cut 16-bit colour to 8 without a word."""
    if image.mode.startswith(("I", "F")):
        return 32 if image.mode in ("I", "F") else 16
    if image.format == "PNG":
        with path.open("rb") as file:
            return max(8, file.read(PNG_BIT_DEPTH_OFFSET + 1)[PNG_BIT_DEPTH_OFFSET])
    if image.format == "TIFF":
        bits = image.tag_v2.get(TIFF_BITS_PER_SAMPLE, (8,))  # type: ignore[attr-defined]
        return int(max(bits))
    return 8


def _refuse_unsuitable(path: Path, image: Image.Image) -> None:
    depth = bit_depth(path, image)
    if depth > 8:
        raise InputError(f"{path}: {depth} bits per channel; save it with 8 bits per channel")
    if image.mode in ("1", "L", "LA", "La"):
        raise InputError(_grey(path))
    if image.mode == "CMYK":
        raise InputError(f"{path}: CMYK colours; save it as RGB")
    frames = getattr(image, "n_frames", 1)
    if frames > 1 and image.format != "MPO":  # phones store a preview as an MPO's second picture
        raise InputError(f"{path}: holds {frames} pictures; save one picture per file")


def _grey(path: Path) -> str:
    return f"{path}: a grey photo; colour is needed: replace it by the colour original or remove it"


def _has_no_colour(rgb: NDArray[np.uint8]) -> bool:
    return bool((rgb[..., 0] == rgb[..., 1]).all() and (rgb[..., 1] == rgb[..., 2]).all())


def _is_image(path: Path) -> bool:
    try:
        with Image.open(path, formats=FORMATS):
            return True
    except UNREADABLE:  # UnidentifiedImageError is an OSError
        return False


def _lists_photos_beside(path: Path) -> bool:
    """Whether NeRF's list lies among photos; in NeRF's own layout these lie in folders below."""
    beside = (one.suffix.lower() for one in path.parent.iterdir())
    return path.name in NERF_LISTS.values() and not SUFFIXES.isdisjoint(beside)


def _name_problem(path: Path, folder: Path) -> str:
    """Say what is wrong with a file's name; empty where it can be used."""
    try:
        name = path.relative_to(folder).as_posix().replace("/", FOLDER_MARK).encode()
    except UnicodeEncodeError:  # as from an archive of another system
        return f"{str(path)!a}: its name is not UTF-8; rename it"
    if len(name) > LONGEST_NAME:
        return f"{path}: its name is {len(name)} bytes long with its folders; shorten it"
    return ""

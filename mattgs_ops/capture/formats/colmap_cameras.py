"""COLMAP's camera models: their numbers, their parameters, and what they mean as a lens.

Names, numbers and order of parameters are those of ``src/colmap/sensor/models.h``.
"""

import math
from dataclasses import dataclass

from mattgs_ops.capture.camera import Intrinsics
from mattgs_ops.capture.undistortion import Lens
from mattgs_ops.errors import InputError


@dataclass(frozen=True)
class CameraModel:
    """A camera model that can be read: COLMAP's number and the names of its parameters."""

    number: int
    parameters: tuple[str, ...]
    fisheye: bool = False


_ONE_FOCAL, _TWO_FOCALS = ("f", "cx", "cy"), ("fx", "fy", "cx", "cy")
_BROWN, _RATIONAL = ("k1", "k2", "p1", "p2"), ("k3", "k4", "k5", "k6")
MODELS = {
    "SIMPLE_PINHOLE": CameraModel(0, _ONE_FOCAL),
    "PINHOLE": CameraModel(1, _TWO_FOCALS),
    "SIMPLE_RADIAL": CameraModel(2, (*_ONE_FOCAL, "k1")),
    "RADIAL": CameraModel(3, (*_ONE_FOCAL, "k1", "k2")),
    "OPENCV": CameraModel(4, (*_TWO_FOCALS, *_BROWN)),
    "FULL_OPENCV": CameraModel(6, (*_TWO_FOCALS, *_BROWN, *_RATIONAL)),
    "OPENCV_FISHEYE": CameraModel(5, (*_TWO_FOCALS, "k1", "k2", "k3", "k4"), fisheye=True),
    "SIMPLE_RADIAL_FISHEYE": CameraModel(8, (*_ONE_FOCAL, "k1"), fisheye=True),
    "RADIAL_FISHEYE": CameraModel(9, (*_ONE_FOCAL, "k1", "k2"), fisheye=True),
    "SIMPLE_FISHEYE": CameraModel(14, _ONE_FOCAL, fisheye=True),
    "FISHEYE": CameraModel(15, _TWO_FOCALS, fisheye=True),
}
NAMES = {model.number: name for name, model in MODELS.items()}
# COLMAP's other models; named in refusals of binary files, which hold numbers only
UNREAD = {
    7: "FOV",
    10: "THIN_PRISM_FISHEYE",
    11: "RAD_TAN_THIN_PRISM_FISHEYE",
    12: "SIMPLE_DIVISION",
    13: "DIVISION",
    16: "EUCM",
    17: "EQUIRECTANGULAR",
}
# the orders in which OpenCV takes coefficients
BROWN_ORDER = (*_BROWN, *_RATIONAL)
FISHEYE_ORDER = ("k1", "k2", "k3", "k4")


@dataclass(frozen=True)
class ColmapCamera:
    """Intrinsics under COLMAP's names; ``params`` as COLMAP orders them, pixels."""

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    def lens(self) -> Lens:
        """Return the intrinsics and distortion that the parameters mean."""
        model = MODELS[self.model]
        value = dict(zip(model.parameters, self.params, strict=True))
        fx, fy = (value["f"], value["f"]) if "f" in value else (value["fx"], value["fy"])
        intrinsics = Intrinsics(self.width, self.height, fx, fy, value["cx"], value["cy"])
        return Lens(intrinsics, *coefficients(value, fisheye=model.fisheye))


def coefficients(value: dict[str, float], *, fisheye: bool) -> tuple[tuple[float, ...], bool]:
    """Return a lens's coefficients in OpenCV's order, 0 where one is not given, and the family."""
    order = FISHEYE_ORDER if fisheye else BROWN_ORDER
    return tuple(value.get(name, 0.0) for name in order), fisheye


def checked(camera: ColmapCamera, where: str) -> ColmapCamera:
    """Return the camera; raises :class:`InputError` if its parameters describe no camera."""
    expected = len(MODELS[camera.model].parameters)
    if len(camera.params) != expected:
        raise InputError(
            f"{where}: expected {expected} parameters of {camera.model}, found {len(camera.params)}"
        )
    i = camera.lens().intrinsics
    whole = all(math.isfinite(value) for value in camera.params)
    if not (whole and min(i.width, i.height) > 0 and i.fx > 0 and i.fy > 0):
        raise InputError(
            f"{where}: expected positive width, height and focal length, found "
            f"{i.width}x{i.height} and {i.fx:g}, {i.fy:g}"
        )
    return camera


def unread(model: str, where: str) -> InputError:
    """Return what to say of a camera model that is not read."""
    return InputError(
        f"{where}: camera model {model}: expected one of {', '.join(MODELS)}; undistort the photos "
        "with COLMAP's image_undistorter"
    )

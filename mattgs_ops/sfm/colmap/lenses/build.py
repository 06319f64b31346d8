"""Which views share one of COLMAP's cameras; which lenses no camera has. Worker process only."""

from collections.abc import Collection, Sequence
from typing import Any

from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import StageError
from mattgs_ops.sfm.colmap.job import JobView

FOCAL_GUESS = 1.2  # times the longest side, COLMAP's first guess without EXIF


def build_cameras(views: Sequence[JobView], config: SfmConfig) -> list[Any]:
    """Return each view's pycolmap camera.

    Views share one when they have one given pinhole, or else one size as they were taken and as
    they are used, one orientation, and one camera and focal length in EXIF: so photos of both
    orientations, of a lens that zooms, and of different people get cameras of their own.
    """
    import pycolmap

    shared: dict[tuple[Any, ...], Any] = {}
    out = []
    for view in views:
        size = (view.width, view.height)
        key = (size, view.as_taken, view.intrinsics, view.focal, view.lens)
        if key not in shared:
            number = len(shared) + 1
            if view.intrinsics is None:
                guess = view.focal or FOCAL_GUESS * max(size)
                camera = pycolmap.Camera.create_from_model_name(
                    number, config.camera_model, guess, *size
                )
                camera.has_prior_focal_length = view.focal is not None
            else:
                camera = pycolmap.Camera.create_from_model_name(
                    number, "PINHOLE", view.intrinsics[0], *size
                )
                camera.params = list(view.intrinsics)
                camera.has_prior_focal_length = True
            shared[key] = camera
        out.append(shared[key])
    return out


def check_lenses(model: Any, cropped: Collection[int] = ()) -> None:
    """Raise :class:`StageError` where a lens came out that no camera has, by COLMAP's own bounds.

    Poses beside such a lens are wrong too, however well they explain the matches. The images
    ``cropped`` have lenses of others; their axis may lie beside the photo.
    """
    import pycolmap

    bounds = pycolmap.IncrementalPipelineOptions()
    limits = bounds.min_focal_length_ratio, bounds.max_focal_length_ratio, bounds.max_extra_param
    moved = {model.image(image).camera_id for image in cropped}
    for number, lens in model.cameras.items():
        if number not in moved and lens.has_bogus_params(*limits):
            raise StageError(
                f"structure-from-motion: the lens came out as {lens.model.name} with "
                f"{lens.params_to_string()}, which no camera has; expected photos from different "
                "positions of an unmoving scene"
            )

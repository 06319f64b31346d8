"""Where the lens's axis meets photos that were cropped. Worker process only.

The axis meets the middle of a photo as the camera took it, but not of a part of it. So a photo of
a size that no other has is placed twice among the points of the others, which are held fixed:

- with a focal length and distortion of its own and the axis in its middle, as it was mapped;
- with those of a camera that took other photos, and the axis where it fits best.

Neither has more unknowns than the other (two each of SIMPLE_RADIAL). The second is taken where it
explains the photo's matches surely better. Matches are taken as they were verified: those left in
the model were chosen by the first. A photo that was also scaled after it was cropped is not found
that way.
"""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import sizes_of_their_own
from mattgs_ops.sfm.colmap.job import JobView

# Twice the logarithm of the Bayes factor from which evidence counts as very strong: R. Kass and
# A. Raftery, Bayes Factors, 1995, table on page 777. As both explanations have as many unknowns, it
# is the difference of their misfits
VERY_STRONG = 10.0
# A camera lends its lens where it took this many photos: as few as make a model (COLMAP's bound)
FEWEST_PHOTOS = 3
AS_BAD_AS_CAN_BE = 1e8  # a squared error in pixels, as if 10,000 pixels off


def images_of_their_own_size(model: Any, views: Sequence[JobView]) -> list[int]:
    """Return the placed images without known intrinsics whose size no other view has.

    Sizes are those of photos as they were taken, before any was reduced. None where too few or no
    more other images are placed.
    """
    alone = sizes_of_their_own([view.as_taken for view in views])
    unknown = [place + 1 for place in alone if views[place].intrinsics is None]
    placed = set(model.reg_image_ids())
    numbers = [number for number in unknown if number in placed]
    others = len(placed) - len(numbers)
    return numbers if others > len(numbers) and others >= FEWEST_PHOTOS else []


def forget(model: Any, images: Sequence[int]) -> None:
    """Delete all that some images see."""
    for number in images:
        image = model.image(number)
        for key_point in range(image.num_points2D()):
            if image.point2D(key_point).has_point3D():
                model.delete_observation(number, key_point)


def find_axes(
    model: Any, alone: Sequence[int], views: Sequence[JobView], database: Path, options: Any
) -> list[int]:
    """Place the images ``alone``, which see nothing yet, anew, in place; returns the cropped ones.

    ``model`` is a reconstruction in which view ``i`` is image ``i + 1``, as in the ``database`` of
    its matches. ``options`` are of its bundle adjustment, whose robust loss weighs misfits, too.
    """
    import pycolmap

    scale = options.ceres.loss_function_scale
    others, moved = sorted(set(model.reg_image_ids()) - set(alone)), []
    lenders = _lenders(model, others, views)
    with pycolmap.Database.open(database) as matches:
        for number in alone:
            _see_matches(model, number, others, matches)
            _resect(model, number, options, axis=False)
            as_mapped = least = misfit(model, number, scale)
            own = best = _state(model, number)
            for lens in _lenses_for(views[number - 1], lenders):
                _set(model, number, (own[0], lens))
                _resect(model, number, options, axis=True)
                found = misfit(model, number, scale)
                if found < min(least, as_mapped - VERY_STRONG):
                    least, best = found, _state(model, number)
            _set(model, number, best)
            if least < as_mapped:
                moved.append(number)
    return moved


def misfit(model: Any, number: int, scale: float) -> float:
    """Return -2 log likelihood of an image's key points, but for a constant.

    Errors are taken to follow Cauchy's distribution of ``scale`` pixels, as the robust loss does.
    """
    image = model.image(number)
    seen = [(p.xy, p.point3D_id) for p in image.points2D if p.has_point3D()]
    if not seen:
        return 0.0
    xyz = np.array([model.point3D(point).xyz for _, point in seen])
    pose = image.cam_from_world().matrix()
    in_camera = xyz @ pose[:, :3].T + pose[:, 3]
    errors = image.camera.img_from_cam(in_camera) - np.array([xy for xy, _ in seen])
    # a point behind the camera has no pixel
    squared = np.nan_to_num((errors**2).sum(axis=1), nan=AS_BAD_AS_CAN_BE)
    return float(2 * np.log1p(squared / scale**2).sum())


def _see_matches(model: Any, number: int, others: Sequence[int], matches: Any) -> None:
    """Let an image see the points of other images that it matches, by the database ``matches``."""
    import pycolmap

    image = model.image(number)
    for other in others:
        if not matches.exists_two_view_geometry(number, other):
            continue
        for mine, theirs in matches.read_two_view_geometry(number, other).inlier_matches:
            seen = model.image(other).point2D(theirs)
            if seen.has_point3D() and not image.point2D(mine).has_point3D():
                model.add_observation(seen.point3D_id, pycolmap.TrackElement(number, mine))


def _lenders(
    model: Any, others: Sequence[int], views: Sequence[JobView]
) -> list[tuple[Any, JobView]]:
    """Return the cameras that took several of ``others``, most first, each with a view of its."""
    took: dict[int, list[int]] = {}
    for number in others:
        took.setdefault(model.image(number).camera_id, []).append(number)
    most_first = sorted(took.items(), key=lambda camera: -len(camera[1]))
    return [
        (model.camera(camera), views[numbers[0] - 1])
        for camera, numbers in most_first
        if len(numbers) >= FEWEST_PHOTOS
    ]


def _lenses_for(
    view: JobView, lenders: Sequence[tuple[Any, JobView]]
) -> Iterator[NDArray[np.float64]]:
    """Yield a view's parameters with lenses of others and the axis in its middle.

    They are scaled as the photo was reduced, and of the same name where EXIF tells both names.
    """
    for lens, other in lenders:
        if view.lens and other.lens and view.lens != other.lens:
            continue
        params = np.array(lens.params, dtype=np.float64)
        params[list(lens.focal_length_idxs())] *= view.reduced / other.reduced
        params[list(lens.principal_point_idxs())] = view.width / 2, view.height / 2
        yield params


def _resect(model: Any, number: int, options: Any, *, axis: bool) -> None:
    """Adjust one image's pose, and its ``axis`` or else all other intrinsics; points stay."""
    import pycolmap

    options = deepcopy(options)
    options.refine_points3D = False
    options.refine_principal_point = axis
    options.refine_focal_length = options.refine_extra_params = not axis
    config = pycolmap.BundleAdjustmentConfig()
    config.add_image(number)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def _state(model: Any, number: int) -> tuple[Any, NDArray[np.float64]]:
    """Return an image's pose and its camera's parameters."""
    image = model.image(number)
    return image.cam_from_world(), np.array(image.camera.params, dtype=np.float64)


def _set(model: Any, number: int, state: tuple[Any, NDArray[np.float64]]) -> None:
    image = model.image(number)
    image.frame.set_cam_from_world(image.camera_id, state[0])
    model.camera(image.camera_id).params = state[1].tolist()

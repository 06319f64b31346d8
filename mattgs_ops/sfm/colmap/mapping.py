"""COLMAP's database, its mappers, and triangulation with given poses. Worker process only.

One thread and one seed: mapping several images at once is faster but not reproducible.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.config import SfmConfig
from mattgs_ops.errors import StageError
from mattgs_ops.sfm.colmap.features import Matches, Pair
from mattgs_ops.sfm.colmap.job import JobView
from mattgs_ops.sfm.colmap.lenses import cropped
from mattgs_ops.sfm.colmap.matching import Verified

SMALLEST_MODEL = 3  # views; fewer are no model
# Pixels of error from which an observation counts less (Cauchy's loss). SIFT is exact to about half
# a pixel; COLMAP accepts matches up to 4 pixels off, and some of those are wrong
ROBUST_SCALE = 0.5
# All views are adjusted anew whenever a model has grown by this factor; COLMAP's own is 1.1. On the
# bundled captures a quarter of the mapping's time goes, and no pose moves by a tenth of its error
GROWTH_OF_MODEL = 1.3
# A growing model is shown this often on its way to all views, and never more than every third view
GLANCES = 8
CONVERGED = 1e-6  # relative change of the cost: Ceres' own default, COLMAP's is none


def write_database(
    path: Path,
    views: Sequence[JobView],
    cameras: Sequence[Any],
    positions: Sequence[NDArray[np.float64]],
    pairs: Mapping[Pair, Verified] | Mapping[Pair, Matches],
) -> None:
    """Write a fresh database: view ``i`` is image ``i + 1`` under its file's name.

    Raises :class:`StageError` when the database does not hold what was written.
    """
    import pycolmap

    path.unlink(missing_ok=True)
    database = pycolmap.Database.open(path)
    for camera in {c.camera_id: c for c in cameras}.values():
        database.write_camera(camera, use_camera_id=True)
        rig = pycolmap.Rig(rig_id=camera.camera_id)
        rig.add_ref_sensor(camera.sensor_id)
        database.write_rig(rig, use_rig_id=True)
    for number, (view, camera, xy) in enumerate(zip(views, cameras, positions, strict=True), 1):
        image = pycolmap.Image(
            name=Path(view.photo).name, camera_id=camera.camera_id, image_id=number
        )
        database.write_image(image, use_image_id=True)
        frame = pycolmap.Frame(frame_id=number, rig_id=camera.camera_id)
        frame.add_data_id(image.data_id)
        database.write_frame(frame, use_frame_id=True)
        database.write_keypoints(number, xy.astype(np.float32))
    for (i, j), pair in pairs.items():
        if isinstance(pair, Verified):
            geometry, matches = pair.geometry, pair.matches
        else:
            geometry, matches = pycolmap.TwoViewGeometry(), pair
            geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            geometry.inlier_matches = matches
        database.write_matches(i + 1, j + 1, matches)
        database.write_two_view_geometry(i + 1, j + 1, geometry)
    expected = (len(views), sum(len(xy) for xy in positions), len(pairs))
    stored = (
        database.num_images(),
        database.num_keypoints(),
        database.num_verified_image_pairs(),
    )
    database.close()
    if expected != stored:
        raise StageError(
            f"{path.name}: expected {expected} images, key points and pairs, found {stored}"
        )


def pipeline_options(config: SfmConfig, *, intrinsics_known: bool) -> Any:
    """Return the options of the incremental mapper and of triangulation."""
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1
    options.random_seed = config.seed
    options.mapper.num_threads = 1
    options.mapper.random_seed = config.seed
    options.triangulation.random_seed = config.seed
    options.min_model_size = SMALLEST_MODEL
    options.ba_global_frames_ratio = options.ba_global_points_ratio = GROWTH_OF_MODEL
    if intrinsics_known:
        options.ba_refine_focal_length = False
        options.ba_refine_extra_params = False
        options.mapper.abs_pose_refine_focal_length = False
        options.mapper.abs_pose_refine_extra_params = False
    return options


def incremental(
    database: Path,
    photos: Path,
    out: Path,
    options: Any,
    views: int,
    progress: Callable[[int], None],
    see: Callable[[Any], None],
) -> list[Any]:
    """Map incrementally (Schönberger & Frahm 2016); returns the models, largest first.

    ``progress`` is called with the number of views registered so far, ``see`` with the growing
    model whenever it has gained some views, at the same moments in every run.
    """
    import pycolmap

    snapshots = out / "growing"
    snapshots.mkdir(parents=True, exist_ok=True)
    options.snapshot_path = snapshots
    options.snapshot_frames_freq = max(SMALLEST_MODEL, views // GLANCES)
    count = 0

    def start() -> None:
        nonlocal count
        count = 2
        progress(count)

    def following() -> None:
        nonlocal count
        count = min(count + 1, views)
        progress(count)
        for folder in sorted(snapshots.iterdir()):
            see(pycolmap.Reconstruction(folder))
            shutil.rmtree(folder)

    models = pycolmap.incremental_mapping(database, photos, out, options, "", start, following)
    return _largest_first(models)


def global_(
    database: Path, photos: Path, out: Path, config: SfmConfig, *, known: bool
) -> list[Any]:
    """Map globally (Pan et al. 2024, GLOMAP); returns the models, largest first."""
    import pycolmap

    out.mkdir(parents=True, exist_ok=True)
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = 1
    options.random_seed = config.seed
    options.mapper.num_threads = 1
    options.mapper.random_seed = config.seed
    options.mapper.global_positioning.use_gpu = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    options.mapper.bundle_adjustment.refine_focal_length = not known
    options.mapper.bundle_adjustment.refine_extra_params = not known
    if not known:
        pycolmap.calibrate_view_graph(database)
    return _largest_first(pycolmap.global_mapping(database, photos, out, options))


def adjust(
    model: Any, views: Sequence[JobView], database: Path, *, intrinsics_known: bool
) -> list[int]:
    """Adjust poses, points and intrinsics (unless known) once more, with a robust loss.

    COLMAP's mappers end with plain least squares, in which the worst matches weigh most;
    docs/sfm.md has the pose errors with and without this step. Where the axis of the lens misses
    the middle of photos that were cropped, it is moved, and all is adjusted again. Returns the
    numbers of these images; view ``i`` is image ``i + 1``.
    """
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.refine_focal_length = not intrinsics_known
    options.refine_extra_params = not intrinsics_known
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = ROBUST_SCALE
    options.ceres.use_gpu = False
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.function_tolerance = CONVERGED
    alone = cropped.images_of_their_own_size(model, views)
    if not alone:
        pycolmap.bundle_adjustment(model, options)
        return []
    cropped.forget(model, alone)  # a wrong axis bends the others' lens
    _solve(model, options, leaving_out=alone)
    moved = cropped.find_axes(model, alone, views, database, options)
    # the middle of these photos must not become their axis again
    _solve(model, options, fixed=[model.image(number).camera_id for number in moved])
    return moved


def _solve(
    model: Any, options: Any, *, leaving_out: Sequence[int] = (), fixed: Sequence[int] = ()
) -> None:
    """Adjust a model's images but for some; some cameras stay fixed."""
    import pycolmap

    config = pycolmap.BundleAdjustmentConfig()
    for number in model.reg_image_ids():
        if number not in leaving_out:
            config.add_image(number)
    for camera in fixed:
        config.set_constant_cam_intrinsics(camera)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def with_poses(views: Sequence[JobView], cameras: Sequence[Any]) -> Any:
    """Return a reconstruction without points from views with given poses."""
    import pycolmap

    model = pycolmap.Reconstruction()
    for camera in {c.camera_id: c for c in cameras}.values():
        model.add_camera_with_trivial_rig(camera)
    for number, (view, camera) in enumerate(zip(views, cameras, strict=True), 1):
        if view.pose is None:
            continue
        rotation = np.array(view.pose[:9]).reshape(3, 3)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), np.array(view.pose[9:]))
        image = pycolmap.Image(
            name=Path(view.photo).name, camera_id=camera.camera_id, image_id=number
        )
        model.add_image_with_trivial_frame(image, pose)
    return model


def posed(model: Any) -> dict[int, Camera]:
    """Return the cameras of a reconstruction's views by their places, lenses left aside."""
    out = {}
    for number in sorted(model.reg_image_ids()):
        image = model.image(number)
        lens, pose = image.camera, image.cam_from_world().matrix()
        intrinsics = Intrinsics(
            lens.width,
            lens.height,
            lens.focal_length_x,
            lens.focal_length_y,
            lens.principal_point_x,
            lens.principal_point_y,
        )
        out[number - 1] = Camera(intrinsics, pose[:, :3].copy(), pose[:, 3].copy())
    return out


def rays_of(model: Any, view: int, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return pixels [K, 2] of a view on the normalised image plane, distortion removed."""
    if not len(positions):
        return positions
    return np.asarray(model.image(view + 1).camera.cam_from_img(positions), dtype=np.float64)


def rays_by(model: Any, positions: Sequence[NDArray[np.float64]]) -> Callable[[int, Any], Any]:
    """Return a function of a view and rows of its key points: these by :func:`rays_of`."""
    return lambda view, rows: rays_of(model, view, positions[view][rows])


def triangulate(model: Any, database: Path, photos: Path, out: Path, options: Any) -> Any:
    """Triangulate all points anew with poses and intrinsics held fixed."""
    import pycolmap

    out.mkdir(parents=True, exist_ok=True)
    return pycolmap.triangulate_points(
        model, database, photos, out, clear_points=True, options=options, refine_intrinsics=False
    )


def _largest_first(models: Mapping[int, Any]) -> list[Any]:
    ordered = sorted(
        models.items(), key=lambda kv: (-kv[1].num_reg_images(), -kv[1].num_points3D(), kv[0])
    )
    return [model for _, model in ordered]

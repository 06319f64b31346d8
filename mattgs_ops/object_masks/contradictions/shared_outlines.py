"""Whether a scene's masks contradict each other through its cameras.

Points that two photos show test masks without a camera (``shared_points``). Outlines test both:
what the other photos' masks predict of a view (``silhouettes``) meets its own mask where masks and
cameras are right. A camera in the wrong place sees another outline. Such cameras may look sound, as
where two sides of an object look alike, and photos of one are placed before the other.
"""

from dataclasses import dataclass

from mattgs_ops.capture.masks import HALF, mask_name
from mattgs_ops.capture.scene import Scene
from mattgs_ops.object_masks.silhouettes import CONTRADICT, SIDE, predict
from mattgs_ops.object_masks.splats.labels import read_shrunk
from mattgs_ops.parallel import over_views
from mattgs_ops.splat.photos import camera_at


@dataclass(frozen=True)
class SharedOutlines:
    """How masks meet what the others predict of them through the cameras.

    ``mean`` is the mean IoU of the ``compared`` views; ``contradict`` names those whose mask shares
    less with the prediction than it differs, the worst first.
    """

    mean: float
    compared: int
    contradict: tuple[str, ...]


def masks_at_shared_outlines(scene: Scene, *, threads: int = 1) -> SharedOutlines | None:
    """Compare the masks of all views that have a camera, held-out ones included.

    None where fewer than two masks show something, or where they share no volume.
    """
    views = [view for view in scene.views if view.camera is not None]
    cameras = [camera_at(view, SIDE) for view in views]
    paths = [scene.folder / "masks" / mask_name(view.name) for view in views]
    masks = over_views(read_shrunk, paths, cameras, threads=threads)
    found = predict(cameras, masks)
    if found is None:
        return None
    shown = zip(views, masks, strict=True)
    names = [view.name for view, mask in shown if (mask >= HALF).any()]
    worst_first = sorted(zip(found.agreement, names, strict=True))
    contradict = tuple(name for overlap, name in worst_first if overlap < CONTRADICT)
    return SharedOutlines(round(found.mean, 4), len(names), contradict)

"""The one photo that stands for a scene wherever a single one is shown."""

from mattgs_ops.capture.scene import Scene, View


def example(scene: Scene) -> View | None:
    """Return the middle one of the held-out views with a camera, else of the training views."""
    views = scene.registered("test") or scene.registered("train")
    return views[len(views) // 2] if views else None

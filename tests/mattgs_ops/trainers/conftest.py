"""The tiny scene of the built-in trainings' tests, for other programs too."""

from tests.mattgs_ops.splat.conftest import tiny_scene

__all__ = ["tiny_scene"]

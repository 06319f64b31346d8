"""What the tests of training images share."""

import pytest

from mattgs_ops.segment.training_images.textures import Bank


@pytest.fixture(scope="session")
def bank() -> Bank:
    """Return one pattern of each kind; nothing changes them."""
    return Bank(0, per_maker=1)

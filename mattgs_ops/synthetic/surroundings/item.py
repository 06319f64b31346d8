"""What lies on a desk has a footprint and a height; the simplest is a sheet with an image."""

from dataclasses import dataclass, field

from numpy.random import Generator

from mattgs_ops.synthetic.surfaces.materials import Group, Image, Material, plain
from mattgs_ops.synthetic.surfaces.mesh import box, quad

BRIGHT = ("c0392b", "d8912a", "2471a3", "1e8449", "6c3483", "b7950b", "212f3c", "ca6f1e")
PAPER = 0.6  # roughness of paper and card


@dataclass
class Item:
    """Something with a footprint of ``width`` × ``depth`` centimetres and a height."""

    width: float
    depth: float
    height: float
    group: Group = field(default_factory=Group)


def bright(rng: Generator, roughness: float = 0.4) -> Material:
    """Return one of a few strong colours of plastic."""
    return plain(str(rng.choice(BRIGHT)), roughness)


def flat(image: Image, width: float, depth: float, lift: float = 0.02) -> Item:
    """Return a sheet with an image on it."""
    item = Item(width, depth, lift)
    item.group.add(quad(width, depth).at(z=lift), Material(image, PAPER, specular=0.3))
    item.group.add(box(width, depth, lift * 0.9, 0.005), plain("d8d6d0", PAPER))
    return item

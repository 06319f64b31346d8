"""Noise of a rendered capture's photos, against renders with four times the light paths.

    python benchmarks/captures/photo_noise.py CAPTURE [--views 2]

``CAPTURE`` is what `mattgs captures render` made. Of its first ``--views`` training and test photos
each is traced again with four times the paths and another seed; the noise is removed as in the
photos. Prints PSNR in dB of the photo before JPEG and of the file, in a Markdown table. The second
render's own noise counts too, so that the figures are lower bounds.
"""

import argparse
import json
from dataclasses import fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mattgs_ops.synthetic.render import Making, View, build_world, photograph
from mattgs_ops.synthetic.tracer import Tracer, choose_variant

MORE_PATHS = 4
OTHER_SEED = 1_000_003  # apart from the seeds of all views

Photo = NDArray[np.uint8]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("capture", type=Path)
    parser.add_argument("--views", type=int, default=2)
    arguments = parser.parse_args()
    made = json.loads((arguments.capture / "object.json").read_text(encoding="utf-8"))
    making = Making(**{field.name: made[field.name] for field in fields(Making)})
    choose_variant(made["variant"])
    world = build_world(making)
    tracer = Tracer(world.stage, world.light())
    print("| photo | light paths | before JPEG, dB | file, dB |\n|---|---|---|---|", flush=True)
    for test in (False, True):
        for view in [view for view in world.views if view.test == test][: arguments.views]:
            measure(tracer, view, making, arguments.capture)


def measure(tracer: Tracer, view: View, making: Making, capture: Path) -> None:
    """Print the line of one photo."""
    first = trace(tracer, view, making, view.samples, view.seed)
    second = trace(tracer, view, making, MORE_PATHS * view.samples, view.seed + OTHER_SEED)
    photo = np.asarray(Image.open(capture / "images" / view.file))
    before, file = psnr(first, second), psnr(photo, second)
    print(f"| {view.file} | {view.samples} | {before:.1f} | {file:.1f} |", flush=True)


def trace(tracer: Tracer, view: View, making: Making, samples: int, seed: int) -> Photo:
    """Return the view's photo with a number of light paths per pixel."""
    size = making.width, making.height
    return photograph(tracer, view.pose, *size, samples, seed, view.exposure)


def psnr(one: Photo, other: Photo) -> float:
    """Return the PSNR of two photos in dB."""
    difference = (one.astype(np.float64) - other) / 255
    return float(-10 * np.log10((difference**2).mean()))


if __name__ == "__main__":
    main()

"""Measure the splat engine: what a splat-pixel pair costs, how cost grows, what a step is made of.

    python benchmarks/engine.py --quick

Times with one thread are the calling thread's own processor time, with more the wall clock's. Each
pass is put beside the core's peak of fused multiply-adds, measured in the same process right
before it: ``FLOP/pair`` is time × peak ÷ evaluated splat-pixel pairs, in other words how many
operations the core could have done at most in the time that a pair took. Medians over repeats, so
that other programs' load touches both sides alike.
"""

import argparse
import math
import os
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mattgs_ops.capture.camera import Camera, Intrinsics
from mattgs_ops.splat import _engine
from mattgs_ops.splat.gaussians import Splats
from mattgs_ops.splat.memory import Memory
from mattgs_ops.splat.rasterize import PASSES, backward, render
from mattgs_ops.splat.ssim import photometric_loss
from mattgs_ops.splat.training.optimise import FIELDS, Adam

WHITE = (1.0, 1.0, 1.0)
PEAK_ROUNDS = 200_000  # of the multiply-add loop: about a millisecond
FIELD_OF_VIEW = 1.39  # focal length over width of the NeRF synthetic scenes
DISTANCE = 4.0  # of the camera from the scene's middle, likewise


@dataclass(frozen=True)
class Measured:
    """Medians over repeats of one scene."""

    seconds: dict[str, float]  # by pass
    flops: dict[str, float]  # peak-FLOP-equivalents per evaluated pair, by pass
    pairs: int  # splat-pixel pairs evaluated
    tile_pairs: int
    workspace_mib: float
    peak: float  # FLOP/s

    @property
    def raster(self) -> float:
        """Seconds of compositing, forward and backward."""
        return self.seconds["forward"] + self.seconds["backward"]

    @property
    def flops_a_pair(self) -> float:
        """Peak-FLOP-equivalents of compositing per evaluated pair."""
        return self.flops["forward"] + self.flops["backward"]

    @property
    def step(self) -> float:
        """Seconds of everything a training step needs from the engine."""
        return sum(self.seconds.values())


def scene(count: int, width: int, height: int, size: float | None = None) -> tuple[Splats, Camera]:
    """Return splats in a cube that fills the view, each covering more the fewer they are."""
    g = torch.Generator().manual_seed(0)
    scale = size if size is not None else 0.55 / count ** (1 / 3)
    splats = Splats(
        means=(torch.rand(count, 3, generator=g) - 0.5) * 2.6,
        log_scales=math.log(scale) + 0.5 * torch.randn(count, 3, generator=g),
        quaternions=torch.randn(count, 4, generator=g),
        opacity_logits=torch.randn(count, generator=g),
        sh_dc=torch.randn(count, 3, generator=g),
        sh_rest=0.1 * torch.randn(count, 15, 3, generator=g),
    )
    focal = FIELD_OF_VIEW * max(width, height)
    intrinsics = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    return splats, Camera(intrinsics, np.eye(3), np.array([0.0, 0.0, DISTANCE]))


def peak() -> float:
    """Floating-point operations a second of one core, fused multiply-adds on registers."""
    start = time.thread_time()
    operations = _engine.multiply_add(PEAK_ROUNDS)
    return operations / (time.thread_time() - start)


def timed(work: Callable[[], object], threads: int) -> float:
    """Seconds that ``work`` takes, as the module's docstring says."""
    clock = time.thread_time if threads == 1 else time.perf_counter
    start = clock()
    work()
    return clock() - start


def measure(
    splats: Splats, camera: Camera, threads: int, repeats: int, *, statistics: bool = False
) -> Measured:
    """Render, compare, go back and step Adam ``repeats`` times."""
    i = camera.intrinsics
    target = torch.rand(i.height, i.width, 3, generator=torch.Generator().manual_seed(1))
    adam = Adam(splats)
    rates = dict.fromkeys(FIELDS, 0.0)  # every repeat sees the same splats
    memory = Memory()
    names = (*PASSES, "loss")
    seconds: dict[str, list[float]] = {name: [] for name in names}
    flops: dict[str, list[float]] = {name: [] for name in names}
    peaks = []
    for repeat in range(repeats + 1):  # the first warms up
        peaks.append(peak())
        rendering = render(splats, camera, WHITE, threads=threads, memory=memory)
        loss = photometric_loss(rendering.image, target, threads=threads, memory=memory)

        def compare(image: torch.Tensor = rendering.image) -> None:
            photometric_loss(image, target, threads=threads, memory=memory)

        took = {"loss": timed(compare, threads)}
        adam.descend(rendering, loss.grad, rates, statistics=statistics, memory=memory)
        took |= rendering.pass_seconds
        if repeat == 0:
            continue
        for name in names:
            seconds[name].append(took[name])
            flops[name].append(took[name] * peaks[-1] / rendering.evaluated_pairs)
    return Measured(
        {name: float(np.median(v)) for name, v in seconds.items()},
        {name: float(np.median(v)) for name, v in flops.items()},
        rendering.evaluated_pairs,
        rendering.tile_pairs,
        rendering.workspace_bytes / 2**20,
        float(np.median(peaks)),
    )


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a Markdown table."""
    print(f"| {' | '.join(header)} |")
    print(f"|{'---|' * len(header)}")
    for row in rows:
        print(f"| {' | '.join(map(str, row))} |", flush=True)
    print()


def ms(seconds: float) -> str:
    """Milliseconds with two decimals."""
    return f"{1e3 * seconds:.2f}"


def compositing(repeats: int) -> None:
    """Print what a pair costs, and what the statistics add."""
    rows = []
    for count, statistics in ((20_000, False), (20_000, True), (50_000, False), (2_000, False)):
        m = measure(*scene(count, 400, 400), 1, repeats, statistics=statistics)
        per_pair = (m.flops["forward"], m.flops["backward"], m.flops_a_pair)
        rows.append(
            (
                f"{count:,}" + (" with statistics" if statistics else ""),
                f"{m.pairs / 1e6:.2f}",
                f"{m.tile_pairs:,}",
                *(ms(m.seconds[name]) for name in ("forward", "backward")),
                *(f"{value:.0f}" for value in per_pair),
                f"{m.peak / 1e9:.0f}",
            )
        )
    print("## Compositing at 400 x 400, one thread\n")
    header = ("splats", "pairs, M", "splat-tile pairs", "forward ms", "backward ms")
    table((*header, "forward FLOP/pair", "backward FLOP/pair", "both", "peak GFLOP/s"), rows)


def threads(repeats: int) -> None:
    """Print what a second thread brings: to compositing alone, and with all that goes before it."""
    rows = []
    for count in (20_000, 50_000):
        splats, camera = scene(count, 400, 400)
        whole: dict[int, list[float]] = {1: [], 2: []}
        compositing: dict[int, list[float]] = {1: [], 2: []}
        grad, memory = torch.rand(400, 400, 3), Memory()
        for _ in range(repeats):
            for number, walls in whole.items():  # interleaved
                start = time.perf_counter()
                rendering = render(splats, camera, WHITE, threads=number, memory=memory)
                backward(rendering, grad, statistics=False, memory=memory)
                walls.append(time.perf_counter() - start)
                took = rendering.pass_seconds
                compositing[number].append(took["forward"] + took["backward"])
        texts: list[object] = [f"{count:,}"]
        for seconds in (compositing, whole):
            one, two = (min(seconds[number]) for number in seconds)
            texts += [ms(one), ms(two), f"{one / two:.2f}"]
        rows.append(texts)
    print("## Threads, fastest of the repeats, ms: one, two, how much faster\n")
    table(
        ("splats", "compositing, 1", "2", "faster", "render and backward, 1", "2", "faster"), rows
    )


def parts(repeats: int) -> None:
    """Print what a step is made of, and its ratio to compositing."""
    rows = []
    for count in (10_000, 20_000, 50_000):
        m = measure(*scene(count, 400, 400), 1, repeats)
        values = [ms(value) for value in m.seconds.values()]
        rows.append((f"{count:,}", *values, ms(m.step), f"{m.step / m.raster:.2f}"))
    print("## A training step at 400 x 400 on one thread, ms\n")
    table(("splats", *PASSES, "loss", "step", "step ÷ compositing"), rows)


def pages(repeats: int) -> None:
    """Print what memory kept from step to step saves against memory allocated in every step."""
    rows = []
    for count in (20_000, 50_000):
        splats, camera = scene(count, 400, 400)
        grad, kept = torch.rand(400, 400, 3), Memory()
        found: dict[str, list[tuple[float, int]]] = {"kept": [], "fresh": []}
        for _ in range(repeats):
            for name, memory in (("kept", kept), ("fresh", None)):  # interleaved
                faults, start = page_faults(), time.thread_time()
                rendering = render(splats, camera, WHITE, memory=memory)
                backward(rendering, grad, statistics=False, memory=memory)
                found[name].append((time.thread_time() - start, page_faults() - faults))
        for name, pairs in found.items():
            seconds, faults = np.median(np.array(pairs), axis=0)
            rows.append((f"{count:,}", name, ms(seconds), f"{faults:.0f}"))
    print("## Memory of gradients and rendering, one thread\n")
    table(("splats", "memory", "render and backward, ms", "page faults"), rows)


def page_faults() -> int:
    """Return how many pages this process has been given by the system so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def growth(repeats: int, *, quick: bool) -> None:
    """Print how cost and memory grow with pixels and splats."""
    sizes = [(200, 200), (400, 400), (800, 800), (1600, 1200)]
    counts = [5_000, 20_000, 100_000] if quick else [5_000, 20_000, 100_000, 300_000, 1_000_000]
    rows = []
    for width, height in sizes:
        for count in counts:
            m = measure(*scene(count, width, height), 1, 3 if count > 50_000 else repeats)
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
            rows.append(
                (
                    f"{width} x {height}",
                    f"{count:,}",
                    f"{m.pairs / 1e6:.2f}",
                    ms(m.raster),
                    f"{1e9 * m.raster / m.pairs:.2f}",
                    f"{m.flops_a_pair:.0f}",
                    ms(m.step),
                    f"{m.workspace_mib:.0f}",
                    f"{memory:.0f}",
                )
            )
    print("## Growth, one thread\n")
    header = ("image", "splats", "pairs, M", "compositing ms", "ns/pair", "FLOP/pair", "step ms")
    table((*header, "workspace MiB", "process peak MiB so far"), rows)


def main() -> None:
    """Parse arguments, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer repeats, at most 100k splats")
    parser.add_argument("--instructions", help="baseline, avx2 or avx512; the best by default")
    arguments = parser.parse_args()
    if arguments.instructions and not _engine.use_instruction_set(arguments.instructions):
        parser.error(f"this machine has no {arguments.instructions}")
    torch.set_num_threads(1)
    repeats = 7 if arguments.quick else 25
    load = os.getloadavg()[0]
    print(f"Instructions: {_engine.instruction_set()}; {os.cpu_count()} cores; load {load:.1f}.\n")
    compositing(repeats)
    threads(repeats)
    parts(repeats)
    pages(repeats)
    growth(repeats, quick=arguments.quick)


if __name__ == "__main__":
    main()

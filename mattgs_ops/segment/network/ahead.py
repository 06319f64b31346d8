"""Training batches drawn ahead of their steps, by a thread or by processes.

On a GPU drawing is what a training waits for. Each process draws whole batches then, those of its
own lane (``batches``), whose composites it keeps.
"""

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import cv2

from mattgs_ops.segment.network.batches import Batches
from mattgs_ops.segment.network.train_config import SegmentTrainConfig
from mattgs_ops.segment.training_images.composites import Image

Batch = tuple[Image, Image]
EACH_AHEAD = 2  # batches that are drawn or wait for each process

_batches: Batches | None = None  # of a drawing process


def batches_ahead(batches: Batches, rendered: Path, start: int) -> Iterator[Batch]:
    """Yield the batches of the steps from ``start`` on, in order.

    ``rendered`` is the folder of traced views that ``batches`` was made with.
    """
    config = batches.config
    lanes: list[Executor]
    draw: Callable[[int], Batch]
    if config.workers:
        spawn = multiprocessing.get_context("spawn")  # forks of a process with threads can hang
        values = (config, rendered)
        lanes = [
            ProcessPoolExecutor(1, spawn, initializer=_open, initargs=values)
            for _ in range(config.workers)
        ]
        draw = _draw
    else:
        lanes, draw = [ThreadPoolExecutor(1)], batches.at
    waiting: deque[Future[Batch]] = deque()
    try:
        for step in range(start, config.steps):
            waiting.append(lanes[step % len(lanes)].submit(draw, step))
            if len(waiting) > max(1, EACH_AHEAD * config.workers):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for lane in lanes:
            lane.shutdown(wait=False, cancel_futures=True)
        for lane in lanes:
            lane.shutdown()


def _open(config: SegmentTrainConfig, rendered: Path) -> None:
    global _batches  # noqa: PLW0603 - the state of a drawing process, set once as it starts
    cv2.setNumThreads(1)
    _batches = Batches(config, rendered)


def _draw(step: int) -> Batch:
    if _batches is None:
        raise RuntimeError("expected a drawing process to be opened first")
    return _batches.at(step)

"""Training batches drawn ahead of their steps, by a thread or by processes.

A batch follows from the seed and the step alone, so it does not matter who draws it. On a GPU
drawing is what a training waits for; each process draws whole batches then, and shares no composite
with the others, so that showing them again (``reuse``) saves little there.
"""

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mattgs_ops.segment.network.batches import Batches
from mattgs_ops.segment.network.train_config import SegmentTrainConfig

Batch = tuple[NDArray[np.float32], NDArray[np.float32]]
EACH_AHEAD = 2  # batches that are drawn or wait for each process

_batches: Batches | None = None  # of a drawing process


def batches_ahead(batches: Batches, rendered: Path, start: int) -> Iterator[Batch]:
    """Yield the batches of the steps from ``start`` on, in order.

    ``rendered`` is the folder of traced views that ``batches`` was made with.
    """
    config = batches.config
    pool: Executor
    draw: Callable[[int], Batch]
    if config.workers:
        spawn = multiprocessing.get_context("spawn")  # forks of a process with threads can hang
        values = (config, rendered)
        pool = ProcessPoolExecutor(config.workers, spawn, initializer=_open, initargs=values)
        draw = _draw
    else:
        pool, draw = ThreadPoolExecutor(1), batches.at
    steps = iter(range(start, config.steps))
    waiting: deque[Future[Batch]] = deque()
    try:
        for step in steps:
            waiting.append(pool.submit(draw, step))
            if len(waiting) > max(1, EACH_AHEAD * config.workers):
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def _open(config: SegmentTrainConfig, rendered: Path) -> None:
    global _batches  # noqa: PLW0603 - the state of a drawing process, set once as it starts
    cv2.setNumThreads(1)
    _batches = Batches(config, rendered)


def _draw(step: int) -> Batch:
    if _batches is None:
        raise RuntimeError("expected a drawing process to be opened first")
    return _batches.at(step)

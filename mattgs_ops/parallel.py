"""The same work for every view, by several threads at once.

Files, OpenCV and numpy leave the interpreter to others while they work, so threads are enough.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

import cv2

Result = TypeVar("Result")


def over_views(
    work: Callable[..., Result], *views: Iterable[Any], threads: int = 1
) -> list[Result]:
    """Return ``work`` of each view, in their order; ``views`` give its arguments, as many of each.

    The first error is raised. Meanwhile OpenCV's own threads stand aside: there are never more than
    ``threads`` that work.
    """
    return list(each_view(work, *views, threads=threads))


def each_view(
    work: Callable[..., Result], *views: Iterable[Any], threads: int = 1
) -> Iterator[Result]:
    """Do what ``over_views`` does, and yield each result as soon as those before it are there."""
    arguments = list(zip(*views, strict=True))
    if threads <= 1 or len(arguments) <= 1:
        yield from (work(*one) for one in arguments)
        return
    with _one_opencv_thread(), ThreadPoolExecutor(threads) as pool:
        yield from pool.map(lambda one: work(*one), arguments)


@contextmanager
def _one_opencv_thread() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)

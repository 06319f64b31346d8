"""Work over views: the same results in the same order by any number of threads."""

import threading

import cv2
import pytest

from mattgs_ops.parallel import over_views


@pytest.mark.parametrize("threads", [1, 4])
def test_results_come_in_the_order_of_the_views(threads: int) -> None:
    assert over_views(pow, range(9), [2] * 9, threads=threads) == [n * n for n in range(9)]
    assert over_views(pow, [], [], threads=threads) == []


def test_threads_work_at_once_while_opencv_has_one() -> None:
    both = threading.Barrier(2, timeout=20)
    before = cv2.getNumThreads()

    def meet(_: int) -> int:
        both.wait()  # breaks where a second thread never comes
        return cv2.getNumThreads()

    assert over_views(meet, range(2), threads=2) == [1, 1]
    assert cv2.getNumThreads() == before


@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_reaches_the_caller_and_opencv_has_its_threads_again(threads: int) -> None:
    before = cv2.getNumThreads()
    with pytest.raises(ZeroDivisionError):
        over_views(lambda n: 1 // n, [2, 1, 0, 1], threads=threads)
    assert cv2.getNumThreads() == before


def test_lists_of_different_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="shorter"):
        over_views(pow, [1, 2], [1])

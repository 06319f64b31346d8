"""Reports come often; who writes or sends them lets few through."""

import time

import pytest

from mattgs_ops.progress import Throttle


def test_few_reports_pass_but_always_the_first_and_the_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    throttle = Throttle(5.0)
    passed = []
    for done in range(1, 13):
        now = 1.0 * done
        if throttle.passes(done, 12):
            passed.append(done)
    assert passed == [1, 6, 11, 12]

"""A function in a thread of its own, and what comes of its errors."""

from threading import Event

import pytest

from flows.services.background import Background, at_work, ends_at_once
from mattgs_ops.errors import InputError, StageError


def broken() -> None:
    raise InputError("no scheduler answers")


def test_what_it_raises_comes_out_where_it_is_waited_for() -> None:
    thread = Background(broken)
    thread.join()
    with pytest.raises(InputError, match="no scheduler answers"):
        thread.finish()


def test_as_a_context_it_ends_with_its_block_and_an_error_in_the_block_comes_first() -> None:
    begun, ended = Event(), []

    def work() -> None:
        begun.wait(60)
        ended.append(True)
        broken()

    def block() -> None:
        with Background(work):
            begun.set()
            raise KeyError

    with pytest.raises(KeyError):
        block()
    assert ended


def test_an_interruption_does_not_wait_for_it() -> None:
    let, ended = Event(), []

    def work() -> None:
        let.wait(60)
        ended.append(True)

    thread = Background(work)
    with pytest.raises(KeyboardInterrupt), thread:
        raise KeyboardInterrupt
    assert not ended
    assert at_work()
    let.set()
    thread.join()


def test_it_never_keeps_a_process_from_ending() -> None:
    with Background(lambda: None) as thread:
        assert thread.daemon


@pytest.mark.parametrize(
    ("kind", "at_once"),
    [
        (None, False),
        (KeyboardInterrupt, True),
        (InputError, True),  # services that start would hold the message's process up for long
        (StageError, False),
        (SystemExit, False),
    ],
)
def test_a_block_is_not_waited_for_where_the_process_is_to_end(
    kind: type[BaseException] | None, at_once: bool
) -> None:
    assert ends_at_once(kind) == at_once

"""A function in a thread of its own; what it raises comes out where it is waited for."""

import threading
from collections.abc import Callable
from typing import Self

from mattgs_ops.errors import InputError


class Background(threading.Thread):
    """Run a function in a thread; :meth:`finish` waits and raises what it raised.

    As a context it ends with its block, unless the process :func:`ends_at_once`. It is a daemon: it
    keeps no process from ending.
    """

    def __init__(self, function: Callable[[], object]) -> None:
        super().__init__(daemon=True)
        self._function = function
        self._error: Exception | None = None
        self.start()

    def run(self) -> None:
        """Run in the thread."""
        try:
            self._function()
        except Exception as error:
            self._error = error

    def finish(self) -> None:
        """Wait for the function's end."""
        self.join()
        if self._error is not None:
            raise self._error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if not ends_at_once(kind):
            self.join()


def ends_at_once(kind: type[BaseException] | None) -> bool:
    """Whether the process is to end without more work, by what a block was left with.

    That is Ctrl-C or the like, and what the user must see to first.
    """
    if kind is None:
        return False
    return issubclass(kind, InputError) or not issubclass(kind, (Exception, SystemExit))


def at_work() -> bool:
    """Whether some are: an interpreter that is taken down under their imports may crash."""
    return any(isinstance(thread, Background) for thread in threading.enumerate())

"""A function in a thread of its own; what it raises comes out where it is waited for."""

import threading
from collections.abc import Callable
from typing import Self


class Background(threading.Thread):
    """Run a function in a thread; :meth:`finish` waits and raises what it raised.

    As a context it ends with its block, unless that is interrupted. It is a daemon: it keeps no
    process from ending.
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
        if not interrupted(kind):
            self.join()


def interrupted(kind: type[BaseException] | None) -> bool:
    """Whether a block was left by Ctrl-C or the like: the process is to end without more work."""
    return kind is not None and not issubclass(kind, (Exception, SystemExit))


def at_work() -> bool:
    """Whether some are: an interpreter that is taken down under their imports may crash."""
    return any(isinstance(thread, Background) for thread in threading.enumerate())

"""Copies of an interrupted stage's files on the shared store, so that another machine goes on.

While a stage runs, a thread looks now and then whether it has saved anew, and sends what is there.
A store that fails costs a warning, never the stage.
"""

import logging
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mattgs_ops.errors import MattgsError
from mattgs_ops.store.store import Slot


@contextmanager
def copied(slot: Slot, saved: str, every: float) -> Iterator[None]:
    """Send the stage's files every ``every`` seconds, if its file ``saved`` is new; 0: never."""
    if every <= 0:
        yield
        return
    over = threading.Event()
    thread = threading.Thread(
        target=_follow, args=(slot, saved, every, over), name="drafts", daemon=True
    )
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()  # a copy that is under way is finished first


def _follow(slot: Slot, saved: str, every: float, over: threading.Event) -> None:
    sent = _date(slot.work / saved)  # what lies there already came from an earlier attempt
    while not over.wait(every):
        date = _date(slot.work / saved)
        if date in (0, sent):
            continue
        try:
            _send(slot, saved)
            sent = date
        except (OSError, MattgsError) as error:
            logging.getLogger("mattgs").warning("%s was not copied: %s", slot.key, error)


def _send(slot: Slot, saved: str) -> None:
    """Send copies: the stage goes on writing meanwhile.

    ``saved`` first, which is replaced whole: files that grow then hold at least what it needs.
    """
    with tempfile.TemporaryDirectory(dir=slot.work.parent, prefix="draft-") as folder:
        names = sorted(path.name for path in slot.work.iterdir() if path.is_file())
        for name in sorted(names, key=lambda name: name != saved):
            if not name.endswith(".part"):
                shutil.copyfile(slot.work / name, Path(folder) / name)
        slot.keep_draft(Path(folder))


def _date(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return 0

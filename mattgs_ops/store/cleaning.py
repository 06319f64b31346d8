"""Removes from a store what nobody refers to: artifacts, left work folders, locks of nothing.

What a running benchmark uses is never touched. A benchmark registers with :func:`in_use` before its
first stage; every stage it asks for dates the lock of its key. Whatever was asked for since the
oldest running benchmark began is left alone, and so is whatever is being worked on: each thing is
removed while its lock is held.
"""

import fcntl
import json
import os
import time
import uuid
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mattgs_ops.store.lock import is_at
from mattgs_ops.store.store import MANIFEST, Store, remove

USERS, WORK, LOCKS = "users", "work", "locks"
Kind = Literal["artifact", "work folder", "lock"]
# Made from a whole grid's results, so that no single row names it: kept with what it was made of.
SUMMARIES = ("measure",)
CLOCK_SLACK = 0.05  # seconds that a file's date may lag behind the clock


@dataclass(frozen=True)
class Removal:
    """Something that was, or would be, removed; ``name`` is relative to the store."""

    kind: Kind
    name: str
    size: int


@contextmanager
def in_use(store: Store) -> Iterator[None]:
    """Register a benchmark that uses the store; ends with the block, or with the process."""
    folder = store.root / USERS
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / uuid.uuid4().hex
    while True:
        with path.open("wb") as file:
            fcntl.flock(file, fcntl.LOCK_SH)
            if not is_at(file, path):  # somebody cleaned before it was locked
                continue
            try:
                yield
            finally:
                path.unlink(missing_ok=True)
            return


def is_in_use(store: Store) -> bool:
    """Whether a benchmark that registered is running."""
    return _oldest_user(store, dry_run=True) < float("inf")


def clean(
    store: Store, kept: Collection[str], *, unused_since: float, dry_run: bool = False
) -> list[Removal]:
    """Remove all artifacts but ``kept`` (keys) and what these were made of, left work, idle locks.

    Only what nobody asked for since ``unused_since`` (seconds since the epoch) is removed. Returns
    what was removed, or with ``dry_run`` what would be.
    """
    if not store.root.is_dir():
        return []
    limit = min(unused_since, time.time(), _oldest_user(store, dry_run)) - CLOCK_SLACK
    keep = _all_kept(store, kept)
    found = list(_artifacts(store, keep)) + list(_work(store))
    removed = [one for one in found if _remove(store, one, limit, dry_run)]
    return removed + _remove_locks(store, {one.name for one in removed}, limit, dry_run)


def _oldest_user(store: Store, dry_run: bool) -> float:
    """Return when the oldest running benchmark registered, infinity when none runs."""
    oldest = float("inf")
    for path in sorted((store.root / USERS).glob("*")):
        try:
            with path.open("rb") as file:
                began = os.fstat(file.fileno()).st_mtime
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    oldest = min(oldest, began)
                    continue
                if not dry_run:  # its owner was killed
                    path.unlink(missing_ok=True)
        except FileNotFoundError:
            continue  # it ended just now
    return oldest


def _stages(store: Store) -> list[Path]:
    other = (USERS, WORK, LOCKS)
    return sorted(p for p in store.root.iterdir() if p.is_dir() and p.name not in other)


def _artifacts(store: Store, keep: Collection[str]) -> Iterator[Removal]:
    for stage in _stages(store):
        for place in sorted(filter(Path.is_dir, stage.iterdir())):
            key = f"{stage.name}/{place.name}"
            if key not in keep:
                yield Removal("artifact", key, _size(place))


def _work(store: Store) -> Iterator[Removal]:
    for place in sorted((store.root / WORK).glob("*")):
        yield Removal("work folder", f"{WORK}/{place.name}", _size(place))


def _all_kept(store: Store, kept: Collection[str]) -> set[str]:
    """Return ``kept``, all that it was made of, and the summaries of nothing else."""
    keys = [
        f"{stage.name}/{place.name}"
        for stage in _stages(store)
        for place in stage.iterdir()
        if place.is_dir()
    ]
    manifests = {key: _manifest(store, key) for key in keys}
    inputs = {key: set(m.get("inputs", {}).values()) for key, m in manifests.items()}
    makers: dict[str, list[str]] = {}
    for key, manifest in manifests.items():
        makers.setdefault(str(manifest.get("digest")), []).append(key)
    found, waiting = set(kept), list(kept)
    while waiting:
        for digest in inputs.get(waiting.pop(), ()):
            new = [key for key in makers.get(digest, ()) if key not in found]
            found.update(new)
            waiting += new
    digests = {manifests[key].get("digest") for key in found if key in manifests}
    summaries = (key for key in keys if key.partition("/")[0] in SUMMARIES)
    return found | {key for key in summaries if inputs[key] and inputs[key] <= digests}


def _manifest(store: Store, key: str) -> dict[str, Any]:
    try:
        found = json.loads((store.root / key / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _remove(store: Store, one: Removal, limit: float, dry_run: bool) -> bool:
    """Remove one thing under its lock; return whether it was, or would be, removed."""
    key = one.name.removeprefix(f"{WORK}/")
    if dry_run and not _lock_file(store, key).exists():  # a dry run makes no locks either
        return _last_used(store, key) < limit
    with store.lock(key, wait=False) as acquired:
        if not acquired or _last_used(store, key) >= limit:
            return False
        if not dry_run:
            remove(store.root / one.name)
    return True


def _lock_file(store: Store, key: str) -> Path:
    return store.root / LOCKS / key.replace("/", "-")


def _last_used(store: Store, key: str) -> float:
    """Return when a key was last asked for, or its thing made; 0 when nobody knows."""
    dates = [0.0]
    for path in (_lock_file(store, key), store.root / key / MANIFEST):
        try:
            state = path.stat()
        except FileNotFoundError:
            continue
        if state.st_size > 0:  # an empty lock was only ever held by those who tidy up
            dates.append(state.st_mtime)
    return max(dates)


def _remove_locks(store: Store, gone: set[str], limit: float, dry_run: bool) -> list[Removal]:
    """Remove the locks of what is no longer there."""
    things = {f"{stage.name}/{p.name}" for stage in _stages(store) for p in stage.iterdir()}
    things |= {f"{WORK}/{place.name}" for place in (store.root / WORK).glob("*")}
    present = {name.removeprefix(f"{WORK}/").replace("/", "-") for name in things - gone}
    removed = []
    for path in sorted((store.root / LOCKS).glob("*")):
        if path.name in present:
            continue
        with store.lock(path.name, wait=False) as acquired:
            if acquired and _last_used(store, path.name) < limit:
                removed.append(Removal("lock", f"{LOCKS}/{path.name}", 0))
                if not dry_run:
                    path.unlink(missing_ok=True)
    return removed


def _size(place: Path) -> int:
    """Return the bytes below a folder; what vanishes meanwhile does not count."""
    total = 0
    for path in place.rglob("*"):
        try:
            if not path.is_symlink() and path.is_file():
                total += path.stat().st_size
        except FileNotFoundError:
            continue
    return total

"""Finished stages, addressed by what went into them, on a local folder.

The folder may be one machine's copy of what many share, see ``mattgs_ops/store/remote.py``.

A **key** is the digest of a stage's name, its code version, its parameters and its inputs' digests.
Under the store's root::

    STAGE/DIGEST/files/…         what the stage produced
    STAGE/DIGEST/manifest.json   names, sizes and SHA-256 of the files; what the key was made of
    work/STAGE-DIGEST/           a stage in progress; survives a kill
    locks/STAGE-DIGEST           the kernel lock on it names the one who works, its date tells when
                                 the stage was last asked for
    users/…                      one file per running benchmark, locked by it

An artifact appears whole or not at all: it is moved into place by one rename. Two processes never
do the same stage at once: the second waits, then finds the result. The lock is the kernel's, so a
killed owner frees it. An artifact whose files are not as its manifest says is logged, removed and
made again.
"""

import json
import logging
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.naming import below
from mattgs_ops.store import lock as store_lock
from mattgs_ops.store.digests import file_digest, list_files, tree_digest
from mattgs_ops.store.keys import StageKey
from mattgs_ops.store.remote import RemoteStore

SCHEMA = 1
MANIFEST = "manifest.json"
FILES = "files"

# What a file that is gone raises; other errors are of the disk or the network
DAMAGED = (FileNotFoundError, NotADirectoryError)

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Finished:
    """An artifact in the store.

    ``folder`` holds its files; ``digest`` covers their names and contents; ``extra`` is what the
    stage's runner added (seconds, for example).
    """

    key: str
    folder: Path
    digest: str
    size: int
    extra: Mapping[str, Any]


class Slot:
    """A key's place while its lock is held: ``finished``, or a ``work`` folder to fill."""

    def __init__(self, store: "Store", key: StageKey, finished: Finished | None, work: Path):
        self.key = key
        self.work = work
        self.finished = finished
        self._store = store

    def finish(self, extra: Mapping[str, Any] | None = None) -> Finished:
        """Move ``work`` into the store; raises :class:`StageError` when it is empty."""
        if self.finished is not None:
            raise StageError(f"{self.key}: already finished; expected no second result")
        self.finished = self._store._publish(self.key, self.work.parent, dict(extra or {}))
        if not self._store._share(self.key):
            # another machine was faster: what it found is the one result that everybody uses
            self.finished = self._store._bring(self.key) or self.finished
        self._store._drop_draft(self.key)
        return self.finished

    def keep_draft(self, folder: Path) -> None:
        """Have another machine go on from the files in ``folder``, should this one be lost."""
        if self._store._remote is not None:
            self._store._remote.keep_draft(str(self.key), folder)


class Store:
    """A store on a local folder, made on first use. Holds no state: instances are cheap.

    With ``remote``, an fsspec URL, what is not here is looked for there, and what is finished here
    is put there too.
    """

    def __init__(self, root: Path, remote: str | None = None):
        self.root = root.resolve()
        self._remote = None if remote is None else RemoteStore(remote)

    def folder(self, key: StageKey | str) -> Path:
        """Return where an artifact's files lie, or would lie."""
        return self._place(key) / FILES

    def _place(self, key: StageKey | str) -> Path:
        """Return an artifact's folder; a key as text may come from another machine."""
        return below(self.root, str(key), "the key of an artifact")

    def find(self, key: StageKey | str, *, contents: bool = True) -> Finished | None:
        """Return the artifact if it is there and intact, else None.

        Names and sizes are always compared with the manifest; SHA-256 digests too with
        ``contents``. Never changes anything. Raises :class:`StageError` where it cannot be read.
        """
        place = self._place(key)
        if not place.is_dir():
            return None
        try:
            manifest = json.loads((place / MANIFEST).read_text(encoding="utf-8"))
            problem = _damage(place / FILES, manifest["files"], contents=contents)
            if problem is None:
                size = sum(row["bytes"] for row in manifest["files"].values())
                return Finished(
                    str(key), place / FILES, manifest["digest"], size, manifest["extra"]
                )
        except (*DAMAGED, ValueError, KeyError, TypeError, AttributeError) as error:
            problem = f"unreadable manifest ({error})"
        except OSError as error:  # what is there may be intact
            raise StageError(f"{place}: cannot be read: {error}") from error
        log.warning("%s is damaged: %s; it will be made again", key, problem)
        return None

    def require(self, key: StageKey | str) -> Finished:
        """Return the artifact; raises :class:`StageError` when it is missing or damaged."""
        found = self.find(key)
        if found is None:
            raise StageError(f"{self._place(key)}: expected a finished stage, found none intact")
        return found

    def fetch(self, key: StageKey | str) -> Finished:
        """Return the artifact, brought here first when only the remote store has it.

        Raises :class:`StageError` when it is nowhere, or damaged everywhere.
        """
        if self._remote is None:
            return self.require(key)
        with self.lock(key):
            found = self.find(key, contents=False) or self._bring(key)
        return found or self.require(key)

    @contextmanager
    def stage(self, key: StageKey, *, resume: bool = False) -> Iterator[Slot]:
        """Hold the key's lock, waiting for it; yields what is there, or a folder to fill.

        A work folder left by a kill or an error is handed on with ``resume`` and emptied without.
        Where there is none, ``resume`` takes the draft that a lost machine left in the remote
        store. When the block ends without :meth:`Slot.finish`, the work stays and nothing is
        stored.
        """
        with self.lock(key):
            finished = self.find(key)
            if finished is not None:
                self._share(key)  # a kill may have come between here and there
            else:
                finished = self._bring(key)
            place = self.root / "work" / str(key).replace("/", "-")
            if finished is None:
                remove(self._place(key))
                if not resume:
                    remove(place)
                (place / FILES).mkdir(parents=True, exist_ok=True)
                if resume:
                    self._take_draft(key, place)
            yield Slot(self, key, finished, place / FILES)

    def _bring(self, key: StageKey | str) -> Finished | None:
        """Copy an artifact from the remote store; None when it has none intact."""
        if self._remote is None:
            return None
        work = self.root / "work" / str(key).replace("/", "-")
        place = work / "coming"
        if not self._remote.fetch(str(key), place, FILES):
            remove(place)
            return None
        final = self._place(key)
        remove(final)
        final.parent.mkdir(parents=True, exist_ok=True)
        place.rename(final)
        remove(work)
        return self.find(key)

    def _take_draft(self, key: StageKey, place: Path) -> None:
        """Fill an empty work folder with what another machine had last, whole or not at all."""
        if self._remote is None or any((place / FILES).iterdir()):
            return
        coming = place / "coming"
        remove(coming)
        coming.mkdir()
        if self._remote.fetch_draft(str(key), coming):
            (place / FILES).rmdir()
            coming.rename(place / FILES)
        remove(coming)

    def _drop_draft(self, key: StageKey) -> None:
        try:
            if self._remote is not None:
                self._remote.drop_draft(str(key))
        except StageError as error:  # the result is safe, and nobody reads its draft any more
            log.warning("%s: its draft stays: %s", key, error)

    def _share(self, key: StageKey | str) -> bool:
        """Have an artifact in the remote store too; False when another one is there already."""
        if self._remote is None or self._remote.manifest(str(key)) is not None:
            return self._remote is None
        return self._remote.publish(str(key), self._place(key), FILES)

    @contextmanager
    def lock(self, key: StageKey | str, *, wait: bool = True) -> Iterator[bool]:
        """Hold a key's lock, waiting for it; the lock's date then says that the key is in use.

        With ``wait`` unset, for those who only tidy up: yields False at once when another has it,
        and leaves the date alone.
        """
        with store_lock.held(self.root / "locks" / str(key).replace("/", "-"), wait) as acquired:
            yield acquired

    def _publish(self, key: StageKey, place: Path, extra: dict[str, Any]) -> Finished:
        for left in place.iterdir():  # by a kill: half of what came or went, half a manifest
            if left.name != FILES:
                left.unlink() if left.is_file() else shutil.rmtree(left)
        rows: dict[str, dict[str, Any]] = {
            name: {"bytes": path.stat().st_size, "sha256": file_digest(path)}
            for name, path in list_files(place / FILES).items()
        }
        if not rows:
            raise StageError(f"{key}: the stage produced no files")
        digest = tree_digest({name: row["sha256"] for name, row in rows.items()})
        manifest = {
            "schema": SCHEMA,
            "key": str(key),
            **key.parts(),
            "digest": digest,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "extra": extra,
            "files": rows,
        }
        text = json.dumps(manifest, indent=1, sort_keys=True, allow_nan=False)
        with (place / MANIFEST).open("w", encoding="utf-8") as file:
            file.write(text + "\n")
            file.flush()
            os.fsync(file.fileno())
        final = self._place(key)
        final.parent.mkdir(parents=True, exist_ok=True)
        place.rename(final)
        size = sum(row["bytes"] for row in rows.values())
        return Finished(str(key), final / FILES, digest, size, extra)


def _damage(folder: Path, rows: Mapping[str, Any], *, contents: bool) -> str | None:
    """Say what differs between files and manifest, or None."""
    try:
        files = list_files(folder)
    except InputError as error:
        return str(error)
    if files.keys() != rows.keys():
        names = sorted(files.keys() ^ rows.keys())
        return f"{names[0]} is {'not expected' if names[0] in files else 'missing'}"
    for name, path in files.items():
        found = path.stat().st_size
        if found != rows[name]["bytes"]:
            return f"{name} has {found} bytes instead of {rows[name]['bytes']}"
    if contents:
        for name, path in files.items():
            if file_digest(path) != rows[name]["sha256"]:
                return f"{name} has other contents"
    return None


def remove(place: Path) -> None:
    """Remove a folder, its manifest first: half a removal must not look like an artifact."""
    (place / MANIFEST).unlink(missing_ok=True)
    if place.exists():
        shutil.rmtree(place)

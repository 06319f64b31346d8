"""Finished stages on an object store, shared by machines that share nothing else.

Any fsspec URL will do (``s3://bucket/folder``, ``gs://…``, ``file:///…``). Below it::

    objects/SHA256               contents of files, named by their digest
    STAGE/DIGEST/manifest.json   which files an artifact consists of; written last
    drafts/STAGE/DIGEST/…        what an unfinished stage had last, with a manifest of its own

An artifact is there when its manifest is. Objects never change, so two machines that finish the
same stage at once cannot mix their files: the first manifest stays. Everything is verified on the
way down; an object that is not what its name says is removed, and the stage is made again. A
manifest that names files outside its artifact, or objects by anything but a digest, is refused
before anything is read, written or removed: whoever can write to the store could have planted it.

Of the store is asked that a write is seen by whoever reads afterwards, and that single objects
appear whole, as S3 and its relatives promise. Elsewhere (``file://``, ``sftp://`` …) each object is
written beside its place and then renamed. Endpoint and credentials come from the environment
(``AWS_ENDPOINT_URL``, ``AWS_ACCESS_KEY_ID`` …), as each protocol has it.
"""

import json
import logging
import re
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mattgs_ops.errors import InputError, StageError
from mattgs_ops.naming import PATH_RULE, below, is_below
from mattgs_ops.store.digests import file_digest, list_files

MARK = "mattgs-store.json"
SCHEMA = 1
MANIFEST = "manifest.json"
DRAFTS = "drafts"
SHA256 = re.compile(r"[0-9a-f]{64}")
# what fsspec calls stores where an object is whole once it can be seen, and a rename is a copy
WHOLE = frozenset({"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oss", "memory"})

log = logging.getLogger(__name__)


class RemoteStore:
    """An object store at a URL; raises :class:`InputError` when fsspec does not know its kind."""

    def __init__(self, url: str) -> None:
        import fsspec

        self.url = url.rstrip("/")
        if not self.url:
            raise InputError(f"--store {url!r}: expected a URL, s3://BUCKET/FOLDER for example")
        try:
            # listings are not kept: other machines write here too
            self._files, root = fsspec.url_to_fs(self.url, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            raise InputError(f"--store {url}: {error}") from error
        self._root = root.rstrip("/")
        kinds = self._files.protocol
        self._whole = not WHOLE.isdisjoint([kinds] if isinstance(kinds, str) else kinds)
        self._made: set[str] = set()  # folders: asked for once, not once per object

    def check(self) -> None:
        """Write and read a mark; raises :class:`InputError` when that is not possible."""
        mark = f"{self._root}/{MARK}"
        text = json.dumps({"schema": SCHEMA}).encode()
        try:
            if not self._whole:  # object stores have no folders; their buckets are not made here
                self._files.makedirs(self._root, exist_ok=True)
            self._files.pipe_file(mark, text)
            found = self._files.cat_file(mark)
        except Exception as error:  # each protocol has its own
            raise InputError(f"--store {self.url}: cannot be written: {error}") from error
        if found != text:
            raise InputError(f"--store {self.url}: expected back what was written, found {found!r}")

    def manifest(self, key: str) -> dict[str, Any] | None:
        """Return an artifact's manifest; None when there is none, or half of one.

        Raises :class:`InputError` for one that would lead out of the artifact's folder.
        """
        return self._read(self._place(key))

    def _read(self, path: str) -> dict[str, Any] | None:
        with self._errors():
            try:
                found = json.loads(self._files.cat_file(path))
            except FileNotFoundError:
                return None
            except ValueError:
                log.warning("%s: %s is unreadable", self.url, path.removeprefix(self._root))
                return None
        if not isinstance(found, dict) or "files" not in found:
            return None
        _check_files(found["files"], f"{self.url}{path.removeprefix(self._root)}")
        return found

    def fetch(self, key: str, place: Path, files: str) -> bool:
        """Download an artifact into the folder ``place``; return whether it was there, intact.

        Files go to ``place/files``, the manifest comes last.
        """
        manifest = self.manifest(key)
        if manifest is None:
            return False
        shutil.rmtree(place, ignore_errors=True)
        for name, row in manifest["files"].items():
            target = below(place / files, name, key)
            target.parent.mkdir(parents=True, exist_ok=True)
            if not self._download(row["sha256"], target, self._object(row["sha256"])):
                log.warning("%s: %s of %s is damaged; it will be made again", self.url, name, key)
                with self._errors():
                    self._remove(self._place(key))
                return False
        text = json.dumps(manifest, indent=1, sort_keys=True)
        (place / MANIFEST).write_text(text + "\n", encoding="utf-8")
        return True

    def publish(self, key: str, place: Path, files: str) -> bool:
        """Upload an artifact; return False when another machine has published it already."""
        text = (place / MANIFEST).read_bytes()
        rows = {row["sha256"]: (row, name) for name, row in json.loads(text)["files"].items()}
        for row, name in rows.values():  # equal files once
            self._upload(row["bytes"], place / files / name, self._object(row["sha256"]))
        if self.manifest(key) is not None:
            return False
        with self._errors():
            self._make_parent(self._place(key))
            self._put(self._place(key), lambda at: self._files.pipe_file(at, text))
        return True

    def keep_draft(self, key: str, folder: Path) -> None:
        """Keep copies of an unfinished stage's files, in place of those kept before."""
        place = self._draft(key)
        rows: dict[str, dict[str, Any]] = {
            name: {"bytes": path.stat().st_size, "sha256": file_digest(path)}
            for name, path in list_files(folder).items()
        }
        before = self._read(f"{place}/{MANIFEST}") or {"files": {}}
        for name, row in rows.items():
            self._upload(row["bytes"], folder / name, f"{place}/{row['sha256']}")
        text = json.dumps({"files": rows}).encode()
        with self._errors():
            self._put(f"{place}/{MANIFEST}", lambda at: self._files.pipe_file(at, text))
            now = {row["sha256"] for row in rows.values()}
            for digest in {row["sha256"] for row in before["files"].values()} - now:
                self._remove(f"{place}/{digest}")

    def fetch_draft(self, key: str, folder: Path) -> bool:
        """Download the files of an unfinished stage; return whether all were there, intact."""
        place = self._draft(key)
        manifest = self._read(f"{place}/{MANIFEST}")
        if manifest is None:
            return False
        for name, row in manifest["files"].items():
            target = below(folder, name, key)
            target.parent.mkdir(parents=True, exist_ok=True)
            if not self._download(row["sha256"], target, f"{place}/{row['sha256']}"):
                log.warning("%s: the draft of %s is damaged; it is not used", self.url, key)
                return False
        return True

    def drop_draft(self, key: str) -> None:
        """Remove what was kept of an unfinished stage, if anything."""
        with self._errors():
            if self._files.exists(f"{self._draft(key)}/{MANIFEST}"):
                self._files.rm(self._draft(key), recursive=True)

    def _draft(self, key: str) -> str:
        return f"{self._root}/{DRAFTS}/{key}"

    def _place(self, key: str) -> str:
        return f"{self._root}/{key}/{MANIFEST}"

    def _object(self, digest: str) -> str:
        return f"{self._root}/objects/{digest}"

    def _download(self, digest: str, target: Path, source: str) -> bool:
        with self._errors():
            try:
                self._files.get_file(source, str(target))
            except FileNotFoundError:
                return False
            if file_digest(target) == digest:
                return True
            self._remove(source)
        return False

    def _upload(self, size: int, path: Path, target: str) -> None:
        with self._errors():
            try:
                if self._files.info(target)["size"] == size:
                    return
            except FileNotFoundError:
                self._make_parent(target)
            self._put(target, lambda at: self._files.put_file(str(path), at))

    def _put(self, target: str, write: Callable[[str], Any]) -> None:
        """Write an object by ``write(path)`` so that nobody reads half of it."""
        if self._whole:
            write(target)
            return
        part = f"{target}.part-{uuid.uuid4().hex}"
        write(part)
        self._files.mv(part, target)

    def _make_parent(self, path: str) -> None:
        folder = path.rpartition("/")[0]
        if folder not in self._made and not self._whole:
            self._files.makedirs(folder, exist_ok=True)
            self._made.add(folder)

    def _remove(self, path: str) -> None:
        if self._files.exists(path):
            self._files.rm_file(path)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # each protocol has its own
            raise StageError(f"{self.url}: the store fails: {error}") from error


def _check_files(files: Any, where: str) -> None:
    """Raise :class:`InputError` unless a manifest's files stay where they belong.

    A file's name is where it is written to, its digest names the object that is read, and removed
    when its content differs.
    """
    if not isinstance(files, dict):
        raise InputError(f"{where}: `files`: expected a table, found {type(files).__name__}")
    for name, row in files.items():
        if not is_below(name):
            raise InputError(f"{where}: `files`: {PATH_RULE}, found {name!r}")
        digest = row.get("sha256") if isinstance(row, dict) else None
        if not isinstance(digest, str) or SHA256.fullmatch(digest) is None:
            raise InputError(
                f"{where}: `files.{name}.sha256`: expected 64 hexadecimal digits, found {digest!r}"
            )

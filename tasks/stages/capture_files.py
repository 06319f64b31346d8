"""Which files a capture consists of, and the digest of their contents.

The digest goes by names relative to the capture's folder and by contents, never by dates or places:
a copied capture is the same one, an edited photo makes another.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

from mattgs_ops.capture.prepare import BUNDLED_FOLDER
from mattgs_ops.config import CaptureConfig
from mattgs_ops.store.digests import file_digest

PARTS = ("images", "masks", "sparse")  # folders that captures of all kinds keep things in
POSES = "transforms.json"


def capture_digest(capture: CaptureConfig) -> str:
    """Return SHA-256 over all files of a capture; files that are missing simply do not count.

    What is wrong with a capture is not said here but by its preparation.
    """
    root = BUNDLED_FOLDER / capture.name if capture.path is None else capture.path
    total = hashlib.sha256()
    for label, path in _files(root):
        total.update(f"{label}\0{file_digest(path)}\n".encode())
    if capture.masks is not None:
        for path in sorted(p for p in capture.masks.glob("*") if p.is_file()):
            total.update(f"own masks/{path.name}\0{file_digest(path)}\n".encode())
    return total.hexdigest()


def _files(root: Path) -> Iterator[tuple[str, Path]]:
    """Yield label and path of each file, sorted by label, each once."""
    found: dict[str, Path] = {p.name: p for p in root.glob("*") if p.is_file()}
    for part in PARTS:
        inside = (p for p in (root / part).rglob("*") if p.is_file())
        found |= {str(p.relative_to(root)): p for p in inside}
    for named in _named_by_poses(root / POSES):
        # paths in transforms.json may lack their suffix, or lead out of the folder
        for path in sorted((root / named).parent.glob(f"{Path(named).name}*")):
            if path.is_file():
                found[f"{Path(named).parent}/{path.name}"] = path
    yield from sorted(found.items())


def _named_by_poses(poses: Path) -> list[str]:
    try:
        frames = json.loads(poses.read_text(encoding="utf-8")).get("frames", [])
    except (OSError, ValueError, AttributeError):
        return []
    rows = (
        [frame for frame in frames if isinstance(frame, dict)] if isinstance(frames, list) else []
    )
    named = (row.get(key) for row in rows for key in ("file_path", "mask_path"))
    return [name for name in named if isinstance(name, str) and name]

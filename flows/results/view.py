"""``mattgs view``: splats, cameras and photos in the browser, served until Ctrl-C."""

import sys
import tempfile
import time
import webbrowser
from pathlib import Path
from typing import Any

from flows.results.splats_of import SplatSource, splats_of
from mattgs_ops.capture.scene import Scene
from mattgs_ops.errors import InputError
from mattgs_ops.naming import checked_row


def view(what: str, out: Path, port: int, *, browser: bool) -> None:
    """Serve what ``what`` names until Ctrl-C.

    Raises :class:`InputError` when there is no such thing, or viser is not installed.
    """
    with tempfile.TemporaryDirectory(prefix="mattgs-view-") as folder:
        server, description = start(what, out, port, Path(folder))
        address = f"http://127.0.0.1:{server.get_port()}"
        sys.stdout.write(f"{description}\nViewer: {address} (Ctrl-C ends)\n")
        sys.stdout.flush()
        if browser:
            webbrowser.open(address)
        try:
            while True:
                time.sleep(3600)
        finally:
            server.stop()


def start(what: str, out: Path, port: int, into: Path) -> tuple[Any, str]:
    """Start the viewer; return its server and a line that says what it shows."""
    from reports.page import viser_viewer

    viser_viewer.require()
    source = splats_of(what, out, into)
    scene = None if source.files is None else _scene(source.files, out)
    server = viser_viewer.serve(source.splats, scene, _photos(source, scene), port)
    cameras = 0 if scene is None else sum(view.camera is not None for view in scene.views)
    return server, f"{source.name}: splats and {cameras} cameras"


def _scene(files: Path, out: Path) -> Scene | None:
    """Return the run's scene: the store's, which has all photos, else the registry's."""
    import json

    try:
        found = json.loads((files / "row.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{files}: expected the row of a run: {error}") from error
    row = checked_row(found, f"{files}: row.json")
    kept = out / "store" / (row.get("artifacts") or {}).get("scene", "-")
    for folder in (kept, files / "scene"):
        if (folder / "scene.json").is_file():
            return Scene.load(folder)
    return None


def _photos(source: SplatSource, scene: Scene | None) -> dict[str, Path]:
    """Map views to pictures: the scene's photos where they are, else what was scored against."""
    if scene is None or source.files is None:
        return {}
    truths = {v.name: source.files / "truth" / v.split / f"{v.name}.png" for v in scene.views}
    found = {v.name: v.photo if v.photo.is_file() else truths[v.name] for v in scene.views}
    return {name: path for name, path in found.items() if path.is_file()}

"""Files among photos that are not read as photos, and what to do with them.

``advice(name)`` says it for formats that people try; for any other file there is none.
"""

from mattgs_ops.capture.formats.split_lists import NERF_LISTS

ADVICE = {
    (".heic", ".heif", ".avif"): "this format is not read: convert it to JPEG",
    (
        ".dng",
        ".cr2",
        ".cr3",
        ".nef",
        ".arw",
        ".raf",
    ): "raw files are not read: develop them to JPEG",
    (".mp4", ".mov", ".avi", ".mkv"): "give a video as --video FILE",
    tuple(NERF_LISTS.values()): "give NeRF's own layout as --capture FOLDER",
}


def advice(name: str) -> str:
    """Return what to do with a file, in brackets after a space; empty where nothing is known."""
    lower = name.lower()
    return next((f" ({text})" for ends, text in ADVICE.items() if lower.endswith(ends)), "")

"""File names, keys and anchors made of names that people give."""

import re

FILE_NAME = "._+-"  # besides letters and digits; what names of captures and conditions may hold


def slug(text: str, keep: str = FILE_NAME) -> str:
    """Turn each run of what is neither an ASCII letter, a digit nor in ``keep`` into one dash."""
    return re.sub(rf"[^A-Za-z0-9{re.escape(keep)}]+", "-", text)

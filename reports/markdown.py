"""Sentences of others in Markdown: reasons hold line breaks, and signs that would be markup."""

import re
from collections.abc import Iterable

MARKUP = re.compile(r"([\\*_\[\]])")


def one_line(text: str) -> str:
    """Return a text that stays in its line and starts no tag."""
    return " ".join(text.split()).replace("<", "&lt;")


def items(texts: Iterable[str]) -> list[str]:
    """Return the lines of a list, one for each text."""
    return [f"- {one_line(text)}" for text in texts]


def plain(text: str) -> str:
    """Return a text that is no markup, within a picture's description or an emphasis."""
    return MARKUP.sub(r"\\\1", one_line(text))


def table_cell(text: str) -> str:
    """Return a text that stays in its cell of a pipe table."""
    return one_line(text).replace("|", "\\|")

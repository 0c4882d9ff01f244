"""Names and words of a vehicle file inside the files of other programs."""

from __future__ import annotations


def one_line(text: str) -> str:
    """Return text without control characters: XML forbids them even escaped, and a comment would end at a line's end."""
    return "".join(c if c.isprintable() else " " for c in text)

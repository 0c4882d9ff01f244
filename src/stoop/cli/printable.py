"""Text from files and file names, made safe to print: it can neither steer the terminal nor break a line."""

from __future__ import annotations


def printable(text: str) -> str:
    r"""Return one line of printable characters; others are written as Python escapes (``\x1b``)."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else _escaped(c) for c in text.replace("\n", " "))


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")

"""Phrases of messages: lists of names, and advice on a name that is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

MOST_LISTED = 40  #: names in a message


def nearest(name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """Return advice on a wrong name: up to three that resemble it, or all there are.

    Parameters
    ----------
    name : str
    among : iterable of str
        Known names.
    cutoff : float
        Least resemblance, see :func:`difflib.get_close_matches`.
    """
    choices = list(among)
    close = difflib.get_close_matches(name, choices, n=3, cutoff=cutoff)
    if close:
        return f"did you mean {' or '.join(close)}?"
    more = f" and {len(choices) - MOST_LISTED} more" if len(choices) > MOST_LISTED else ""
    return f"choose from {', '.join(choices[:MOST_LISTED])}{more}"


def enumerated(names: Iterable[str]) -> str:
    """Return names as a phrase: ``a, b and c``."""
    *first, last = list(names) or ["none"]
    return f"{', '.join(first)} and {last}" if first else last


def printable(text: str) -> str:
    r"""Return one line that can neither steer a terminal nor break; other characters become Python escapes (``\x1b``)."""
    if text.isprintable():
        return text
    shown = (
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text.replace("\n", " ")
    )
    return "".join(shown)

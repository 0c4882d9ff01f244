"""Phrases of messages: lists of names, and advice on a name that is not known; mappings that give it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import fields
from typing import TextIO, TypeVar

from stoop.base.streams import flush_or_discard
from stoop.errors import StoopError, one_line

T = TypeVar("T")
MOST_LISTED = 16  #: names in a message


def nearest(name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """Return advice on a wrong name: up to three that resemble it, or all there are; of many the nearest.

    Parameters
    ----------
    name : str
    among : iterable of str
        Known names.
    cutoff : float
        Least resemblance, see :func:`difflib.get_close_matches`; case does not count.
    """
    choices = list(among)
    if meant := likely(name, choices, cutoff):
        return meant
    if len(choices) <= MOST_LISTED:
        return f"choose from {', '.join(choices) or 'none'}"
    return f"the nearest of {len(choices)} names are {enumerated(_similar(name, choices, 0.0))}"


def likely(name: str, among: Iterable[str], cutoff: float = 0.6) -> str:
    """Ask for up to three names that resemble a wrong one, see `nearest`; empty where none does."""
    found = _similar(name, among, cutoff)
    return f"did you mean {' or '.join(found)}?" if found else ""


def _similar(name: str, among: Iterable[str], cutoff: float) -> list[str]:
    lower = {c.lower(): c for c in reversed(list(among))}
    return [lower[c] for c in difflib.get_close_matches(name.lower(), list(lower), n=3, cutoff=cutoff)]


class UnknownNameError(StoopError, KeyError):
    """Nothing has this name."""

    def __str__(self) -> str:
        """Return the message; a KeyError alone would quote it."""
        return one_line(str(self.args[0]))


def unknown_name(name: object, among: Iterable[str]) -> UnknownNameError:
    """Return the error about a name, with the names that resemble it."""
    return UnknownNameError(f"no '{name}' here; {nearest(str(name), among)}")


class Names(dict[str, T]):
    """A dictionary that answers a wrong name with the names that resemble it."""

    def __missing__(self, name: str) -> T:
        raise unknown_name(name, self)


def duration(seconds: float) -> str:
    """Return a duration as 0:07, 12:30 or 3:05:00."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def remaining(seconds: float, done: float, total: float) -> str:
    """Return the time left, such as ``, 0:30 left``, at the speed of the `seconds` so far; empty where it is not known."""
    return f", {duration(seconds * (total - done) / done)} left" if 0.0 < done < total else ""


class Summarized:
    """A record whose text names its fields, with the length of those that have one, in place of their contents."""

    def __repr__(self) -> str:
        """Return the fields on one line."""
        values = ((item.name, getattr(self, item.name)) for item in fields(self))  # type: ignore[arg-type]
        named = [f"{name} ({len(x)})" if hasattr(x, "__len__") else name for name, x in values]
        return printable(f"<{type(self).__name__}: {', '.join(named)}>")


def enumerated(names: Iterable[str], most: int | None = None) -> str:
    """Return names as a phrase, those beyond the `most` counted: ``a, b and c``, ``a, b and 2 more``."""
    known = list(names) or ["none"]
    rest = [f"{len(known) - most} more"] if most is not None and len(known) > most else []
    *first, last = known[:most] + rest
    return f"{', '.join(first)} and {last}" if first else last


def printable(text: str) -> str:
    r"""Return one line that can neither steer a terminal nor break; other characters become Python escapes (``\x1b``)."""
    if text.isprintable():
        return text
    whole = text.replace("\n", " ")
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in whole)


def printable_lines(text: str) -> str:
    """Return lines, each `printable`."""
    return "\n".join(map(printable, text.split("\n")))


def show(text: str, stream: TextIO | None = None) -> None:
    """Print lines on stdout, or messages on another stream: with `stoop.cli.page`, the only way by which text reaches a terminal.

    Messages that nobody can read, of a pipe without a reader or on a full disk, stop no work.
    """
    if stream is None:
        print(printable_lines(text))
        return
    try:
        print(printable_lines(text), file=stream, flush=True)
    except OSError:
        flush_or_discard(stream)

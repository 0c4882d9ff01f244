"""Mappings and tuples by name, which say what a wrong name may have meant."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from stoop.base.text import nearest
from stoop.errors import StoopError, one_line

T = TypeVar("T")


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

"""Pairs of two lists of cases, where a whole product would say the same many times."""

from __future__ import annotations

from collections.abc import Iterable

SHARE = 3  #: each case meets one in so many of the other list's


def crossed(first: Iterable[str], second: Iterable[str]) -> list[tuple[str, str]]:
    """Return the pairs of cases that meet; every case of either list is in some, where the other has three."""
    others = list(second)
    return [(a, b) for i, a in enumerate(first) for j, b in enumerate(others) if (i + j) % SHARE == 0]

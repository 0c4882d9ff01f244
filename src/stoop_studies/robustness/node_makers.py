"""Makers of the nodes of a document: what may stand where, and what usually does.

A maker draws a node: the usual one, or a hostile one where the next choice is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from stoop_studies.robustness.document_trees import TEXTS, Branch, Node, hostile
from stoop_studies.robustness.log_grammars import Draw

Maker: TypeAlias = Callable[[Draw], Node]
SPREAD: Final = 0.2  #: of a number about its usual value, as a share
OPTIONAL: Final = 0.3  #: of the keys that may be left out, how many are written


def table(
    required: Mapping[str, Maker], optional: Mapping[str, Maker] | None = None, share: float = OPTIONAL
) -> Maker:
    """Return a maker of tables; a hostile one lacks a key, or has one more."""

    def make(draw: Draw) -> Node:
        pairs = [(key, maker(draw)) for key, maker in required.items()]
        pairs += [(key, maker(draw)) for key, maker in (optional or {}).items() if draw.rng.random() < share]
        if pairs and draw.rng.random() < 0.1 * draw.hostile:
            del pairs[draw.rng.randrange(len(pairs))]
        if draw.rng.random() < 0.1 * draw.hostile:
            pairs.insert(draw.rng.randrange(len(pairs) + 1), (draw.rng.choice(TEXTS), hostile(draw.rng)))
        return Branch(pairs)

    return make


def leaf(usual: Callable[[Draw], Node]) -> Maker:
    """Return a maker of one value."""
    return lambda draw: hostile(draw.rng) if draw.bad() else usual(draw)


def number(usual: float, spread: float = SPREAD) -> Maker:
    """Return a maker of numbers about a usual one."""
    return leaf(lambda draw: usual * math.exp(draw.rng.gauss(0.0, spread)))


def integer(most: int) -> Maker:
    """Return a maker of counts."""
    return leaf(lambda draw: draw.rng.randrange(most + 1))


def text(*words: str) -> Maker:
    """Return a maker of one of some words."""
    return leaf(lambda draw: draw.rng.choice(words))


def flag() -> Maker:
    """Return a maker of true and false."""
    return leaf(lambda draw: draw.rng.random() < 0.5)


def nothing() -> Maker:
    """Return a maker of a value that does not exist."""
    return leaf(lambda draw: None)


def several(maker: Maker, least: int, most: int) -> Maker:
    """Return a maker of lists; a hostile one has another length."""

    def make(draw: Draw) -> Node:
        count = draw.rng.choice((0, 1, most + 1, 50)) if draw.bad() else draw.rng.randint(least, most)
        return [maker(draw) for _ in range(count)]

    return make


def row(*makers: Maker) -> Maker:
    """Return a maker of lists with one entry of each maker; a hostile one lacks the last or repeats it."""

    def make(draw: Draw) -> Node:
        made = [maker(draw) for maker in makers]
        if draw.rng.random() < 0.1 * draw.hostile:
            made = draw.rng.choice((made[:-1], [*made, *made[-1:]]))
        return list(made)

    return make


def named(names: tuple[str, ...], maker: Maker, least: int = 1) -> Maker:
    """Return a maker of tables by names of the user's choice."""

    def make(draw: Draw) -> Node:
        chosen = draw.rng.sample(names, draw.rng.randint(min(least, len(names)), len(names)))
        return Branch([(draw.word(name), maker(draw)) for name in chosen])

    return make


def either(*makers: Maker) -> Maker:
    """Return a maker that is one of several."""
    return lambda draw: draw.rng.choice(makers)(draw)


def quantity(usual: float, *ties: str) -> Maker:
    """Return a maker of a number of a vehicle file: plain, with bounds and prior, or tied."""
    plain = number(usual)
    size = abs(usual) or 1.0

    def full(draw: Draw) -> Node:
        keys: list[tuple[str, Maker]] = [
            ("free", flag()),
            (
                "bounds",
                row(number(min(usual, 0.0) - 3.0 * size, 0.0), number(max(usual, 0.0) + 3.0 * size, 0.0)),
            ),
            ("prior", either(number(size), text("guess"))),
        ]
        chosen = [key for key in keys if draw.rng.random() < 0.5]
        pairs = [("value", plain(draw)), *((key, maker(draw)) for key, maker in chosen)]
        if draw.bad():
            pairs.append(
                draw.rng.choice(
                    (("mean", 0.1), ("tie", "mass.mass"), ("bounds", [1.0, 0.0]), ("prior", -1.0))
                )
            )
        return Branch(list(pairs))

    tied = text(*(f"={name}" for name in (*ties, "mass.mass"))) if ties else plain
    return lambda draw: (plain, plain, full, tied)[draw.rng.randrange(4)](draw)


def point(size: float = 0.3) -> Maker:
    """Return a maker of the coordinates of a point."""
    return row(quantity(size), quantity(0.0), quantity(-size))

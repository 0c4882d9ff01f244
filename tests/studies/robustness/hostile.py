"""Hostile numbers, words, trees and documents as Hypothesis strategies."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from dataclasses import dataclass

from hypothesis import strategies as st

from stoop.base.toml import quoted

FLOATS = (
    0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 5e-324, 1e-45, 3.5e38, -3.5e38, 1e154, 1e308, -1e308, 1e-9, 1e9, 1e15,
)  # fmt: skip
INTEGERS = (
    0,
    1,
    -1,
    2,
    7,
    255,
    2**31,
    2**53 + 1,
    2**63 - 1,
    2**63,
    2**64,
    -(2**63) - 1,
    10**25,
    10**400,
    -(10**400),
)
WORDS = (
    "", " ", "a", "x" * 300, "é", "名", "a b", "a,b", "a;b", "a/b", "../a", "a[0]", "a.b", "\x1b[31m", "\x00", "\x7f", "nan",
    "None", "timestamp", "__class__", "%s", "{}", "\u202e", "\ud7ff", "0", "-1", "1e999",
)  # fmt: skip
TEXTS = (
    *WORDS, "=", "=mass.mass", "=CLalpha", "guess", "standard", "log", "a" * 20_000, "\u200b", "1:2", "inf", "\n", "\t", "\\",
    '"""', "'''", "alpha^7", "1/(alpha-alpha)", "(((((alpha^6)^6)^6)^6)^6)", "__import__('os')", "(" * 190, "-" * 190 + "1",
    "+".join(["alpha"] * 33), "abs(abs(abs(alpha)))", "9" * 199, "((9^6)^2)*9e200", "abs(1,2)", "lambda: 0", "α", "1_0", "1j",
    "1e-320/1e10", "alpha or beta", "x{1..99999999}", "/etc/passwd",
)  # fmt: skip
LITERALS = (
    "1979-05-27T07:32:00Z", "1979-05-27", "07:32:00", "1e400", "1_000", "0xdeadbeef", "0b1", "+nan", "9" * 5000,
    "0." + "9" * 3000, "1e-99999", "--1", "", *("[" * depth + "1" + "]" * depth for depth in (5, 40, 200, 3000)),
    '{"a": ' * 100 + "1" + "}" * 100,
)  # fmt: skip
SHARES = (0.0, 0.02, 0.1, 0.4)  #: shares of hostile choices of a log or document


@dataclass(frozen=True)
class Raw:
    """Text that a document holds as it is: dates, numbers beyond any float, what no document may hold."""

    text: str


class Again(str):
    """A key that may come twice; written without quotes."""

    __slots__ = ()
    __eq__, __hash__ = object.__eq__, object.__hash__


hostile_numbers = st.sampled_from(FLOATS) | st.floats()
words = st.sampled_from(WORDS) | st.text(max_size=8)
leaves = st.one_of(
    hostile_numbers, st.sampled_from(INTEGERS), st.sampled_from(TEXTS), st.booleans(), st.none(),
    st.sampled_from(LITERALS).map(Raw),
)  # fmt: skip
values = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(TEXTS), inner, max_size=3),
    max_leaves=4,
)


def places(tree) -> list[tuple]:
    """Return holder and key of all nodes below the root."""
    found, left = [], [tree]
    while left:
        holder = left.pop()
        keys = holder if isinstance(holder, dict) else range(len(holder)) if isinstance(holder, list) else ()
        found += [(holder, key) for key in keys]
        left += [holder[key] for key in keys]
    return found


def _number(draw, tree, other) -> None:
    """Change a number a little or beyond measure."""
    numbers = [(h, k) for h, k in places(tree) if type(h[k]) in (int, float) and abs(h[k]) < 2**1000]
    if numbers:
        holder, key = draw(st.sampled_from(numbers))
        factors = st.sampled_from((-1.0, 0.0, 1e-9, 1e9, 0.1, 10.0, 1e300, 1.0 + 1e-12))
        holder[key] = draw(factors.map(lambda factor: holder[key] * factor) | hostile_numbers)


def _vary(draw, tree, other) -> None:
    """Change all numbers by a few per cent."""
    rng = draw(st.randoms(use_true_random=True))
    for holder, key in places(tree):
        if type(holder[key]) is float:
            holder[key] *= math.exp(rng.gauss(0.0, 0.05))


def _leaf(draw, tree, other) -> None:
    """Put hostile values in place of some leaves."""
    found = [(h, k) for h, k in places(tree) if not isinstance(h[k], dict | list)]
    for holder, key in draw(st.lists(st.sampled_from(found), min_size=1, max_size=6)) if found else ():
        holder[key] = draw(leaves)


def _node(draw, tree, other) -> None:
    """Put a hostile value, a node of another document, or the same in another type, in place of a node."""
    if found := places(tree):
        holder, key = draw(st.sampled_from(found))
        grafts = st.sampled_from(places(other) or [(holder, key)]).map(
            lambda place: copy.deepcopy(place[0][place[1]])
        )
        old = holder[key]
        types = st.sampled_from(
            (str(old)[:50], [old], {"value": old}, list(old) if isinstance(old, dict) else 1)
        )
        holder[key] = draw(st.one_of(values, grafts, types))


def _delete(draw, tree, other) -> None:
    """Take a node out."""
    if found := places(tree):
        holder, key = draw(st.sampled_from(found))
        del holder[key]


def _exchange(draw, tree, other) -> None:
    """Let two nodes change places."""
    if found := places(tree):
        (one, i), (two, k) = draw(st.sampled_from(found)), draw(st.sampled_from(found))
        one[i], two[k] = copy.deepcopy(two[k]), copy.deepcopy(one[i])


def _add(draw, tree, other) -> None:
    """Add a key, one twice, or one of many parts; or an entry."""
    holder = draw(st.sampled_from([tree, *(h[k] for h, k in places(tree))]))
    if isinstance(holder, dict):
        again = st.sampled_from(sorted(map(str, holder)) or ["a"]).map(Again)
        dotted = st.sampled_from((2, 30, 500, 20_000)).map(lambda parts: Again(".".join("a" * parts)))
        holder[draw(st.one_of(st.sampled_from(TEXTS), again, dotted))] = draw(values)
    elif isinstance(holder, list):
        size = draw(st.sampled_from((0, 1, 50, 3000))) // (1 + len(places(holder)) // 8)
        holder[:] = (
            [copy.deepcopy(holder[i % len(holder)]) for i in range(size)] if holder else [draw(values)]
        )


def _rename(draw, tree, other) -> None:
    """Give a key another name."""
    if found := [place for place in places(tree) if isinstance(place[0], dict)]:
        holder, key = draw(st.sampled_from(found))
        holder[draw(st.sampled_from(TEXTS) | st.sampled_from([str(k) for _, k in found]))] = holder.pop(key)


EDITS: tuple[Callable, ...] = (_number, _vary, _leaf, _node, _delete, _exchange, _add, _rename)


@st.composite
def damaged_trees(draw, sound):
    """Draw one of some sound trees with up to four edits."""
    tree, other = copy.deepcopy(draw(st.sampled_from(sound))), draw(st.sampled_from(sound))
    for edit in draw(st.lists(st.sampled_from(EDITS), max_size=4)):
        edit(draw, tree, other)
    return tree


def written(node, mark: str, text: Callable[[str], str], words: tuple[str, str, str], nothing: str) -> str:
    """Write a node in one line; ``mark`` stands between key and value, ``words`` are nan, inf and -inf."""

    def inner(one):
        return written(one, mark, text, words, nothing)

    match node:
        case dict():
            keys = (key if isinstance(key, Again) else text(str(key)) for key in node)
            return (
                "{"
                + ", ".join(f"{k}{mark}{inner(one)}" for k, one in zip(keys, node.values(), strict=True))
                + "}"
            )
        case list() | tuple():
            return "[" + ", ".join(map(inner, node)) + "]"
        case str():
            return text(node)
        case Raw():
            return node.text
        case None:
            return nothing
        case bool():
            return str(node).lower()
        case float() if not math.isfinite(node):
            return words[0] if math.isnan(node) else words[1 + (node < 0)]
    return repr(node)


def to_json(tree) -> bytes:
    """Write a tree as JSON, whatever stands in it; a key that comes twice has quotes here, too."""

    def text(one: str) -> str:
        return json.dumps(one, ensure_ascii=False)

    return written(tree, ": ", text, ("NaN", "Infinity", "-Infinity"), "null").encode("utf-8", "replace")


def to_toml(tree) -> bytes:
    """Write a tree as TOML, a header for each table at its top."""

    def inline(node) -> str:
        return written(node, " = ", quoted, ("nan", "inf", "-inf"), '""')

    def key(one: str) -> str:
        return one if isinstance(one, Again) else quoted(str(one))

    if not isinstance(tree, dict):
        return inline(tree).encode("utf-8", "replace")
    lines = [f"{key(k)} = {inline(x)}" for k, x in tree.items() if not isinstance(x, dict)]
    for name, table in tree.items():
        if isinstance(table, dict):
            lines += [f"[{key(name)}]", *(f"{key(k)} = {inline(x)}" for k, x in table.items())]
    return "\n".join(lines).encode("utf-8", "replace")

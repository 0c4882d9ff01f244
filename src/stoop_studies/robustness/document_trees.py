"""Documents as trees: hostile values, damage to nodes, and writers of TOML and JSON that write whatever stands in a tree.

A table is a list of keys and values, so that a key may come twice; a `Raw` is written as it is, so that dates, numbers beyond
any float and what no document may hold can be written.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any, Final, TypeAlias

from stoop.base.toml import quoted
from stoop_studies.robustness.log_grammars import FLOATS, WIDE, WORDS, Draw


@dataclass(frozen=True)
class Raw:
    """Text that is written as it is."""

    text: str


class Plain(str):
    """A key that TOML writes without quotes, though it may need them, or stand for many keys."""

    __slots__ = ()


@dataclass
class Branch:
    """A table: keys and values, in order, perhaps twice."""

    pairs: list[tuple[str, Node]]


Node: TypeAlias = "Branch | list[Any] | str | int | float | bool | Raw | None"
Place: TypeAlias = "tuple[Branch | list[Any], int]"  #: of a node: what holds it, and its index there


@dataclass(frozen=True)
class Document:
    """A kind of document: its grammar, those that are sound, how trees of it are written, and what is asked of it."""

    draw: Callable[[Draw], Node]
    ask: Callable[[Path, bytes, Random], str]  #: folder, content -> outcome; refused by an error of ours
    write: Callable[[Node, Random], bytes]
    kept: Callable[[], tuple[Node, ...]] = tuple  #: sound ones beside those of the grammar
    form: str = "lines"  #: of `damaged_logs.FORMS`, by which its bytes are damaged


INTEGERS: Final = (
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
    10**WIDE,
    -(10**WIDE),
)
DATES: Final = ("1979-05-27T07:32:00Z", "1979-05-27", "07:32:00", "1979-05-27T00:32:00.999999-07:00")
LITERALS: Final = (
    "1e400",
    "-1e400",
    "1_000",
    "0xdeadbeef",
    "0o17",
    "0b1",
    "+nan",
    "-inf",
    "9" * 5000,
    "0." + "9" * 3000,
    "1e-99999",
    "--1",
    "",
)
DEPTHS: Final = (5, 40, 200, 3000)
SIZES: Final = (0, 1, 50, 3000)  #: of a list that is grown
TEXTS: Final = (
    *WORDS,
    "=",
    "=mass.mass",
    "=CLalpha",
    "guess",
    "standard",
    "log",
    "a" * 20_000,
    "\u200b",
    "1:2",
    "inf",
    "\n",
    "\t",
    "\\",
    '"""',
    "'''",
)


def hostile(rng: Random) -> Node:
    """Draw a value that no document should hold there."""
    kind = rng.randrange(11)
    if kind < 2:
        return rng.choice(INTEGERS)
    if kind < 4:
        return rng.choice(FLOATS)
    if kind < 6:
        return rng.choice(TEXTS)
    if kind == 6:
        return Raw(rng.choice((*DATES, *LITERALS)))
    if kind == 7:
        return rng.choice((True, False, None))
    if kind == 8:
        return rng.choice(([], Branch([]), [[]], [Branch([])], [0.0] * 3, [1.0, "a"]))
    if kind == 9:
        return nested(rng, rng.choice(DEPTHS))
    return Branch([(rng.choice(TEXTS), rng.choice(FLOATS)) for _ in range(rng.randrange(1, 4))])


def nested(rng: Random, depth: int) -> Node:
    """Return lists in lists, or tables in tables."""
    node: Node = 1.0
    tables = rng.random() < 0.5
    if depth > 100:  # as text: a tree so deep could not be copied
        return Raw("[" * depth + "1" + "]" * depth)
    for _ in range(depth):
        node = Branch([("a", node)]) if tables else [node]
    return node


def tree_of(value: Any) -> Node:
    """Return the tree of a parsed document."""
    if isinstance(value, Mapping):
        return Branch([(str(key), tree_of(one)) for key, one in value.items()])
    if isinstance(value, list | tuple):
        return [tree_of(one) for one in value]
    return value if isinstance(value, str | int | float | bool | None) else Raw(str(value))


def copied(node: Node) -> Node:
    """Return a copy of a tree."""
    if isinstance(node, Branch):
        return Branch([(key, copied(one)) for key, one in node.pairs])
    return [copied(one) for one in node] if isinstance(node, list) else node


def places(root: Node) -> list[Place]:
    """Return the places of all nodes below the root."""
    found: list[Place] = []
    left = [root]
    while left:
        holder = left.pop()
        if isinstance(holder, Branch | list):
            count = len(holder.pairs) if isinstance(holder, Branch) else len(holder)
            found += [(holder, i) for i in range(count)]
            left += [at((holder, i)) for i in range(count)]
    return found


def at(place: Place) -> Node:
    """Return the node at a place."""
    holder, i = place
    node: Node = holder.pairs[i][1] if isinstance(holder, Branch) else holder[i]
    return node


def put(place: Place, node: Node) -> None:
    """Put a node at a place."""
    holder, i = place
    if isinstance(holder, Branch):
        holder.pairs[i] = (holder.pairs[i][0], node)
    else:
        holder[i] = node


@dataclass(frozen=True)
class TreeDamager:
    """Ways to damage a tree, perhaps with nodes of another; the same seed gives the same damage."""

    rng: Random
    other: Node

    def _leaf(self, found: list[Place]) -> Place:
        leaves = [place for place in found if not isinstance(at(place), Branch | list)]
        return self.rng.choice(leaves or found)

    def _value(self, found: list[Place]) -> None:
        put(self._leaf(found), hostile(self.rng))

    def _number(self, found: list[Place]) -> None:
        numbers = [p for p in found if isinstance(at(p), int | float) and not isinstance(at(p), bool)]
        place = self.rng.choice(numbers or found)
        value = at(place)
        if isinstance(value, int | float):
            scaled = (value if abs(value) < 2**1000 else 1.0) * self.rng.choice(
                (-1.0, 0.0, 1e-9, 1e9, 0.1, 10.0, 1e300, 1.0 + 1e-12)
            )
            put(place, self.rng.choice((scaled, *FLOATS, *INTEGERS)))

    def _retype(self, found: list[Place]) -> None:
        place = self.rng.choice(found)
        value = at(place)
        if isinstance(value, Branch):
            put(place, self.rng.choice(([one for _, one in value.pairs], "a", 1.0)))
        elif isinstance(value, list):
            put(
                place,
                self.rng.choice((Branch([(str(i), one) for i, one in enumerate(value)]), "a", 0, [value])),
            )
        else:
            put(
                place,
                self.rng.choice((str(value)[:50], [value], Branch([("value", value)]), True, 1, 0.5, None)),
            )

    def _delete(self, found: list[Place]) -> None:
        holder, i = self.rng.choice(found)
        del (holder.pairs if isinstance(holder, Branch) else holder)[i]

    def _duplicate(self, found: list[Place]) -> None:
        holder, i = self.rng.choice(found)
        items: list[Any] = holder.pairs if isinstance(holder, Branch) else holder
        items.insert(self.rng.randrange(len(items) + 1), items[i])

    def _swap(self, found: list[Place]) -> None:
        one, two = self.rng.choice(found), self.rng.choice(found)
        first, second = copied(at(one)), copied(at(two))
        put(one, second)
        put(two, first)

    def _rename(self, found: list[Place]) -> None:
        keyed = [(holder, i) for holder, i in found if isinstance(holder, Branch)]
        if keyed:
            holder, i = self.rng.choice(keyed)
            names = [h.pairs[k][0] for h, k in keyed]
            dotted = Plain(".".join("a" for _ in range(self.rng.choice((2, 30, 500, 20_000)))))
            holder.pairs[i] = (self.rng.choice((*TEXTS, self.rng.choice(names), dotted)), holder.pairs[i][1])

    def _graft(self, found: list[Place]) -> None:
        donors = places(self.other)
        if donors:
            put(self.rng.choice(found), copied(at(self.rng.choice(donors))))

    def _nest(self, found: list[Place]) -> None:
        put(self.rng.choice(found), nested(self.rng, self.rng.choice(DEPTHS)))

    def _grow(self, found: list[Place]) -> None:
        lists = [p for p in found if isinstance(at(p), list)]
        place = self.rng.choice(lists or found)
        value = at(place)
        items = value if isinstance(value, list) and value else [value]
        size = self.rng.choice(SIZES) // (1 + len(places(items)) // 8)
        put(place, [copied(items[i % len(items)]) for i in range(size)])

    def _add(self, found: list[Place]) -> None:
        holder, _ = self.rng.choice(found)
        if isinstance(holder, Branch):
            holder.pairs.append((self.rng.choice(TEXTS), hostile(self.rng)))
        else:
            holder.append(hostile(self.rng))


TREE_DAMAGES: Final[Mapping[str, tuple[Callable[[TreeDamager, list[Place]], None], str]]] = {
    "value": (TreeDamager._value, "a number or word becomes a hostile one"),
    "number": (TreeDamager._number, "a number becomes another, or an extreme one"),
    "retype": (TreeDamager._retype, "a node becomes one of another type"),
    "delete": (TreeDamager._delete, "a node is taken out"),
    "duplicate": (TreeDamager._duplicate, "a key or entry comes twice"),
    "exchange": (TreeDamager._swap, "two nodes change places"),
    "rename": (TreeDamager._rename, "a key becomes another"),
    "graft": (TreeDamager._graft, "a node of another document, at another place"),
    "nest": (TreeDamager._nest, "lists in lists, or tables in tables, up to thousands deep"),
    "grow": (TreeDamager._grow, "a list of another length, up to thousands"),
    "add": (TreeDamager._add, "a key or entry more"),
}  #: name -> method, and what the page says of it


def damaged_tree(rng: Random, sound: Node, other: Node) -> tuple[str, Node]:
    """Return the name of the first damage and a damaged copy of a sound tree."""
    tree, first = copied(sound), ""
    damager = TreeDamager(rng, other)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        name = rng.choice(tuple(TREE_DAMAGES))
        first = first or name
        if found := places(tree):
            TREE_DAMAGES[name][0](damager, found)
    return first, tree


def _scalar(node: Node, infinite: Mapping[str, str]) -> str:
    """Return a number, a flag or raw text as TOML or JSON writes it."""
    if isinstance(node, Raw):
        return node.text
    if isinstance(node, bool):
        return str(node).lower()
    if isinstance(node, float) and not math.isfinite(node):
        return infinite[str(node)]
    return hex(node) if isinstance(node, int) and abs(node) > 10**4000 else str(node)


TOML_WORDS: Final = {"nan": "nan", "inf": "inf", "-inf": "-inf"}
JSON_WORDS: Final = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}


def _pieces(
    node: Node, mark: str, text: Callable[[str], str], words: Mapping[str, str], nothing: str
) -> Iterator[str]:
    """Yield the pieces of a node in one line, without recursion; `mark` stands between key and value."""
    left: list[Any] = [(node,)]
    while left:
        one = left.pop()
        if isinstance(one, str):
            yield one
            continue
        (value,) = one
        if isinstance(value, Branch):
            left.append("}")
            for i, (key, inner) in reversed(list(enumerate(value.pairs))):
                left += [(inner,), f"{', ' if i else ''}{text(key)}{mark}"]
            left.append("{")
        elif isinstance(value, list):
            left.append("]")
            for i, inner in reversed(list(enumerate(value))):
                left += [(inner,), *([", "] if i else [])]
            left.append("[")
        elif isinstance(value, str):
            yield text(value)
        else:
            yield nothing if value is None else _scalar(value, words)


def to_json(node: Node, rng: Random) -> bytes:
    """Write a tree as JSON, with escapes or without."""
    ascii_only = rng.random() < 0.5
    parts = _pieces(node, ": ", lambda t: json.dumps(t, ensure_ascii=ascii_only), JSON_WORDS, "null")
    return "".join(parts).encode("utf-8", "surrogatepass")


def _inline(node: Node) -> str:
    return "".join(_pieces(node, " = ", _toml_text, TOML_WORDS, '""'))


def _toml_text(text: str) -> str:
    return text if isinstance(text, Plain) else quoted(text)


def to_toml(node: Node, rng: Random) -> bytes:
    """Write a tree as TOML: tables with headers, dotted or in one line."""
    lines: list[str] = []
    if not isinstance(node, Branch):
        return _inline(node).encode("utf-8", "surrogatepass")
    headers = rng.random() < 0.8
    left: list[tuple[str, Branch]] = [("", node)]
    for _ in range(400):
        if not left:
            break
        path, table = left.pop(0)
        later: list[tuple[str, Branch]] = []
        for key, value in table.pairs:
            name = f"{path}.{_toml_text(key)}" if path else _toml_text(key)
            rows = (
                value
                if isinstance(value, list) and value and all(isinstance(v, Branch) for v in value)
                else []
            )
            if isinstance(value, Branch) and headers and path.count('"."') < 3:
                later.append((name, value))
            elif rows and headers and not path:
                for row in rows:
                    lines_of = [f"{_toml_text(k)} = {_inline(v)}" for k, v in row.pairs]
                    later.append((f"[{name}]", Branch([("", Raw("\n".join(lines_of)))])))
            elif isinstance(value, Raw) and not key:
                lines.append(value.text)
            else:
                lines.append(f"{_toml_text(key)} = {_inline(value)}")
        left = later + left
        if left:
            lines.append(f"[{left[0][0]}]")
    return "\n".join(lines).encode("utf-8", "surrogatepass")

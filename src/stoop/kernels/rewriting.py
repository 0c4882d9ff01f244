"""Sums rewritten where that saves operations.

A pass rewrites what saves operations by itself. As parts that several sums have in common are computed once, a pass may
cost more in total: then it is undone.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import sympy as sp

from stoop.kernels.algebra import (
    ONE,
    Algebra,
    Call,
    Powers,
    Product,
    Sum,
    added,
    over,
    quotient,
    split_sign,
    times,
    trivial,
)
from stoop.kernels.listing import Listing

_OPERATION: Final = re.compile(r"[*/]| [+-] |sqrt")  #: in a line of source
_HIGHEST: Final = 3  #: power of a sum of two terms that is multiplied out


class Rewriter:
    """The passes over what some products are made of."""

    def __init__(self, algebra: Algebra, roots: Sequence[Product]) -> None:
        self.algebra = algebra
        self.root = algebra.node(Call("return", tuple(roots)))

    def run(self) -> tuple[Product, ...]:
        """Rewrite as long as that saves operations; return the products."""
        dissolve, gather, least = self.dissolve, self.gather, self.operations()
        for passes in (
            (dissolve,),
            (gather, dissolve),
            (self.nest,),
            (dissolve,),
            (self.fold,),
            (self.pair,),
        ):
            kept = self.algebra.kept()
            for rewrite in passes:
                rewrite()
            count = self.operations()
            if count >= least:
                self.algebra.restore(kept)
            least = min(least, count)
        return self.products(self.root)

    def operations(self) -> int:
        """Return the operations of the products, written out without repetition."""
        symbols = {n: f"n{n}" for n in self.order() if isinstance(self.algebra.nodes[n], sp.Symbol)}
        constants: dict[Any, str] = {}
        listing = Listing(self.algebra, symbols, lambda c: constants.setdefault(c, f"k{len(constants)}"))
        return sum(len(_OPERATION.findall(line)) for line in listing.source(self.products(self.root)))

    # --- who uses what

    def products(self, node: int) -> tuple[Product, ...]:
        """Return the products that a node is made of."""
        found = self.algebra.nodes[node]
        if isinstance(found, Call):
            return found.arguments
        return tuple((c, p) for p, c in found.items()) if isinstance(found, dict) else ()

    def order(self) -> list[int]:
        """Return all nodes that are used, each after those that it is made of."""
        done: dict[int, None] = {}
        self._visit(self.root, done)
        return list(done)

    def _visit(self, node: int, done: dict[int, None]) -> None:
        if node not in done:
            for _, powers in self.products(node):
                for inner, _ in powers:
                    self._visit(inner, done)
            done[node] = None

    def seen(self, states: Sequence[int]) -> tuple[int, ...]:
        """Return the states, whose derivatives come first of all products, that the others depend on, by way of states too."""
        found: dict[int, None] = {}
        derivatives = self.products(self.root)
        wanted = list(derivatives[len(states) :])
        while wanted:
            for node, _ in wanted.pop()[1]:
                more = {n for n in states if n not in found}
                self._visit(node, found)
                wanted += [d for n, d in zip(states, derivatives, strict=False) if n in more and n in found]
        return tuple(i for i, node in enumerate(states) if node in found)

    def sums(self) -> Iterator[tuple[int, Sum]]:
        """Return the sums that are used."""
        for node in self.order():
            terms = self.algebra.terms(node)
            if terms is not None:
                yield node, terms

    def counts(self) -> Counter[Powers]:
        """Return how many products have the same powers."""
        return Counter(p for node in self.order() for _, p in self.products(node))

    def users(self) -> dict[int, list[tuple[int, Product]]]:
        """Return of each node the products that it is a factor of, and the nodes that these belong to."""
        found: dict[int, list[tuple[int, Product]]] = {}
        for owner in self.order():
            for product in self.products(owner):
                for node, _ in product[1]:
                    found.setdefault(node, []).append((owner, product))
        return found

    # --- passes

    def gather(self) -> None:
        """Take out what sums are multiplied by: a (b S + c T) of a b S + a c T, if at most as many sums have these products."""
        counts = self.counts()
        for node, terms in list(self.sums()):
            groups: dict[Powers, list[Powers]] = {}
            for powers in terms:
                for inner, power in powers:
                    rest = over(powers, ((inner, 2),))
                    if rest and power == 2 and self.algebra.terms(inner) is not None:
                        groups.setdefault(rest, []).append(powers)
            if groups:
                rest, group = max(groups.items(), key=lambda item: len(item[1]))
                if len(group) >= max(2, *(counts[p] for p in group)):
                    self._take_out(node, rest, group)

    def nest(self) -> None:
        """Take out factors that some terms of a sum share: x (a + b x) of a x + b x^2."""
        for node, _ in list(self.sums()):
            counts = self.counts()
            while (found := self._shared(self.algebra.terms(node) or {}, counts)) is not None:
                self._take_out(node, *found)

    def _shared(self, terms: Sum, counts: Counter[Powers]) -> tuple[Powers, list[Powers]] | None:
        """Return the factor that saves most multiplications, and the terms that have it."""
        groups: dict[tuple[int, bool], list[tuple[int, Powers]]] = {}
        for powers in terms:
            for node, power in powers:
                groups.setdefault((node, power > 0), []).append((power, powers))
        best, most = None, 1
        for (node, _), members in groups.items():
            alone = {p: len(p) == 1 and abs(p[0][1]) == 2 for _, p in members}
            saved = sum(not trivial(terms[p]) if bare else counts[p] <= 1 for p, bare in alone.items())
            if saved > most and len(members) < len(terms):
                power = min((power for power, _ in members), key=abs)
                best, most = (((node, power),), [p for _, p in members]), saved
        return best

    def _take_out(self, node: int, factor: Powers, group: Sequence[Powers]) -> None:
        terms = dict(self.algebra.terms(node) or {})
        inner = self.algebra.factored({over(p, factor): terms.pop(p) for p in group})
        taken = self.algebra.multiply((ONE, factor), inner)
        self.algebra.replace(node, added([*((c, p) for p, c in terms.items()), taken]))

    def dissolve(self) -> None:
        """Write sums out in those that they stand in with constant coefficients, as long as that saves operations."""
        changed = True
        while changed:
            users = self.users()
            changed = any(self._dissolved(group, users) for group in self._groups())

    def _groups(self) -> Iterator[tuple[int, ...]]:
        single = [node for node, _ in self.sums()]
        yield from ((node,) for node in single)
        for _, terms in list(self.sums()):
            inner = [p[0][0] for p in terms if len(p) == 1 and p[0][1] == 2]
            inner = [node for node in inner if self.algebra.terms(node) is not None]
            if len(inner) > 1:
                yield tuple(inner)

    def _dissolved(self, group: tuple[int, ...], users: Mapping[int, Sequence[tuple[int, Product]]]) -> bool:
        """Write a group of sums out in all that they stand in, and return true, or leave them, and return false."""
        owners = {o for node in group for o, (_, p) in users.get(node, []) if self._open(o, p, group)}
        gain = 0
        for node in group:
            if node in owners or node not in users:
                return False
            if all(self._open(o, p, group) for o, (_, p) in users[node]):
                gain += _cost(self.algebra.terms(node) or {})
        new = {o: self._written_out(o, group) for o in sorted(owners)}
        gain += sum(_cost(self.algebra.terms(o) or {}) - _cost(terms) for o, terms in new.items())
        if gain <= 0:
            return False
        for owner, terms in new.items():
            self.algebra.replace(owner, terms)
        return True

    def _open(self, owner: int, powers: Powers, group: tuple[int, ...]) -> bool:
        """Return whether a product of an owner is a coefficient times a power of a sum of a group, to be written out."""
        if self.algebra.terms(owner) is None or len(powers) != 1 or powers[0][0] not in group:
            return False
        node, power = powers[0]
        terms = self.algebra.terms(node) or {}
        return power == 2 or (power in range(4, 2 * _HIGHEST + 1, 2) and len(terms) == 2)

    def _written_out(self, owner: int, group: tuple[int, ...]) -> Sum:
        out: list[Product] = []
        for coefficient, powers in self.products(owner):
            parts: list[Product] = [(coefficient, powers)]
            if self._open(owner, powers, group):
                node, power = powers[0]
                parts = [(coefficient, ())]
                for _ in range(power // 2):
                    parts = [(c * d, times(p, q)) for c, p in parts for d, q in self.products(node)]
            out += parts
        return added(out)

    def fold(self) -> None:
        """Multiply the coefficient of a sum, where all its products have the same, into its terms."""
        for node, terms in list(self.sums()):
            users = self.users()[node]
            coefficients = {split_sign(c)[1] for _, (c, _) in users}
            alone = all(dict(p)[node] == 2 for _, (_, p) in users)
            multiplications = sum(bool(p) and trivial(c) for p, c in terms.items())
            if alone and len(coefficients) == 1 and multiplications < len({p for _, (_, p) in users}):
                (factor,) = coefficients
                if not trivial(factor):
                    self._move(node, factor, users)

    def _move(self, node: int, factor: Any, users: Sequence[tuple[int, Product]]) -> None:
        self.algebra.replace(node, {p: c * factor for p, c in (self.algebra.terms(node) or {}).items()})
        for owner in dict.fromkeys(o for o, _ in users):
            products = self.products(owner)
            signed = [(quotient(c, factor) if any(n == node for n, _ in p) else c, p) for c, p in products]
            self.algebra.replace(owner, self._with(owner, signed))

    def separate(self, inputs: Iterable[Any]) -> list[int]:
        """Make nodes of what depends on inputs and parameters alone; return those that anything else needs."""
        own = self._of_inputs(inputs)
        for node in self.order():
            if node in own:
                continue
            terms = self.algebra.terms(node)
            if terms is not None:
                self._separate_terms(node, terms, own)
            self.algebra.replace(node, self._with(node, [self._apart(p, own) for p in self.products(node)]))
        own = self._of_inputs(inputs)
        others = (self.products(node) for node in self.order() if node not in own)
        needed = dict.fromkeys(inner for parts in others for _, powers in parts for inner, _ in powers)
        return [node for node in needed if node in own]

    def affine(self, node: int, inputs: Sequence[int]) -> bool:
        """Return whether a node is a constant and multiples of inputs: its mean is its value at the mean of inputs."""
        terms = self.algebra.terms(node)
        if terms is None:
            return node in inputs
        return all(not p or (len(p) == 1 and p[0][1] == 2 and self.affine(p[0][0], inputs)) for p in terms)

    def _of_inputs(self, inputs: Iterable[Any]) -> set[int]:
        own, symbols = set[int](), set(inputs)
        for node in self.order():
            found = self.algebra.nodes[node]
            if found in symbols if isinstance(found, sp.Symbol) else self._inside(node, own):
                own.add(node)
        return own - {self.root}

    def _inside(self, node: int, own: set[int]) -> bool:
        return all(inner in own for _, powers in self.products(node) for inner, _ in powers)

    def _separate_terms(self, node: int, terms: Sum, own: set[int]) -> None:
        """Make a sum of the terms of a sum that depend on inputs and parameters alone."""
        group = {p: c for p, c in terms.items() if all(n in own for n, _ in p)}
        if any(group) and len(group) > 1:
            rest = {p: c for p, c in terms.items() if p not in group}
            self.algebra.replace(node, {((self.algebra.node(group), 2),): ONE, **rest})

    def _apart(self, product: Product, own: set[int]) -> Product:
        """Make one node of the factors of a product that depend on inputs and parameters alone."""
        coefficient, powers = product
        group = tuple((n, e) for n, e in powers if n in own)
        sign, size = split_sign(coefficient)
        if not group or (len(group) == 1 and group[0][1] == 2 and size == 1):
            return product
        return sp.Integer(sign), times(over(powers, group), ((self.algebra.node({group: size}), 2),))

    def _with(self, node: int, products: Sequence[Product]) -> Any:
        found = self.algebra.nodes[node]
        if isinstance(found, Call):
            return Call(found.name, tuple(products))
        return added(products) if isinstance(found, dict) else found

    def pair(self) -> None:
        """Add terms with equal coefficients first: c (x - y) of c x - c y."""
        for node, terms in list(self.sums()):
            equal: dict[Any, list[Powers]] = {}
            for powers, coefficient in terms.items():
                if powers and not trivial(coefficient):
                    equal.setdefault(split_sign(coefficient)[1], []).append(powers)
            for group in equal.values():
                if 1 < len(group) < len(terms):
                    self._take_out(node, (), group)


def _cost(terms: Sum) -> int:
    """Return the operations of a sum, products of its nodes aside."""
    return len(terms) - 1 + sum(bool(p) and not trivial(c) for p, c in terms.items())

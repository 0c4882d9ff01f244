"""Straight-line source of some products: what several have in common is computed once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, Final

import sympy as sp

from stoop.kernels.algebra import Algebra, Call, Product, split_sign

Signed = tuple[int, int]  #: a sign and a value
#: in multiply-adds; of all others 1
_LATENCY: Final = {"name": 0, "fabs": 0, "inverse": 4, "sqrt": 5, "atan2": 16}


class Listing:
    """The values of a function and how each is computed from others.

    Parameters
    ----------
    algebra : Algebra
    names : mapping
        Name of each node that is an argument of the function.
    constant : callable
        Returns the name of a coefficient.
    """

    def __init__(self, algebra: Algebra, names: Mapping[int, str], constant: Callable[[Any], str]) -> None:
        self.algebra, self.names, self.constant = algebra, names, constant
        self.values: list[tuple[str, Any]] = []  #: of each value: what it is, and of what
        self._places: dict[Hashable, int] = {}
        self._nodes: dict[int, int] = {}

    def source(self, roots: Sequence[Product]) -> list[str]:
        """Return the lines of a function that returns the tuple of some products."""
        signed = [self.product(root) for root in roots]
        self._share("product", self._factor_pairs, self._with_factor)
        self._share("sum", self._term_pairs, self._with_term)
        return _Writer(self.values).lines(signed)

    @property
    def used(self) -> set[str]:
        """Return the names of arguments and constants that the function needs."""
        return {of for kind, of in self.values if kind == "name"}

    def place(self, kind: str, of: Any) -> int:
        """Return a value, the same for the same."""
        key = (kind, of)
        if key not in self._places:
            self._places[key] = len(self.values)
            self.values.append(key)
        return self._places[key]

    def product(self, product: Product) -> Signed:
        """Return the value of a coefficient times powers."""
        coefficient, powers = product
        sign, size = split_sign(coefficient)
        factors = []
        if size != 1 or not powers:
            name = repr(float(size)) if size.is_Number else self.constant(size)
            factors.append(self.place("name", name))
        for node, power in powers:
            value = self._node(node)
            whole, half = divmod(abs(power), 2)
            parts = [value] * whole + [self.place("call", ("sqrt", ((1, value),)))] * half
            factors += [self.place("inverse", part) for part in parts] if power < 0 else parts
        return sign, factors[0] if len(factors) == 1 else self.place("product", tuple(sorted(factors)))

    def _node(self, node: int) -> int:
        if node not in self._nodes:
            self._nodes[node] = self._computed(node)
        return self._nodes[node]

    def _computed(self, node: int) -> int:
        if node in self.names:
            return self.place("name", self.names[node])
        found = self.algebra.nodes[node]
        if isinstance(found, Call):
            return self.place("call", (found.name, tuple(map(self.product, found.arguments))))
        if isinstance(found, sp.Symbol):
            raise KeyError(f"{found} is no argument of the function")
        if not found:  # what cancelled when it was written out
            return self.place("name", "0.0")
        terms = [self.product((c, p)) for p, c in found.items()]
        return self.place("sum", tuple(sorted((value, sign) for sign, value in terms)))

    # --- common parts

    def _share(
        self, kind: str, pairs: Callable[[Any], set[Any]], replaced: Callable[[Any, Any, int], Any]
    ) -> None:
        """Compute the pair that most values of a kind have in common once, until no two have one in common."""
        of = {i: pairs(value) for i, (k, value) in enumerate(self.values) if k == kind}
        counts = Counter(pair for found in of.values() for pair in found)
        while counts:
            pair, count = min(counts.items(), key=lambda item: (-item[1], item[0]))
            if count < 2:
                return
            shared = self.place(kind, pair)
            for i in [i for i, found in of.items() if i != shared and pair in found]:
                counts.subtract(of[i])
                self.values[i] = (kind, replaced(self.values[i][1], pair, shared))
                of[i] = pairs(self.values[i][1])
                counts.update(of[i])
            if shared not in of:
                of[shared] = {pair}
                counts[pair] += 1

    @staticmethod
    def _factor_pairs(factors: tuple[int, ...]) -> set[tuple[int, int]]:
        return {(a, b) for i, a in enumerate(factors) for b in factors[i + 1 :]}

    @staticmethod
    def _with_factor(factors: tuple[int, ...], pair: tuple[int, int], shared: int) -> tuple[int, ...]:
        left = list(factors)
        for factor in pair:
            left.remove(factor)
        return tuple(sorted([*left, shared]))

    @staticmethod
    def _term_pairs(terms: tuple[Signed, ...]) -> set[tuple[Signed, Signed]]:
        return {((a, 1), (b, one * other)) for i, (a, one) in enumerate(terms) for b, other in terms[i + 1 :]}

    @staticmethod
    def _with_term(terms: tuple[Signed, ...], pair: tuple[Signed, Signed], shared: int) -> tuple[Signed, ...]:
        (a, _), (b, relative) = pair
        sign = next(s for s in (1, -1) if (a, s) in terms and (b, s * relative) in terms)
        left = list(terms)
        left.remove((a, sign))
        left.remove((b, sign * relative))
        return tuple(sorted([*left, (shared, sign)]))


class _Writer:
    """Writes values, each after those that it is computed from, and in a sum those first that are known first."""

    def __init__(self, values: Sequence[tuple[str, Any]]) -> None:
        self.values = values
        self.written: dict[int, str] = {}
        self.depths: dict[int, int] = {}
        self.out: list[str] = []
        self.inverses: Counter[int] = Counter()

    def lines(self, roots: Sequence[Signed]) -> list[str]:
        """Return the lines."""
        reached: dict[int, None] = {}
        for _, value in roots:
            self._reach(value, reached)
        for value in [v for _, v in roots] + [part for v in reached for part in self._parts(v)]:
            if self.values[value][0] == "inverse":
                self.inverses[value] += 1
        returned = "".join(f"{'-' if sign < 0 else ''}{self.name(value)}, " for sign, value in roots)
        return [*self.out, f"return ({returned})"]

    def _parts(self, value: int) -> Sequence[int]:
        kind, of = self.values[value]
        if kind == "call":
            return [v for _, v in of[1]]
        if kind == "sum":
            return [v for v, _ in of]
        return of if kind == "product" else [of] if kind == "inverse" else ()

    def _reach(self, value: int, reached: dict[int, None]) -> int:
        if value not in reached:
            reached[value] = None
            kind, of = self.values[value]
            own = _LATENCY.get(of[0] if kind == "call" else kind, 1)
            self.depths[value] = own + max((self._reach(p, reached) for p in self._parts(value)), default=0)
        return self.depths[value]

    def name(self, value: int) -> str:
        """Return the name of a value; write its line first."""
        if value not in self.written:
            kind, of = self.values[value]
            text = of if kind == "name" else getattr(self, f"_{kind}")(of)
            if kind != "name":
                self.out.append(f"t{len(self.out)} = {text}")
                text = f"t{len(self.out) - 1}"
            self.written[value] = text
        return self.written[value]

    def _earliest(self, values: Sequence[int]) -> list[int]:
        return sorted(values, key=lambda v: (self.depths[v], v))

    def _call(self, of: tuple[str, tuple[Signed, ...]]) -> str:
        name, arguments = of
        return f"{name}({', '.join(('-' if s < 0 else '') + self.name(v) for s, v in arguments)})"

    def _inverse(self, of: int) -> str:
        return f"1.0/{self.name(of)}"

    def _product(self, of: tuple[int, ...]) -> str:
        below = [f for f in of if self.values[f][0] == "inverse" and self.inverses[f] == 1]
        above = [self.name(f) for f in self._earliest([f for f in of if f not in below])] or ["1.0"]
        names = [self.name(self.values[f][1]) for f in self._earliest(below)]
        divisor = f"/({'*'.join(names)})" if len(names) > 1 else "".join(f"/{n}" for n in names)
        return "*".join(above) + divisor

    def _sum(self, of: tuple[Signed, ...]) -> str:
        terms = sorted(of, key=lambda term: (self.depths[term[0]], term))
        terms.insert(0, terms.pop(next((i for i, (_, sign) in enumerate(terms) if sign > 0), 0)))
        (first, sign), *others = ((self.name(value), sign) for value, sign in terms)
        return ("-" if sign < 0 else "") + first + "".join(f" {'-' if s < 0 else '+'} {n}" for n, s in others)

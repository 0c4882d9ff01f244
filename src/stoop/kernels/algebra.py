"""Sums and products of a model's equations, rewritten so that a step takes fewer operations.

Every expression is a coefficient, which depends on the parameters alone, times a product of powers; a sum of such products is
a node. Coefficients cost nothing in the time loop, and so

- a factor that all terms of a sum share is taken out of it, negative powers too, and is combined with the powers outside:
  V^2 (a/V + b/V) becomes V (a + b);
- a denominator inside a denominator is cleared;
- a sum is expanded in those that it is a term of with a constant coefficient, where that saves operations: moments about two
  axes that share a product of inertia become two sums with coefficients of their own;
- a constant factor of a sum is multiplied into its coefficients;
- polynomials take Horner's form; terms with equal coefficients are added first.

What changes is the order of operations, hence the last digits, and nothing else.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import sympy as sp

Powers = tuple[tuple[int, int], ...]  #: (node, twice its exponent), by node
Product = tuple[Any, Powers]  #: a coefficient of the parameters alone, and the rest
Sum = dict[Powers, Any]  #: coefficient of each product

ONE, ZERO = sp.Integer(1), sp.Integer(0)


def trivial(coefficient: Any) -> bool:
    """Return whether a product with this coefficient needs no multiplication."""
    return bool(coefficient in (1, -1))


def split_sign(coefficient: Any) -> tuple[int, Any]:
    """Return a coefficient as a sign and one of two opposite coefficients, always the same."""
    return (-1, -coefficient) if coefficient.could_extract_minus_sign() else (1, coefficient)


def _signed(expr: Any) -> tuple[int, Any]:
    """Return a sign and an expression that is the same for opposite products of sums."""
    if not expr.is_Mul:
        return split_sign(expr)
    parts = [split_sign(factor) for factor in expr.args]
    return math.prod(sign for sign, _ in parts), expr.func(*[part for _, part in parts])


def times(a: Powers, b: Powers) -> Powers:
    """Return the product of powers."""
    if not (a and b):
        return a or b
    out = Counter(dict(a))
    out.update(dict(b))
    return tuple(sorted((node, power) for node, power in out.items() if power))


def over(a: Powers, b: Powers) -> Powers:
    """Return a quotient of powers."""
    return times(a, tuple((node, -power) for node, power in b))


def added(parts: Iterable[Product]) -> Sum:
    """Return the sum of products, those with equal powers as one."""
    terms: Sum = {}
    for coefficient, powers in parts:
        terms[powers] = terms.get(powers, ZERO) + coefficient
    return {p: c for p, c in terms.items() if c != 0}


@dataclass(frozen=True)
class Call:
    """A function of products; square roots are powers, not calls."""

    name: str
    arguments: tuple[Product, ...]


class Algebra:
    """The nodes of some expressions: symbols, calls and sums, each known by its number.

    Parameters
    ----------
    parameters : iterable of symbols
        What coefficients are made of.
    """

    def __init__(self, parameters: Iterable[Any]) -> None:
        self.nodes: list[Any] = []  #: a symbol, a :class:`Call`, or a sum's terms as a dict
        self.constants: dict[Any, Any] = {}  #: expression of the parameters -> its symbol
        self._places: dict[Any, int] = {}
        self._products: dict[Any, Product] = {}
        self._parameters = frozenset(parameters)
        self._fixed: dict[Any, bool] = {}

    # --- from SymPy

    def fixed(self, expr: Any) -> bool:
        """Return whether an expression depends on the parameters alone."""
        if expr not in self._fixed:
            own = expr in self._parameters if expr.is_Symbol else all(map(self.fixed, expr.args))
            self._fixed[expr] = own
        return self._fixed[expr]

    def coefficient(self, expr: Any) -> Any:
        """Return a parameter-only expression as a coefficient: a number or a symbol, with its sign."""
        sign, expr = _signed(expr)
        if not (expr.is_Number or expr.is_Symbol):
            expr = self.constants.setdefault(expr, sp.Symbol(f"h{len(self.constants)}", real=True))
        return sign * expr

    def product(self, expr: Any) -> Product:
        """Return an expression as a coefficient and powers of nodes."""
        if expr not in self._products:
            self._products[expr] = self._product(expr)
        return self._products[expr]

    def _product(self, expr: Any) -> Product:
        if self.fixed(expr):
            return self.coefficient(expr), ()
        if expr.is_Symbol:
            return ONE, ((self.node(expr), 2),)
        if expr.is_Mul or expr.is_Add:
            known = [a for a in expr.args if self.fixed(a)]
            parts = [self.product(a) for a in expr.args if not self.fixed(a)]
            if known:
                parts.append((self.coefficient(expr.func(*known)), ()))
            return self.total(parts) if expr.is_Add else self.multiply(*parts)
        if expr.is_Pow:
            return self.power(self.product(expr.args[0]), 2 * expr.args[1])
        return self._call(expr)

    def _call(self, expr: Any) -> Product:
        name, arguments = expr.func.__name__, [self.product(a) for a in expr.args]
        if name == "Abs":
            coefficient, powers = arguments[0]
            return ONE, ((self.node(Call("fabs", ((split_sign(coefficient)[1], powers),))), 2),)
        if name == "atan":  # SymPy's form of atan2 where it knows that x is positive
            name, arguments = "atan2", [*arguments, (ONE, ())]
        return ONE, ((self.node(Call(name, tuple(arguments))), 2),)

    def node(self, key: Any) -> int:
        """Return the number of a symbol, a call or a sum (a dict)."""
        place = _place(key)
        if place not in self._places:
            self._places[place] = len(self.nodes)
            self.nodes.append(key)
        return self._places[place]

    def replace(self, node: int, key: Any) -> None:
        """Give a node an equal value in another form."""
        old = _place(self.nodes[node])
        if self._places.get(old) == node:
            del self._places[old]
        self._places.setdefault(_place(key), node)
        self.nodes[node] = key

    def kept(self) -> tuple[list[Any], dict[Any, int]]:
        """Return the nodes as they are, for `restore`."""
        return list(self.nodes), dict(self._places)

    def restore(self, kept: tuple[list[Any], dict[Any, int]]) -> None:
        """Take back what was done since."""
        self.nodes, self._places = kept

    # --- sums and products

    def terms(self, node: int) -> Sum | None:
        """Return the terms of a sum; None for another node."""
        found = self.nodes[node]
        return found if isinstance(found, dict) else None

    def multiply(self, *factors: Product) -> Product:
        """Return a product, in which powers outside a sum meet the negative powers inside it."""
        coefficient: Any = ONE
        powers: Powers = ()
        for c, p in factors:
            coefficient, powers = coefficient * c, times(powers, p)
        for node, exponent in powers:
            terms = self.terms(node)
            if exponent != 2 or terms is None:
                continue
            inside = _lowest(terms)
            met = tuple((b, min(e, -inside[b])) for b, e in powers if b != node and e > 0 > inside.get(b, 0))
            if met:
                rest = over(powers, times(met, ((node, 2),)))
                return self.multiply((coefficient, rest), self.total(_scaled(terms, met)))
        return coefficient, powers

    def power(self, base: Product, twice: Any) -> Product:
        """Return a power with half of an integer as its exponent."""
        if not twice.is_Integer:
            raise NotImplementedError(f"power {twice / 2} has no vector form")
        coefficient, powers = base
        if twice % 2 and (coefficient != 1 or len(powers) != 1 or powers[0][1] != 2):
            coefficient, powers = ONE, ((self.node({powers: coefficient}), 2),)
        if twice < 0 and len(powers) == 1 and powers[0][1] == 2 and not twice % 2:
            inside = _lowest(self.terms(powers[0][0]) or {})
            met = tuple((b, -e) for b, e in sorted(inside.items()) if e < 0)
            if met:
                cleared = self.total(_scaled(self.terms(powers[0][0]) or {}, met))
                outside = coefficient ** (twice // 2), _raised(met, -twice)
                return self.multiply(outside, self.power(cleared, twice))
        return (coefficient ** (twice // 2) if coefficient != 1 else ONE), _raised(powers, twice)

    def total(self, parts: Iterable[Product]) -> Product:
        """Return a sum of products as its common factor times a sum."""
        return self.factored(added(parts))

    def factored(self, terms: Sum) -> Product:
        """Return terms as their common factor times a sum with a sign of its own."""
        if len(terms) < 2:
            return next(((c, p) for p, c in terms.items()), (ZERO, ()))
        shared = _common(terms)
        rest = {over(p, shared): c for p, c in terms.items()} if shared else terms
        ordered = sorted(rest)
        factor = rest[ordered[0]]
        if any(rest[p] not in (factor, -factor) for p in ordered):
            factor = sp.Integer(split_sign(factor)[0])
        inner = {p: quotient(rest[p], factor) for p in ordered}
        return factor, times(shared, ((self.node(inner), 2),))


def _place(key: Any) -> Any:
    return frozenset(key.items()) if isinstance(key, dict) else key


def quotient(coefficient: Any, factor: Any) -> Any:
    """Return a coefficient over a factor that is a sign, or itself up to the sign."""
    return ONE if coefficient == factor else -ONE if coefficient == -factor else coefficient / factor


def _raised(powers: Powers, twice: Any) -> Powers:
    return tuple((node, int(power * twice) // 2) for node, power in powers)


def _scaled(terms: Sum, factor: Powers) -> list[Product]:
    return [(c, times(p, factor)) for p, c in terms.items()]


def _lowest(terms: Sum) -> dict[int, int]:
    """Return the lowest exponent, twice, of each node that stands in a denominator of some term."""
    lowest: dict[int, int] = {}
    for powers in terms:
        for node, power in powers:
            lowest[node] = min(power, lowest.get(node, 0))
    return lowest


def _common(terms: Iterable[Powers]) -> Powers:
    """Return the powers that all products have."""
    first, *others = (dict(p) for p in terms)
    shared = {n: min([e, *(o[n] for o in others)]) for n, e in first.items() if all(n in o for o in others)}
    return tuple(sorted((n, e) for n, e in shared.items() if e))

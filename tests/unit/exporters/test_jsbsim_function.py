"""Whatever a term of a vehicle file can say, its JSBSim function computes: read back by a few lines of our own."""

from __future__ import annotations

import math
from collections.abc import Callable
from xml.etree.ElementTree import Element

import pytest
import sympy as sp

from stoop.exporters.jsbsim_model import convert, number
from stoop.vehicle import terms

VALUES = {"alpha": 0.31, "beta": -0.12, "q": 0.05, "elevator": -0.2}
OPERATIONS: dict[str, Callable[..., float]] = {
    "sum": lambda *a: math.fsum(a),
    "product": lambda *a: math.prod(a),
    "quotient": lambda a, b: a / b,
    "pow": lambda a, b: a**b,
    "abs": abs,
}


def evaluate(element: Element) -> float:
    """Compute a JSBSim function as its manual says."""
    if element.tag == "value":
        return float(element.text or "")
    if element.tag == "property":
        return VALUES[(element.text or "").removeprefix("of/")]
    return OPERATIONS[element.tag](*map(evaluate, element))


def test_terms() -> None:
    symbols = {n: sp.Symbol(n, real=True) for n in VALUES}
    for text in (
        "1", "alpha", "-elevator", "alpha^2*beta", "alpha/(1 + beta^2)", "abs(beta)*q - 0.3", "(alpha - 2*q)^3 / 7",
        "1/alpha^2", "2^3*q", "alpha^0", "1e-3*beta/abs(alpha)", "abs(alpha - 3*(beta - q)/(2 + alpha^2))^2",
    ):  # fmt: skip
        tree = terms.parse(text, tuple(VALUES), "here")
        element = convert(terms.convert(tree, symbols), {s: f"of/{n}" for n, s in symbols.items()})
        assert evaluate(element) == pytest.approx(float(terms.convert(tree, VALUES)), rel=1e-12, abs=1e-15), (
            text
        )
    with pytest.raises(NotImplementedError, match="sin has no form"):
        convert(sp.sin(sp.Symbol("a")), {sp.Symbol("a"): "a"})


def test_numbers_carry_all_their_digits() -> None:
    for x in (0.1 + 0.2, -1.0 / 3.0, 5e-324, 1.7976931348623157e308, 2.0**53 + 2.0, -0.0):
        assert float(number(x)) == x

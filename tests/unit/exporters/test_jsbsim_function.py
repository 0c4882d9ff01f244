"""Whatever a term of a vehicle file can say, its JSBSim function computes: read back by a few lines of our own."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from xml.etree.ElementTree import Element

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.exporters.jsbsim_model import convert, number
from stoop.vehicle import terms

NAMES = ("alpha", "beta", "q", "elevator")
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


def check(text: str) -> None:
    tree = terms.parse(text, NAMES, "here")
    symbols = {n: sp.Symbol(n, real=True) for n in NAMES}
    element = convert(terms.convert(tree, symbols), {s: f"of/{n}" for n, s in symbols.items()})
    assert evaluate(element) == pytest.approx(float(terms.convert(tree, VALUES)), rel=1e-12, abs=1e-15)


def test_terms() -> None:
    for text in (
        "1", "alpha", "-elevator", "alpha^2*beta", "alpha/(1 + beta^2)", "abs(beta)*q - 0.3", "(alpha - 2*q)^3 / 7",
        "1/alpha^2", "2^3*q", "alpha^0", "1e-3*beta/abs(alpha)",
    ):  # fmt: skip
        check(text)


LEAF = st.one_of(st.sampled_from(NAMES), st.integers(1, 9).map(str), st.just("0.5"))
TERM = st.recursive(
    LEAF,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        inner.map(lambda t: f"abs({t})"),
        st.tuples(inner, st.integers(0, 2)).map(lambda t: f"({t[0]})^{t[1]}"),
        inner.map(lambda t: f"{t}/(2 + alpha^2)"),
    ),
    max_leaves=5,
)


@settings(max_examples=25, deadline=None)
@given(TERM)
def test_any_term(text: str) -> None:
    with suppress(terms.TermError):  # too long, or powers of powers
        check(text)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_carry_all_their_digits(x: float) -> None:
    assert float(number(x)) == x


def test_what_has_no_form_is_refused() -> None:
    with pytest.raises(NotImplementedError, match="sin has no form"):
        convert(sp.sin(sp.Symbol("a")), {sp.Symbol("a"): "a"})

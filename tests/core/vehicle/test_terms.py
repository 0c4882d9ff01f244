"""Aerodynamic terms: what is allowed means what Python means; the rest is refused in one line."""

import ast
import math
import re
from contextlib import suppress

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.errors import TermError
from stoop.vehicle import terms

NAMES = (*terms.STATE_VARIABLES, "elevator", "aileron", "rudder")
WHERE = "a.toml: aerodynamics.CL.x"
leaf = st.sampled_from(NAMES) | st.integers(0, 99).map(str) | st.floats(0.01, 99).map(repr)


def grow(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", " * ", " - "]), inner).map("".join),
        *(inner.map(form.format) for form in ("({})", "-{}", "abs({})")),
        st.tuples(inner.map("({})".format), st.integers(0, 3)).map(lambda p: f"{p[0]}^{p[1]}"),
    )


allowed = st.recursive(leaf, grow, max_leaves=6).filter(lambda t: len(t) <= terms.MAX_LENGTH)
values = st.lists(st.floats(-2, 2), min_size=len(NAMES), max_size=len(NAMES))


@given(allowed, values)
@settings(max_examples=100)
def test_terms_mean_what_python_means(text: str, numbers: list[float]) -> None:
    here = dict(zip(NAMES, numbers, strict=True))
    try:
        tree = terms.parse(text, NAMES, WHERE)
    except TermError as error:
        assert re.search("has no finite value|multiply beyond", str(error))  # noqa: PT017  both outcomes are right
        return
    with suppress(ArithmeticError):
        expected = float(eval(text.replace("^", "**"), {"abs": abs}, here))  # noqa: S307  text made above
        assert terms.convert(tree, here) == pytest.approx(expected, rel=1e-12, abs=1e-300, nan_ok=True)
    assert terms.variables(tree) <= set(NAMES)


@given(allowed, values)
@settings(max_examples=40)
def test_symbols_and_numbers_agree(text: str, numbers: list[float]) -> None:
    symbols = [sp.Symbol(name, real=True) for name in NAMES]
    with suppress(TermError, ArithmeticError):
        tree = terms.parse(text, NAMES, "f")
        plain = float(terms.convert(tree, dict(zip(NAMES, numbers, strict=True))))
        expression = sp.sympify(terms.convert(tree, dict(zip(NAMES, symbols, strict=True))))
        exact = expression.evalf(60, subs=dict(zip(symbols, numbers, strict=True)))
        # else the symbolic form cancelled a factor, as 0 / 0 * x
        if exact.is_finite and math.isfinite(plain):
            assert float(exact) == pytest.approx(plain, rel=1e-6, abs=1e3 + 1e-12 * abs(plain))


WORDS = ["alpha", "os", "__import__", "(", ")", "[", "]", "'a'", ".", ",", "^", "**", "1", "1e999", "9" * 30, "-",
         "lambda", ":", "for", "in", "if", "else", "abs", "*", "/", "+", "=", ":=", "\n", " ", "0x1", "1j", "{", "}",
         "True", "None", "and", "not", "<", "@", "%", "//", "await", "yield", "f'{1}'", "\\", "#", "\x00"]  # fmt: skip


@given(st.lists(st.sampled_from(WORDS), max_size=12).map("".join))
@settings(max_examples=200)
def test_fragments_of_python_parse_or_are_refused(text: str) -> None:
    try:
        tree = terms.parse(text, NAMES, "f")
    except TermError:
        return
    kinds = {type(n).__name__ for n in ast.walk(tree)}
    named = {"BinOp", "UnaryOp", "Name", "Constant", "Call", "Load"}
    assert kinds <= named | {"Add", "Sub", "Mult", "Div", "Pow", "USub", "UAdd"}


def test_refused() -> None:
    for text in (
        "__import__('os').system('true')", "alpha.real", "alpha.__class__", "[alpha]", "(alpha,)", "alpha if beta else q",
        "lambda: 1", "alpha(1)", "abs", "abs()", "abs(alpha, beta)", "abs(*alpha)", "abs(x=alpha)", "pow(alpha, 2)",
        "alpha < beta", "alpha and beta", "not alpha", "~1", "alpha // 2", "alpha % 2", "alpha @ beta", "alpha^beta", "alpha^0.5",
        "alpha^-1", "2^alpha", "f'{alpha}'", "'alpha'", "b'a'", "1j", "True", "None", "...", "alpha := 2", "x", "Alpha",
        "alpha beta", "alpha;beta", "", " ", "(", "alpha^7", "alpha^999999999", "((alpha^6)^6)^6",
        "(" * 60 + "9" + "^6)" * 60, "1e999*alpha", "alpha/0", "0/0", "1/(alpha-alpha)", "9" * 199 + "^6", "alpha*" * 60 + "1",
        "await alpha", "yield", "alpha\x00", "\ud800", "(" * 190,
    ):  # fmt: skip
        with pytest.raises(TermError, match=r"^v\.toml: Cm\.x: ") as caught:
            terms.parse(text, NAMES, "v.toml: Cm.x")
        assert str(caught.value).isprintable()
        assert ";" in str(caught.value), "says what to do"


def test_unit() -> None:
    for text, unit in (
        ("1", "1"), ("alpha", "1/rad"), ("alpha^2", "1/rad2"), ("alpha*elevator", "1/rad2"), ("abs(beta)*beta", "1/rad2"),
        ("q", "1"), ("V", "1"), ("q*alpha", "1/rad"), ("-alpha", "1/rad"), ("alpha/beta", "1"), ("(alpha)^3", "1/rad3"),
        (" alpha ", "1/rad"), ("alpha^0", "1"),
    ):  # fmt: skip
        terms.parse(text, NAMES, "f")
        assert terms.unit(text, ("elevator", "aileron", "rudder")) == unit, text

"""The generated source: nothing of the user's text in it, parameter-only work outside the time loop."""

from typing import Any

import pytest
import sympy as sp

from stoop.kernels import SymbolicModel
from stoop.kernels.emit import HEADER, emit

x, y, u, a, b = sp.symbols("x y u a b", real=True)


def model(rate: sp.Expr, reading: sp.Expr = x) -> SymbolicModel:
    return SymbolicModel((x,), (u,), (a, b), (rate,), (reading,), ("x",), (False,))


def test_user_names_do_not_reach_the_source() -> None:
    evil = sp.Symbol("__import__('os').system('true')", real=True)
    source = emit(SymbolicModel((x,), (u,), (evil,), (evil * x,), (x,), ("x",), (False,))).source
    assert not any(word in source.removeprefix(HEADER) for word in ("import", "os"))


def test_what_has_no_vector_form_is_refused() -> None:
    for rate in (x ** sp.Rational(1, 3), x**y, sp.exp(x), sp.zoo * x):
        with pytest.raises(NotImplementedError):
            emit(model(rate))


def test_powers() -> None:
    for halves in (-6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 10, 11):
        source = emit(model(sp.Integer(0), (x + 2) ** sp.Rational(halves, 2))).source
        scope: dict[str, Any] = {}
        exec(source, scope)  # noqa: S102  our own text, to see what it computes
        found = scope["observe"]((0.3,), (0.0,), ())[1]
        assert found == pytest.approx(2.3 ** (halves / 2), rel=1e-14), halves

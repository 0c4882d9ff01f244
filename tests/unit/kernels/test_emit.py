"""The generated source: nothing of the user's text in it, parameter-only work outside the time loop."""

from __future__ import annotations

import pytest
import sympy as sp
from naive import oscillator

from stoop.kernels import SymbolicModel
from stoop.kernels.emit import HEADER, emit

x, y, u, a, b = sp.symbols("x y u a b", real=True)


def model(rate: sp.Expr, reading: sp.Expr = x) -> SymbolicModel:
    return SymbolicModel((x,), (u,), (a, b), (rate,), (reading,), ("x",), (False,))


def test_user_names_do_not_reach_the_source() -> None:
    evil = sp.Symbol("__import__('os').system('true')", real=True)
    source = emit(SymbolicModel((x,), (u,), (evil,), (evil * x,), (x,), ("x",), (False,))).source
    written = source.removeprefix(HEADER)
    assert "import" not in written
    assert "os" not in written


def test_equal_models_give_equal_source() -> None:
    assert emit(oscillator.equations()) == emit(oscillator.equations())


@pytest.mark.parametrize("rate", [x ** sp.Rational(1, 3), x**y, sp.exp(x), sp.zoo * x])
def test_what_has_no_vector_form_is_refused(rate: sp.Expr) -> None:
    with pytest.raises(NotImplementedError):
        emit(model(rate))


@pytest.mark.parametrize("power", [-3, -2, -1, 0, 1, 2, 5])
@pytest.mark.parametrize("half", [0, 1])
def test_powers(power: int, half: int) -> None:
    exponent = sp.Integer(power) + sp.Rational(half, 2)
    source = emit(model(sp.Integer(0), (x + 2) ** exponent)).source
    scope: dict[str, object] = {}
    exec(source, scope)  # noqa: S102  our own text, to see what it computes
    assert scope["observe"]((0.3,), (0.0,), ())[1] == pytest.approx(2.3 ** float(exponent), rel=1e-14)  # type: ignore[operator]

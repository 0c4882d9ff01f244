"""Rewritten equations have the values of those that were given, and take fewer operations."""

import ast
from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.kernels import SymbolicModel, load_kernel
from stoop.kernels.emit import HEADER, emit
from stoop.kernels.windows import windows

STATES = x, y, z = sp.symbols("x y z", real=True)
INPUTS = u, v = sp.symbols("u v", real=True)
PARAMETERS = a, b, c, d = sp.symbols("a b c d", real=True)
EXACT = {"sqrt": mpmath.sqrt, "atan2": mpmath.atan2, "fabs": abs}  #: functions of the source, to 60 digits


def model(*rates: Any, outputs: Sequence[Any] = (), held: tuple[int, ...] = ()) -> SymbolicModel:
    """Return a model of the states with given derivatives; those that are left out are zero."""
    derivatives = (*rates, *[sp.Integer(0)] * (len(STATES) - len(rates)))
    names = tuple(f"y{i}" for i in range(len(outputs)))
    return SymbolicModel(
        STATES, INPUTS, PARAMETERS, derivatives, tuple(outputs), names, (False,) * len(names), held
    )


def functions(source: str, scope: dict[str, Any]) -> dict[str, Callable[..., Any]]:
    """Return the functions of a source with others for root, arc tangent and magnitude."""
    made = dict(scope)
    exec(source.removeprefix(HEADER), made)  # noqa: S102  our own text, to see what it computes
    return made


def values(made: dict[str, Callable[..., Any]], x: Any, u: Any, p: Any) -> Sequence[Any]:
    constants = made["prepare"](p)
    found: Sequence[Any] = made["observe"](x, made["forcing"](u, constants), constants)
    return found


def operations(source: str, name: str) -> int:
    """Return the additions, multiplications, divisions and roots of a function."""
    (function,) = [f for f in ast.parse(source).body if isinstance(f, ast.FunctionDef) and f.name == name]
    nodes = list(ast.walk(function))
    roots = [n for n in nodes if isinstance(n, ast.Call) and getattr(n.func, "id", "") == "sqrt"]
    return sum(isinstance(n, ast.BinOp) for n in nodes) + len(roots)


def combined(parts: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Return sums, products, quotients, roots and arc tangents of expressions."""
    ways = (
        lambda *e: sp.Add(*e), lambda *e: sp.Mul(*e), lambda a, b, *_: a**2 * b, lambda a, *_: a**3, lambda a, *_: sp.Abs(a),
        lambda a, b, *_: a / sp.sqrt(1 + b**2), lambda a, b, *_: a / (2 + b**2), lambda a, b, *_: sp.atan2(a, 1 + b**2),
    )  # fmt: skip
    some = st.lists(parts, min_size=2, max_size=4)
    return st.tuples(st.sampled_from(ways), some).map(lambda drawn: drawn[0](*drawn[1]))


LEAVES = st.sampled_from([*STATES, *INPUTS, *PARAMETERS, *map(sp.Integer, (-2, -1, 2)), sp.Rational(1, 2)])
EXPRESSIONS = st.recursive(LEAVES, combined, max_leaves=12).filter(lambda e: not e.has(sp.pi))


@settings(max_examples=40)
@given(st.lists(EXPRESSIONS, min_size=1, max_size=3), st.integers(0, 2**32 - 1))
def test_the_values_stay(expressions: list[Any], seed: int) -> None:
    made = functions(emit(model(outputs=expressions)).source, EXACT)
    symbols = (*STATES, *INPUTS, *PARAMETERS)
    with mpmath.workdps(60):
        numbers = [mpmath.mpf(n) for n in np.random.default_rng(seed).uniform(-2.0, 2.0, len(symbols))]
        found = values(made, numbers[:3], numbers[3:5], numbers[5:])[3:]
        for value, expr in zip(found, expressions, strict=True):
            exact = sp.lambdify(symbols, expr, "mpmath")(*numbers)
            assert abs(value - exact) <= 1e-12 * (1 + abs(exact))  # numbers are doubles


def test_operations_of_each_rule() -> None:
    root, p, q = sp.sqrt(x**2 + y**2), c * x + d * y, d * x - c * y
    for rule, rates, count in (
        ("factor", [(x**2 + y**2) * (z / root + x / root)], 6), ("denominator", [1 / (x + y / z)], 3),
        ("dissolved", [a * (b * x + c * y) + d * y], 3), ("moments", [z * (a * p + b * q), z * (b * p - a * q)], 8),
        ("Horner", [a + b * x + c * x**2], 4), ("shifted polynomial", [a + b * (x - c) + d * (x - c) ** 2], 4),
        ("folded", [a * z * (b * x + c * y)], 4), ("equal coefficients", [a * x - a * y + b * z], 4),
        ("opposite", [a * (x - y) * z, -a * (x - y) * y], 4), ("common number", [2 * x * y - 2 * z * x], 3),
        ("common product", [x * y + z, x * y * z], 3), ("common sum", [(x + y + z) ** 2, x + y], 3),
        ("cancelled", [x + y * (a * (x - y) - a * x + a * y)], 2),
    ):  # fmt: skip
        assert operations(emit(model(*rates)).source, "derive") == count, rule


def test_forcing_terms_are_all_that_derivatives_take_from_inputs() -> None:
    emitted = emit(model(a * u + b * v + c + x, sp.Abs(u) * x, v * y, outputs=[x]))
    assert emitted.sizes.forcings == 3
    assert "u[" not in emitted.source.partition("def derive")[2]
    assert (operations(emitted.source, "forcing"), operations(emitted.source, "derive")) == (4, 3)
    made = functions(emitted.source, {"fabs": abs})
    constants = made["prepare"]((2.0, 3.0, 5.0, 7.0))
    here, there = (made["forcing"](at, constants) for at in ((-1.0, 4.0), (2.0, 8.0)))
    middle = made["forcing"]((0.5, 6.0), constants)
    even = [m == (h + t) / 2 for h, m, t in zip(here, middle, there, strict=True)]
    assert tuple(i for i, e in enumerate(even) if e) == emitted.sizes.affine
    assert len(emitted.sizes.affine) == 2


def test_states_that_no_output_depends_on_are_told() -> None:
    assert emit(model(y, x, x, outputs=[x])).sizes.seen == (0, 1)
    assert emit(model(y, z, x, outputs=[x])).sizes.seen == (0, 1, 2)
    assert emit(model(y, z, x)).sizes.seen == ()


def step(rates: Any, at: np.ndarray, now: np.ndarray, end: np.ndarray, dt: float) -> np.ndarray:
    """Return the state after a Runge-Kutta step; the second input is held."""
    end, k1 = np.array([end[0], now[1]]), rates(at, now)
    k2 = rates(at + dt / 2 * k1, (now + end) / 2)
    k3 = rates(at + dt / 2 * k2, (now + end) / 2)
    k4 = rates(at + dt * k3, end)
    return at + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def test_forcing_terms_and_unseen_states_along_a_trajectory(tmp_path, monkeypatch):
    """One input is linear along a step and bent by the equations, the other held; only windows show the third state."""
    monkeypatch.setenv("STOOP_CACHE_DIR", str(tmp_path))
    equations = model(y + a * sp.Abs(u), -b * x + c * v - y, d * x + v, outputs=[x, x * v], held=(1,))
    kernel = load_kernel("forcing", lambda: equations)
    assert kernel.model.sizes.seen == (0, 1)
    rng = np.random.default_rng(4)
    p, x0, dt = rng.uniform(0.5, 1.5, (4, 5)), rng.standard_normal((3, 5)), 0.1
    inputs = rng.standard_normal((9, 2))
    found = kernel.trajectories(p, x0, inputs, dt)
    shown, last = windows(kernel, p, x0, inputs, np.zeros(5, dtype=int), np.full(5, 9), np.full(5, 8), dt)
    for lane in range(5):
        a_, b_, c_, d_ = p[:, lane]

        def rates(s: np.ndarray, w: np.ndarray) -> np.ndarray:
            return np.array([s[1] + a_ * abs(w[0]), -b_ * s[0] + c_ * w[1] - s[1], d_ * s[0] + w[1]])  # noqa: B023

        at, rows = x0[:, lane], []
        for k in range(9):
            rows.append([at[0], at[0] * inputs[k, 1]])
            before = at
            at = step(rates, at, inputs[k], inputs[min(k + 1, 8)], dt)
        np.testing.assert_allclose(found[lane], rows, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(shown[lane], rows, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(last[:, lane], before, rtol=1e-12, atol=1e-14)
    weights = np.ones((9, 2))
    cost = kernel.cost(p, x0, inputs, np.zeros((9, 2)), weights, dt)
    np.testing.assert_allclose(cost, (found**2).sum(axis=(1, 2)), rtol=1e-12)

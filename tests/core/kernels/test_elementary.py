"""The branch-free elementary functions against 40 digits."""

import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from stoop.kernels import compiler
from stoop.kernels.elementary import atan2, wrap
from stoop.kernels.instructions import Function
from stoop.kernels.loops import Entry, gather, pointers, scatter


def body(code: Function, _: object) -> None:
    y, x, found = code.rows(1), code.rows(1), code.rows(2)
    with code.loop(0, "%count", code.lanes) as first:
        gather(code, "%Y", y, first)
        gather(code, "%X", x, first)
        found.fill([atan2(y[0], x[0]), wrap(y[0])])
        scatter(code, found, "%D", first)


@pytest.fixture(scope="module")
def functions() -> Callable[..., np.ndarray]:
    entry = Entry(f"{pointers('Y X D')}, i64 %count", body)
    made = compiler.native().object_file(entry.text(None, compiler.lanes()))  # type: ignore[arg-type]
    run = compiler.load(made, entry.arguments)

    def apply(*pairs: tuple[float, float]) -> np.ndarray:
        y, x = np.array(pairs).T.copy()
        out = np.empty((2, y.size))
        run(y, x, out, y.size)
        return out

    return apply


def test_atan2_is_within_two_units_in_the_last_place(functions: Callable[..., np.ndarray]) -> None:
    rng = np.random.default_rng(0)
    pairs = (rng.standard_normal((2, 2000)) * 10.0 ** rng.uniform(-9, 3, (2, 2000))).T.tolist()
    with mpmath.workdps(40):
        exact = [mpmath.atan2(mpmath.mpf(y), mpmath.mpf(x)) for y, x in pairs]
        found = map(mpmath.mpf, functions(*pairs)[0].tolist())
        errors = [abs((o - e) / e) for o, e in zip(found, exact, strict=True)]
    assert max(errors) < 4.5e-16


@given(st.floats(allow_nan=False), st.floats(allow_nan=False))
@example(0.0, 0.0)
@example(0.0, -1.0)
@example(math.inf, 1.0)
@example(1.0, -math.inf)
def test_atan2_at_the_edges(functions: Callable[..., np.ndarray], y: float, x: float) -> None:
    out = functions((y, x))
    if math.isinf(x) and math.isinf(y):
        assert math.isnan(out[0, 0])  # no direction: a candidate that has diverged
    elif max(abs(x), abs(y)) > 1e-280 and max(abs(x), abs(y)) < 1e300:
        unsigned = y + 0.0  # minus zero counts as zero
        assert out[0, 0] == pytest.approx(math.atan2(unsigned, x), rel=5e-16, abs=1e-300)


def test_not_a_number_stays_one(functions: Callable[..., np.ndarray]) -> None:
    assert np.isnan(functions((np.nan, 1.0), (1.0, np.nan))).tolist() == [[True, True], [True, False]]


@given(st.floats(-9.42, 9.42))
def test_wrap(functions: Callable[..., np.ndarray], a: float) -> None:
    found = functions((a, 1.0))[1, 0]
    assert abs(found) <= math.pi
    assert math.isclose(math.cos(found), math.cos(a), abs_tol=1e-14)
    assert math.isclose(math.sin(found), math.sin(a), abs_tol=1e-14)

"""First-order lags: exact from `SHORTEST_LAG` on, and smooth to none at all below."""

from __future__ import annotations

import pytest
import sympy as sp

from stoop.vehicle.defaults import SHORTEST_LAG
from stoop.vehicle.symbolic.forces import lagged


def transfer(lag: float, s: complex) -> complex:
    """Return output over command of the equations of a lag at a complex frequency."""
    x, u = sp.symbols("x u")
    output, rate = lagged(x, u, sp.Float(lag))
    state = sp.solve(sp.Eq(s * x, rate.subs(u, 1)), x)[0]
    return complex(output.subs({u: 1, x: state}))


def test_a_lag_is_of_first_order_and_none_passes_the_command() -> None:
    for lag in (SHORTEST_LAG, 0.3):
        assert transfer(lag, 20j) == pytest.approx(1.0 / (1.0 + 20j * lag), rel=1e-12)
    assert transfer(0.0, 20j) == pytest.approx(1.0, rel=1e-12)
    _, rate = lagged(sp.Float(0.0), sp.Float(1.0), sp.Float(0.0))
    assert float(rate) == pytest.approx(2.0 / SHORTEST_LAG)  # stable in steps of up to 0.028 s


def test_short_lags_differ_in_second_order_only() -> None:
    """(1 + a s) / (1 + (a + lag) s) has the phase of the lag at low frequency: the difference falls as s squared."""
    for lag in (0.002, 0.015):
        errors = [abs(transfer(lag, 1j * w) - 1.0 / (1.0 + 1j * w * lag)) for w in (2.0, 4.0)]
        assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.05)
        assert abs(transfer(lag, 20j) - 1.0 / (1.0 + 20j * lag)) < 0.02


def test_output_and_rate_are_smooth_in_the_lag() -> None:
    for i in (0, 1):
        short, at, long = (
            float(lagged(sp.Float(0.3), sp.Float(1.0), sp.Float(SHORTEST_LAG + h))[i])
            for h in (-1e-6, 0.0, 1e-6)
        )
        assert (at - short) / 1e-6 == pytest.approx((long - at) / 1e-6, rel=1e-3, abs=1e-3)

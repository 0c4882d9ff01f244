"""Signs of controls, of commands that were recorded late and early."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stoop.base.arrays import FloatArray
from stoop.checks.controls import Controls

RATE = 50.0
TIME = np.arange(0.0, 120.0, 1.0 / RATE)
#: heavily damped, as a light airplane is: 1/s, rad/s2 per rad
L_ALPHA, M_Q, M_ALPHA, M_ELEVATOR = 3.0, -4.0, -6.0, -20.0


def commanded(t: FloatArray) -> FloatArray:
    """Return doublets and 3-2-1-1, rad."""
    u = np.zeros_like(t)
    for start in (5.0, 35.0, 65.0, 95.0):
        for sign, begin, end in (
            (1, 0.0, 2.1),
            (-1, 2.1, 3.5),
            (1, 3.5, 4.2),
            (-1, 4.2, 4.9),
            (1, 12.0, 12.6),
            (-1, 12.6, 13.2),
        ):
            u += 0.05 * sign * ((t >= start + begin) & (t < start + end))
    return u  # fmt: skip


def flown() -> dict[str, FloatArray]:
    """Return the readings of a short period with a little noise."""

    def rates(t: float, x: FloatArray) -> FloatArray:
        u = float(commanded(np.array([t]))[0])
        return np.array([x[1] - L_ALPHA * x[0], M_ALPHA * x[0] + M_Q * x[1] + M_ELEVATOR * u])

    x = solve_ivp(rates, (0.0, TIME[-1]), [0.0, 0.0], t_eval=TIME, max_step=0.02, rtol=1e-8).y
    rng = np.random.default_rng(1)
    q = x[1] + 0.002 * rng.standard_normal(TIME.size)
    az = -9.8 - 40.0 * L_ALPHA * x[0] + 0.1 * rng.standard_normal(TIME.size)
    return {"q": q, "az": az}


@pytest.mark.parametrize("late", [-0.12, 0.0, 0.2, 0.4])
def test_the_right_sign_explains_more_whatever_the_delay(late: float) -> None:
    readings = {**flown(), "elevator": commanded(TIME + late)}
    controls = Controls(readings, RATE)
    left = {
        sign: controls({"elevator": ("elevator", sign)}, None)["moment", "pitch"].left for sign in (1.0, -1.0)
    }
    power = {sign: float(x @ x) for sign, x in left.items()}
    assert power[1.0] < 0.6 * power[-1.0]


def test_the_aileron_is_positive_where_it_rolls_to_the_right() -> None:
    p, u = np.zeros(TIME.size), commanded(TIME)
    for k in range(1, TIME.size):
        p[k] = p[k - 1] + (20.0 * u[k - 1] - 4.0 * p[k - 1]) / RATE
    readings = {"p": p + 0.002 * np.random.default_rng(2).standard_normal(TIME.size), "aileron": u}
    controls = Controls(readings, RATE)
    power = [
        np.sum(controls({"aileron": ("aileron", s)}, None)["moment", "roll"].left ** 2) for s in (1.0, -1.0)
    ]
    assert power[0] < 0.6 * power[1]

"""Slopes of lift, side force and controls; the largest residuals are those that a stable sort puts first."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import StateSpace, lsim

from stoop.base.arrays import FloatArray
from stoop_draft.checks.air import LIMITS, Air
from stoop_draft.checks.controls import Controls
from stoop_draft.checks.engine import LIMITS as THRESHOLDS
from stoop_draft.checks.engine import Edit, Range, _largest, search


def slope(alpha: np.ndarray, az: np.ndarray) -> float:
    return float(Air({"alpha": alpha, "az": az}, LIMITS.rate)({}, None)["lift", "alpha", "az"].value)


def test_the_slope_is_that_of_the_line_of_least_squares() -> None:
    rng = np.random.default_rng(0)
    alpha = 0.05 * rng.standard_normal(400)
    az = -9.8 - 60.0 * alpha + 0.5 * rng.standard_normal(400)
    line = np.polyfit(alpha, -az, 1)
    assert slope(alpha, az) == pytest.approx(line[0] / np.mean(-az), rel=1e-9)
    up = np.random.default_rng(0).integers(0, 2, 400)  # a vane that follows the lift in its last digit
    alpha = np.where(up, np.nextafter(290.0, 300.0), 290.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(slope(alpha, -9.8 - up))


@pytest.mark.parametrize("state", [{"alpha": ("beta", 1), "beta": ("alpha", 1)}, {"beta": ("beta", -1)}])
def test_flow_angles_that_no_force_follows_are_told(state: dict[str, tuple[str, float]]) -> None:
    """Side force falls with sideslip, and lift grows with the angle of attack."""
    rng = np.random.default_rng(0)
    time = np.arange(600) / LIMITS.rate
    alpha, beta = 0.05 * np.sin(0.8 * time), 0.05 * np.sin(1.1 * time)
    readings = {"alpha": alpha, "beta": beta, "az": -9.8 - 60.0 * alpha, "ay": -20.0 * beta}
    noisy = {n: x + 0.1 * rng.standard_normal(600) * n.startswith("a") for n, x in readings.items()}
    air = Air(noisy, LIMITS.rate)
    right, wrong = (air(now, None)["flow", "beta", "ay"] for now in ({}, state))
    gained, clear = right.gain(wrong, THRESHOLDS, complete=True)
    assert clear
    assert gained > THRESHOLDS.evidence


RATE = 50.0
TIME = np.arange(0.0, 120.0, 1.0 / RATE)
#: heavily damped, as a light airplane is: 1/s, rad/s2 per rad
L_ALPHA, M_Q, M_ALPHA, M_ELEVATOR = 3.0, -4.0, -6.0, -20.0


def commanded(t: FloatArray) -> FloatArray:
    u = np.zeros_like(t)
    for start in (5.0, 35.0, 65.0, 95.0):
        edges = (0.0, 2.1, 3.5, 4.2, 4.9, 12.0, 12.6, 13.2)
        for sign, begin, end in zip((1, -1, 1, -1, 0, 1, -1), edges[:-1], edges[1:], strict=True):
            u += 0.05 * sign * ((t >= start + begin) & (t < start + end))
    return u


def flown() -> dict[str, FloatArray]:
    system = StateSpace(
        [[-L_ALPHA, 1.0], [M_ALPHA, M_Q]], [[0.0], [M_ELEVATOR]], [[0.0, 1.0], [-40.0 * L_ALPHA, 0.0]], [[0.0], [0.0]]
    )  # fmt: skip
    _, y, _ = lsim(system, commanded(TIME), TIME, interp=False)
    noise = np.random.default_rng(1).standard_normal((2, TIME.size))
    return {"q": y[:, 0] + 0.002 * noise[0], "az": -9.8 + y[:, 1] + 0.1 * noise[1]}


@pytest.mark.parametrize("late", [-0.12, 0.0, 0.2, 0.4, None])
def test_the_right_sign_explains_more_whatever_the_delay(late: float | None) -> None:
    """An aileron is positive where it rolls to the right."""
    p, u = np.zeros(TIME.size), commanded(TIME)
    for k in range(1, TIME.size):
        p[k] = p[k - 1] + (20.0 * u[k - 1] - 4.0 * p[k - 1]) / RATE
    rolling = {"p": p + 0.002 * np.random.default_rng(2).standard_normal(TIME.size)}
    control = "aileron" if late is None else "elevator"
    axis, readings = {"elevator": ("pitch", flown()), "aileron": ("roll", rolling)}[control]
    controls = Controls({**readings, control: commanded(TIME + (late or 0.0))}, RATE)
    left = [controls({control: (control, s)}, None)["moment", axis].left for s in (1.0, -1.0)]
    assert left[0] @ left[0] < 0.6 * left[1] @ left[1]


@given(st.lists(st.integers(0, 4), min_size=1, max_size=40), st.data())
def test_the_largest_and_of_equal_ones_the_first(numbers: list[int], data: st.DataObject) -> None:
    x = np.array(numbers, dtype=np.float64)
    count = data.draw(st.integers(1, x.size))
    expected = np.argsort(-x, kind="stable")[:count]
    np.testing.assert_array_equal(_largest(x, count), np.sort(expected))


def test_a_sign_that_is_turned_back_is_no_finding() -> None:
    """Beside a wrong attitude a rate explains more with the other sign, and with the attitude right it does not."""
    rate = Edit("sign", ("q",), "write scale = -1", lambda signs: (-signs[0], signs[1]))
    angle = Edit("sign", ("theta",), "write scale = -1", lambda signs: (signs[0], -signs[1]))

    # no channel convinces of the angle by itself while the rate stands as it is
    odds = {(1, -1): (30, 30, 30), (-1, -1): (10, 30, 30), (-1, 1): (10, 10, 32), (1, 1): (25, 25, 23)}

    def model(signs: tuple[int, int], changed: object) -> dict[tuple[str, ...], Range]:
        of_rate, of_angle, other = odds[signs]
        numbers = {("turn", "q"): of_rate, ("turn", "p"): of_angle}
        numbers |= {("size", f"{i}"): other for i in range(6)}
        return {name: Range(1.0, 0.0, 0.0, x) for name, x in numbers.items()}

    found, state = search((1, -1), lambda state: (rate, angle), model)
    assert [one.best for one in found] == [angle]
    assert state == (1, 1)

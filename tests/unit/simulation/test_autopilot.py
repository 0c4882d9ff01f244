"""The autopilot's design against other ways to the same: exact derivatives, integrals, the delayed system as a whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stoop.errors import SimulationError
from stoop.simulation import linearize, trim
from stoop.simulation.autopilot import design, first_order_hold, linear_errors
from stoop.vehicle import Vehicle

WIND = (3.0, -2.0, 0.4)


def test_its_linear_model_is_that_of_the_exact_derivatives(quad: Vehicle) -> None:
    """Other coordinates, the same motion: eigenvalues agree; those of position and heading are zero in both."""
    point = trim(quad, wind=WIND, heading=0.6)
    exact = linearize(quad, point)
    keep = [i for i, n in enumerate(exact.states) if n not in ("psi", "h")]
    expected = np.linalg.eigvals(exact.A[np.ix_(keep, keep)])
    found = np.linalg.eigvals(linear_errors(quad, point).A)
    for value in expected:
        near = int(np.argmin(np.abs(found - value)))
        assert found[near] == pytest.approx(value, abs=2e-4 * (1.0 + abs(value)))
        found = np.delete(found, near)
    assert np.abs(found).max() < 2e-3, "three positions and a heading"


def test_commands_in_straight_lines_are_held_exactly() -> None:
    rng = np.random.default_rng(1)
    A, B, x = rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), rng.standard_normal(5)
    E = rng.standard_normal((5, 2))
    r0, r1, dt = rng.standard_normal(2), rng.standard_normal(2), 0.3
    F, G0, G1 = first_order_hold(A, B, E, dt)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        return A @ y + B @ (r0 + (r1 - r0) * t / dt) + E @ (r1 - r0) / dt

    flown = solve_ivp(rate, (0.0, dt), x, rtol=1e-11, atol=1e-12).y[:, -1]
    assert F @ x + G0 @ r0 + G1 @ r1 == pytest.approx(flown, abs=1e-9)


@pytest.mark.parametrize(("dt", "delay"), [(0.0025, 7), (0.01, 1), (0.05, 2)])
def test_the_delayed_system_has_the_poles_of_the_one_without_delay(quad, dt, delay):
    """Built as a whole, commands on their way among the states: poles of F - GK, and zeros for the waiting."""
    point = trim(quad, wind=WIND)
    model = linear_errors(quad, point)
    gains = design(quad, point, model, dt, delay)
    F, G0, G1 = first_order_hold(model.A, model.B, model.E, dt)
    n, m = model.B.shape
    # errors, then r[k], r[k+1], ..., r[k+delay-1]; the command that follows them is `new`
    whole = np.zeros((n + delay * m, n + delay * m))
    new = np.zeros((m, n + delay * m))
    new[:, :n] = -gains.errors
    for i in range(delay):
        new[:, n + i * m : n + (i + 1) * m] = -gains.underway[i]
    rows = np.vstack([np.hstack([np.zeros((delay * m, n)), np.eye(delay * m)]), new])  # r[k] ... r[k+delay]
    whole[:n, :n] = F
    whole[:n] += G0 @ rows[:m] + G1 @ rows[m : 2 * m]
    whole[n:] = rows[m:]
    poles = np.linalg.eigvals(whole)
    assert np.abs(poles).max() < 1.0 - 0.1 * dt
    slow = np.sort(np.abs(poles))[::-1][:n]
    punctual = design(quad, point, model, dt, 1)
    drive = F @ G1 + G0
    # u[k+1] = -K s[k+1] with delay 1: K F is what it makes of e[k]
    K = punctual.errors @ np.linalg.inv(F)
    assert slow == pytest.approx(np.sort(np.abs(np.linalg.eigvals(F - drive @ K)))[::-1], abs=1e-6)


def test_a_vehicle_that_turns_over_between_samples_is_refused(quad: Vehicle) -> None:
    point = trim(quad)
    model = linear_errors(quad, point)
    wild = replace(model, A=model.A + 1e4 * np.eye(len(model.A)))
    with pytest.raises(SimulationError, match="no autopilot was found that holds it at 1 Hz; raise the rate"):
        design(quad, point, wild, 1.0, 1)

"""Signals read late: by whole samples exactly, by parts of one as a cubic can."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.simulation import parameter_rows
from stoop.simulation.delays import delayed, late_inputs, late_outputs
from stoop.vehicle import Vehicle, parse_vehicle

LATE = """
name = "late"
mass = { mass = 8.5, inertia = { xx = 1.38, yy = 0.84, zz = 2.0 } }
reference = { area = 0.66, chord = 0.285, span = 2.32, airspeed = 24.0 }
sensors = { q = { delay = 0.03 }, psi = { delay = 0.015 } }
[controls]
elevator = { delay = 0.02 }
aileron = {}
rudder = { mix = { pwm_3 = 0.001 }, delay = 0.035 }
"""


@pytest.fixture(scope="module")
def late() -> Vehicle:
    return parse_vehicle(LATE, "late.toml")


@given(st.integers(0, 40))
def test_whole_samples(samples: int) -> None:
    y = np.random.default_rng(0).standard_normal(30)
    out = delayed(y, float(samples))
    assert np.array_equal(out[samples:], y[: 30 - samples] if samples < 30 else [])
    assert (out[:samples] == y[0]).all(), "before the record it holds its first value"


@given(st.floats(0.0, 10.0), st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_cubics_are_exact(samples: float, coefficients: list[float]) -> None:
    t = np.arange(60.0)
    p = np.polynomial.Polynomial(coefficients, domain=[0, 59], window=[-1, 1])
    inside = slice(int(np.ceil(samples)) + 3, -2)
    assert delayed(p(t), samples)[inside] == pytest.approx(p(t - samples)[inside], abs=1e-11)


@given(st.floats(-50.0, 50.0), st.integers(1, 7))
def test_a_part_of_the_samples_is_the_same_and_delays_are_continuous(samples: float, every: int) -> None:
    y = np.random.default_rng(2).standard_normal((30, 2))
    whole = delayed(y, samples)
    assert np.array_equal(delayed(y, samples, every), whole[::every])
    assert np.abs(delayed(y, samples + 1e-9) - whole).max() < 1e-7


def test_inputs_are_late_by_their_controls_delays(late: Vehicle) -> None:
    t = np.arange(0.0, 2.0, 0.01)
    u = np.column_stack([np.sin(3 * t + i) for i in range(3)])
    held = u.copy()
    out = late_inputs(late, u, parameter_rows(late), 0.01)
    assert np.array_equal(u, held)
    assert late.inputs == ("elevator", "aileron", "pwm_3")
    assert np.array_equal(out[:, 0], delayed(u[:, 0], 2.0))
    assert np.array_equal(out[:, 1], u[:, 1])
    assert out[:, 2] == pytest.approx(delayed(u[:, 2], 3.5), abs=1e-14)


def test_inputs_per_lane_where_a_delay_differs(late: Vehicle) -> None:
    u = np.random.default_rng(3).standard_normal((50, 3))
    rows = parameter_rows(late, {"controls.elevator.delay": np.array([0.02, 0.025, 0.02])}, 3)
    out = late_inputs(late, u, rows, 0.01)
    assert out.shape == (50, 3, 3)
    for b, samples in enumerate((2.0, 2.5, 2.0)):
        assert np.array_equal(out[:, 0, b], delayed(u[:, 0], samples))
        assert np.array_equal(out[:, 1, b], u[:, 1])


def test_commands_of_before_arrive_late(late: Vehicle) -> None:
    u = np.random.default_rng(3).standard_normal((60, 3))
    for own in ({}, {"controls.elevator.delay": np.array([0.02, 0.025, 0.02])}):
        rows = parameter_rows(late, own, 3)
        for first in (0, 1, 3, 30):
            out = late_inputs(late, u[first:], rows, 0.01, u[:first])
            assert np.array_equal(out, late_inputs(late, u, rows, 0.01)[first:])


def test_readings_are_late_and_headings_do_not_jump(late: Vehicle) -> None:
    t = np.arange(0.0, 4.0, 0.01)
    y = np.zeros((1, len(t), 12))
    heading = 2.0 + 0.8 * t
    y[0, :, late.outputs.index("psi")] = np.angle(np.exp(1j * heading))
    y[0, :, late.outputs.index("q")] = np.sin(t)
    out = late_outputs(late, y.copy(), parameter_rows(late), 0.01)[0]
    assert out[5:-2, late.outputs.index("q")] == pytest.approx(np.sin(t - 0.03)[5:-2], abs=1e-9)
    off = out[5:-2, late.outputs.index("psi")] - (heading - 0.8 * 0.015)[5:-2]
    assert np.angle(np.exp(1j * off)) == pytest.approx(np.zeros(len(off)), abs=1e-9)


@pytest.mark.filterwarnings("error")
def test_a_diverged_candidate_stays_as_it_is_and_warns_of_nothing(late: Vehicle) -> None:
    rows = parameter_rows(late, {"sensors.q.delay": np.array([0.013, 0.013, 0.013])}, 3)
    y = np.random.default_rng(4).standard_normal((3, 50, 12))
    alone = late_outputs(late, y[:1].copy(), rows[:, :1], 0.01)
    y[1, 20:], y[1, 25:] = np.inf, np.nan
    y[2, ::2], y[2, 1::2] = 1.7e308, -1.7e308
    out = late_outputs(late, y.copy(), rows, 0.01)
    assert np.array_equal(out[:1], alone)
    assert np.array_equal(out[1], y[1], equal_nan=True)

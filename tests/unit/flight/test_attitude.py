"""The attitude on the grid against SciPy's Slerp, and an attitude that follows the rates between slow samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from unit.flight.made_logs import body_rates

from stoop.base.notices import Notice
from stoop.base.rotations import continuous, quaternions_of, wrap
from stoop.base.variables import EULER, QUATERNION, RATES
from stoop.flight.gridding import Channels, grid_channels, interpolate_by_rates


@pytest.mark.parametrize("recorded_rate", [10.0, 100.0, 178.0])
def test_the_gridded_attitude_follows_slerp_through_any_sign(recorded_rate: float) -> None:
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 6.0, 1.0 / recorded_rate)
    begun = Rotation.from_euler("ZYX", [3.0, 0.4, -0.5])
    turning = Rotation.from_rotvec(np.outer(time, [1.2, -0.7, 2.0])) * begun
    parts = np.roll(turning.as_quat(), 1, axis=1) * rng.choice([-1.0, 1.0], time.size)[:, None]
    channels = [Channels("att", time, dict(zip(QUATERNION, parts.T, strict=True)))]
    grid, data, _ = grid_channels(channels, 100.0, "f")
    ours = np.column_stack([data[name] for name in QUATERNION])
    inside = slice(20, -20)  # the low-pass distorts the ends
    truth = Slerp(time, turning)(grid.time[inside])
    assert np.max((Rotation.from_quat(np.roll(ours[inside], -1, axis=1)) * truth.inv()).magnitude()) < 2e-4
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), 1.0, atol=1e-12)
    assert np.min(np.sum(ours[1:] * ours[:-1], axis=1)) > 0.99
    angles = np.column_stack([data[name] for name in EULER])[inside]
    np.testing.assert_allclose(np.sin(angles - truth.as_euler("ZYX")[:, ::-1]), 0.0, atol=1e-2)


def test_recorded_euler_angles_are_not_interpolated_through_the_turn_of_heading() -> None:
    time = np.arange(0.0, 4.0, 0.03)
    heading, level = wrap(2.5 + 0.8 * time), np.zeros_like(time)
    for angles in ({"phi": level, "theta": level, "psi": heading}, {"psi": heading}):
        grid, data, sources = grid_channels([Channels("att", time, angles)], 100.0, "f")
        np.testing.assert_allclose(np.exp(1j * data["psi"]), np.exp(1j * (2.5 + 0.8 * grid.time)), atol=1e-4)
        assert np.all((data["psi"] > -np.pi) & (data["psi"] <= np.pi))
        assert np.max(np.abs(data.get("phi", level))) < 1e-9
        assert sources["psi"].source == "att"


def wobbling(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    phi, theta, psi = 0.4 * np.sin(9.0 * t), 0.3 * np.cos(7.0 * t), 0.8 * t
    rates = body_rates(phi, theta, 3.6 * np.cos(9.0 * t), -2.1 * np.sin(7.0 * t), np.full(t.size, 0.8))
    return np.column_stack([phi, theta, psi]), np.column_stack(rates)


def recorded(slow: np.ndarray, fast: np.ndarray, bias: float = 0.0) -> list[Channels]:
    angles, rates = wobbling(slow)[0], wobbling(fast)[1] + bias
    parts = continuous(quaternions_of(angles))
    return [
        Channels("estimator", slow, {f"q{i}": x for i, x in enumerate(parts.T)}),
        Channels("gyro", fast, dict(zip(RATES, rates.T, strict=True))),
    ]


def off(channels: list[Channels], follow: bool) -> tuple[float, list[Notice]]:
    grid, data, sources = grid_channels(channels, 100.0, "test")
    notices: list[Notice] = []
    if follow:
        data, notices = interpolate_by_rates(grid, data, sources, channels)
    truth = wobbling(grid.time)[0]
    there = np.isfinite(data["q0"]) & np.isfinite(data["p"])
    found = np.column_stack([data["phi"], data["theta"]])
    return float(np.max(np.abs(found - truth[:, :2])[there])), notices


def test_quick_motion_between_slow_samples() -> None:
    channels = recorded(np.arange(0.0, 20.0, 0.2), np.arange(0.0, 20.0, 0.004), bias=0.01)
    before, after = off(channels, False)[0], off(channels, True)
    assert before > 0.1
    assert after[0] < 0.03, "the ends of filtered rates are the worst"
    assert [(n.code, n.values["rate"]) for n in after[1]] == [("attitude-follows-rates", pytest.approx(5.0))]


def test_holes_stay() -> None:
    slow, fast = np.arange(0.0, 20.0, 0.2), np.arange(0.0, 20.0, 0.004)
    slow = slow[(slow < 6.0) | (slow > 7.5)]
    fast = fast[(fast < 12.0) | (fast > 13.0)]
    channels = recorded(slow, fast)
    grid, data, sources = grid_channels(channels, 100.0, "test")
    after, _ = interpolate_by_rates(grid, data, sources, channels)
    for name in ("q0", "phi"):
        np.testing.assert_array_equal(np.isnan(after[name]), np.isnan(data[name]))
    assert off(channels, True)[0] < 0.03


def test_fast_attitudes_and_slow_rates_are_left() -> None:
    fast = recorded(np.arange(0.0, 5.0, 0.02), np.arange(0.0, 5.0, 0.004))
    slow = recorded(np.arange(0.0, 5.0, 0.1), np.arange(0.0, 5.0, 0.1))
    for channels in (fast, slow, slow[:1], slow[1:]):
        grid, data, sources = grid_channels(channels, 100.0, "test")
        after, notices = interpolate_by_rates(grid, data, sources, channels)
        assert notices == []
        assert all(after[name] is data[name] for name in data)

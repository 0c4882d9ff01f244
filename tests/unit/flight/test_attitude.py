"""The attitude on the grid against SciPy's Slerp."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from stoop.base.arrays import FloatArray
from stoop.base.rotations import wrap
from stoop.base.variables import EULER, QUATERNION
from stoop.flight.gridding import Channels, grid_channels


def scalar_first(rotation: Rotation) -> FloatArray:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def rotation_of(quaternions: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1))


@pytest.mark.parametrize("recorded_rate", [10.0, 57.0, 100.0, 178.0])
def test_the_gridded_attitude_follows_slerp_through_any_sign(recorded_rate: float) -> None:
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 6.0, 1.0 / recorded_rate)
    turning = Rotation.from_rotvec(np.outer(time, [1.2, -0.7, 2.0])) * Rotation.from_euler(
        "ZYX", [3.0, 0.4, -0.5]
    )
    recorded = scalar_first(turning) * rng.choice([-1.0, 1.0], time.size)[:, None]
    grid, data, _ = grid_channels(
        [Channels("att", time, dict(zip(QUATERNION, recorded.T, strict=True)))], 100.0, "f"
    )
    ours = np.column_stack([data[name] for name in QUATERNION])
    inside = slice(20, -20)  # the low-pass distorts the ends
    truth = Slerp(time, turning)(grid.time[inside])
    assert np.max((rotation_of(ours[inside]) * truth.inv()).magnitude()) < 2e-4
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), 1.0, atol=1e-12)
    assert np.min(np.sum(ours[1:] * ours[:-1], axis=1)) > 0.99
    angles = np.column_stack([data[name] for name in EULER])[inside]
    np.testing.assert_allclose(np.sin(angles - truth.as_euler("ZYX")[:, ::-1]), 0.0, atol=1e-2)


def test_recorded_euler_angles_are_not_interpolated_through_the_turn_of_heading() -> None:
    time = np.arange(0.0, 4.0, 0.03)
    heading = wrap(2.5 + 0.8 * time)
    level = np.zeros_like(time)
    channels = Channels("att", time, {"phi": level, "theta": level, "psi": heading})
    grid, data, sources = grid_channels([channels], 100.0, "f")
    np.testing.assert_allclose(np.exp(1j * data["psi"]), np.exp(1j * (2.5 + 0.8 * grid.time)), atol=1e-4)
    assert np.max(np.abs(data["phi"])) < 1e-9
    assert sources["psi"].source == "att"


def test_a_heading_alone_is_unwrapped_too() -> None:
    time = np.arange(0.0, 4.0, 0.03)
    grid, data, _ = grid_channels([Channels("att", time, {"psi": wrap(2.5 + 0.8 * time)})], 100.0, "f")
    np.testing.assert_allclose(np.exp(1j * data["psi"]), np.exp(1j * (2.5 + 0.8 * grid.time)), atol=1e-6)
    assert np.all((data["psi"] > -np.pi) & (data["psi"] <= np.pi))

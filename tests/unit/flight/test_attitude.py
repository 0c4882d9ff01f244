"""Attitude against SciPy's Rotation and Slerp."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from stoop.flight.attitude import continuous, euler_angles, normalized, quaternions_of, wrap
from stoop.flight.build import build
from stoop.flight.channels import Channels
from stoop.flight.variables import EULER, QUATERNION
from stoop.logs import FloatArray

angle = st.floats(-3.1, 3.1)
pitch = st.floats(-1.5, 1.5)


def scalar_first(rotation: Rotation) -> FloatArray:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def rotation_of(quaternions: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1))


@given(st.lists(st.tuples(angle, pitch, angle), min_size=1, max_size=8))
def test_euler_angles_and_quaternions_agree_with_scipy(angles: list[tuple[float, float, float]]) -> None:
    ours = quaternions_of(np.array(angles))
    theirs = Rotation.from_euler("ZYX", np.array(angles)[:, ::-1])
    assert np.max((rotation_of(ours) * theirs.inv()).magnitude()) < 1e-12
    np.testing.assert_allclose(euler_angles(ours), angles, atol=1e-7)


def test_heading_of_south_is_plus_pi() -> None:
    south = euler_angles(quaternions_of(np.array([[0.0, 0.0, np.pi], [0.0, 0.0, -np.pi]])))
    assert np.array_equal(south[:, 2], [np.pi, np.pi])


@given(st.floats(-1e4, 1e4))
def test_wrap(x: float) -> None:
    wrapped = float(wrap(np.array([x]))[0])
    assert -np.pi < wrapped <= np.pi
    assert np.isclose(np.exp(1j * wrapped), np.exp(1j * x), atol=1e-9)
    if -np.pi < x <= np.pi:
        assert wrapped == x


def test_wrap_keeps_nan() -> None:
    assert np.isnan(wrap(np.array([np.nan]))[0])


@given(st.lists(st.booleans(), min_size=2, max_size=40))
def test_signs_do_not_matter(flips: list[bool]) -> None:
    smooth = scalar_first(Rotation.from_rotvec(np.outer(0.1 * np.arange(len(flips)), [1.0, 0.3, -0.2])))
    flipped = smooth * np.where(flips, -1.0, 1.0)[:, None]
    sign = -1.0 if flips[0] else 1.0
    np.testing.assert_array_equal(continuous(flipped), sign * smooth)


def test_a_quaternion_of_no_length_is_missing() -> None:
    assert np.isnan(normalized(np.zeros((1, 4)))).all()
    np.testing.assert_allclose(normalized(np.array([[2.0, 0.0, 0.0, 0.0]])), [[1.0, 0.0, 0.0, 0.0]])


@pytest.mark.parametrize("recorded_rate", [10.0, 57.0, 100.0, 178.0])
def test_the_gridded_attitude_follows_slerp_through_any_sign(recorded_rate: float) -> None:
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 6.0, 1.0 / recorded_rate)
    turning = Rotation.from_rotvec(np.outer(time, [1.2, -0.7, 2.0])) * Rotation.from_euler(
        "ZYX", [3.0, 0.4, -0.5]
    )
    recorded = scalar_first(turning) * rng.choice([-1.0, 1.0], time.size)[:, None]
    grid, data, _ = build([Channels("att", time, dict(zip(QUATERNION, recorded.T, strict=True)))], 100.0, "f")
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
    grid, data, sources = build([channels], 100.0, "f")
    np.testing.assert_allclose(np.exp(1j * data["psi"]), np.exp(1j * (2.5 + 0.8 * grid.time)), atol=1e-4)
    assert np.max(np.abs(data["phi"])) < 1e-9
    assert sources["psi"].source == "att"


def test_a_heading_alone_is_unwrapped_too() -> None:
    time = np.arange(0.0, 4.0, 0.03)
    grid, data, _ = build([Channels("att", time, {"psi": wrap(2.5 + 0.8 * time)})], 100.0, "f")
    np.testing.assert_allclose(np.exp(1j * data["psi"]), np.exp(1j * (2.5 + 0.8 * grid.time)), atol=1e-6)
    assert np.all((data["psi"] > -np.pi) & (data["psi"] <= np.pi))

"""Rotations against SciPy's, against a naive twin, and against the symbols of the equations of motion."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from stoop.base import rotations as r
from stoop.base.arrays import FloatArray
from stoop.simulation.on_rotors import small_rotation

angle = st.floats(-3.1, 3.1)
euler = st.lists(st.tuples(angle, st.floats(-1.5, 1.5), angle), min_size=1, max_size=8)
seeds = st.integers(0, 2**32 - 1)


def scalar_first(theirs: Rotation) -> FloatArray:
    return np.roll(theirs.as_quat(), 1, axis=-1)


def theirs_of(q: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def drawn(seed: int, count: int) -> tuple[Rotation, FloatArray, FloatArray]:
    """Return rotations, their quaternions of either sign, and vectors."""
    rng = np.random.default_rng(seed)
    theirs = Rotation.random(count, random_state=rng)
    signs = rng.choice([-1.0, 1.0], (count, 1))
    return theirs, signs * scalar_first(theirs), rng.uniform(-10.0, 10.0, (count, 3))


def apart(a: Rotation, b: Rotation) -> float:
    return float(np.max((a * b.inv()).magnitude()))


@settings(max_examples=40)
@given(euler)
def test_euler_angles(angles: list[tuple[float, float, float]]) -> None:
    ours = r.quaternions_of(np.array(angles))
    theirs = Rotation.from_euler("ZYX", np.array(angles)[:, ::-1])
    assert apart(theirs_of(ours), theirs) < 1e-12
    np.testing.assert_allclose(r.euler_angles(ours), angles, atol=1e-7)
    np.testing.assert_allclose(r.matrices_of_angles(np.array(angles)), theirs.as_matrix(), atol=1e-14)


@settings(max_examples=30)
@given(seeds)
def test_matrices_and_vectors_that_are_turned(seed: int) -> None:
    theirs, q, vectors = drawn(seed, 6)
    np.testing.assert_allclose(r.matrices_of(q), theirs.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(r.to_ground(q, vectors), theirs.apply(vectors), atol=1e-13)
    np.testing.assert_allclose(r.to_body(q, vectors), theirs.inv().apply(vectors), atol=1e-13)


@settings(max_examples=30)
@given(seeds)
def test_products_and_rotation_vectors(seed: int) -> None:
    (a, p, _), (b, q, vectors) = drawn(seed, 6), drawn(seed + 1, 6)
    assert apart(theirs_of(r.product(p, q)), a * b) < 1e-12
    assert apart(theirs_of(r.conjugate(p)), a.inv()) < 1e-12
    assert apart(theirs_of(r.quaternions_about(vectors)), Rotation.from_rotvec(vectors)) < 1e-12
    short = b.magnitude() < np.pi - 1e-3  # half a turn has two vectors
    np.testing.assert_allclose(r.vectors_of(q)[short], b.as_rotvec()[short], atol=1e-11)


def test_any_axes_before_the_components() -> None:
    rng = np.random.default_rng(3)
    for shape in ((), (1,), (5,), (2, 3)):
        angles, vectors = rng.uniform(-1.5, 1.5, (*shape, 3)), rng.uniform(-1.0, 1.0, (*shape, 3))
        q = r.quaternions_of(angles)
        functions: list[tuple[Any, FloatArray]] = [
            (r.quaternions_of, angles), (r.euler_angles, q), (r.matrices_of, q), (r.matrices_of_angles, angles),
            (r.quaternions_about, vectors), (r.vectors_of, q), (r.normalized, 2.0 * q), (lambda x: r.product(x, x), q),
            (lambda x, v=vectors: r.to_ground(x, v.reshape((*x.shape[:-1], 3))), q),
        ]  # fmt: skip
        for function, given_ in functions:
            whole, flat = function(given_), function(given_.reshape(-1, given_.shape[-1]))
            assert whole.shape[: len(shape)] == shape
            np.testing.assert_allclose(whole.reshape(flat.shape), flat, atol=1e-15)


def test_the_symbols_of_the_equations_say_the_same() -> None:
    from stoop.vehicle.symbolic import frames

    _, every, vectors = drawn(11, 20)
    for q, vector in zip(every, vectors, strict=True):
        e, v = tuple(q.tolist()), tuple(vector.tolist())
        np.testing.assert_allclose(frames.over_ground(e, v), r.to_ground(q, vector), atol=1e-13)  # type: ignore[arg-type]
        attitude = frames.attitude(e)  # type: ignore[arg-type]
        np.testing.assert_allclose(attitude.down, r.matrices_of(q)[2], atol=1e-14)
        angles = [float(x) for x in (attitude.phi, attitude.theta, attitude.psi)]
        np.testing.assert_allclose(angles, r.euler_angles(q), atol=1e-12)


@given(seeds, st.floats(0.0, 0.02))
def test_the_autopilot_sees_small_errors_as_vectors(seed: int, size: float) -> None:
    _, q, vectors = drawn(seed, 1)
    small = size * vectors[0] / np.linalg.norm(vectors[0])
    after = r.product(q[0], r.quaternions_about(small))
    seen = small_rotation(q[:1].T, after[:, None])[:, 0]
    np.testing.assert_allclose(seen, r.vectors_of(r.product(r.conjugate(q[0]), after)), atol=1e-6)
    np.testing.assert_allclose(seen, small, atol=1e-6)


def test_borders() -> None:
    south = r.euler_angles(r.quaternions_of(np.array([[0.0, 0.0, np.pi], [0.0, 0.0, -np.pi]])))
    assert np.array_equal(south[:, 2], [np.pi, np.pi])
    assert np.isnan(r.wrap(np.array([np.nan]))[0])
    assert np.isnan(r.normalized(np.zeros((1, 4)))).all()
    np.testing.assert_allclose(r.normalized(np.array([[2.0, 0.0, 0.0, 0.0]])), [[1.0, 0.0, 0.0, 0.0]])
    still = np.array([1.0, 0.0, 0.0, 0.0])
    assert np.array_equal(r.quaternions_about(np.zeros(3)), still)
    assert np.array_equal(r.vectors_of(still), np.zeros(3))


@given(st.floats(-1e4, 1e4))
def test_wrap(x: float) -> None:
    wrapped = float(r.wrap(np.array([x]))[0])
    assert -np.pi < wrapped <= np.pi
    assert np.isclose(np.exp(1j * wrapped), np.exp(1j * x), atol=1e-9)
    if -np.pi < x <= np.pi:
        assert wrapped == x


@given(st.lists(st.booleans(), min_size=2, max_size=40))
def test_signs_do_not_matter(flips: list[bool]) -> None:
    smooth = scalar_first(Rotation.from_rotvec(np.outer(0.1 * np.arange(len(flips)), [1.0, 0.3, -0.2])))
    flipped = smooth * np.where(flips, -1.0, 1.0)[:, None]
    sign = -1.0 if flips[0] else 1.0
    np.testing.assert_array_equal(r.continuous(flipped), sign * smooth)

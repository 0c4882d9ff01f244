"""Other axes turned into ours, against rotation matrices written down by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import LogError
from stoop.flight.conversion import check_frame, rotate_axes

BODY = {"frd": np.eye(3), "flu": np.diag([1.0, -1.0, -1.0])}
GROUND = {
    "ned": np.eye(3),
    "nwu": np.diag([1.0, -1.0, -1.0]),
    "enu": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}  #: columns of that frame -> ours
FRAMES = [(body, ground) for body in BODY for ground in GROUND]


def columns(names: tuple[str, ...], rows: FloatArray) -> dict[str, FloatArray]:
    return dict(zip(names, rows.T, strict=True))


def test_vectors() -> None:
    rows = np.random.default_rng(1).normal(size=(5, 3))
    for frame, names in (("flu", RATES), ("flu", SPECIFIC_FORCE), ("enu", VELOCITY), ("nwu", POSITION)):
        found = rotate_axes(columns(names, rows), check_frame("m", names, frame))
        turn = (BODY | GROUND)[frame]
        np.testing.assert_allclose(np.column_stack([found[n] for n in names]), rows @ turn.T)
    wind = rotate_axes(
        columns(("wind_n", "wind_e"), rows[:, :2]), check_frame("m", ("wind_n", "wind_e"), "enu")
    )
    np.testing.assert_array_equal((wind["wind_n"], wind["wind_e"]), (rows[:, 1], rows[:, 0]))


def test_attitudes() -> None:
    """The same rotation, told in other axes: R_ours = G R B'. By REP 103 yaw is zero to the east, and counts to the left."""
    theirs = Rotation.random(20, random_state=np.random.RandomState(2))
    parts, angles = np.roll(theirs.as_quat(), 1, axis=1), theirs.as_euler("ZYX")[:, ::-1]
    for body, ground in FRAMES:
        truth = GROUND[ground] @ theirs.as_matrix() @ BODY[body].T
        found = rotate_axes(columns(QUATERNION, parts), check_frame("m", QUATERNION, [body, ground]))
        turned = Rotation.from_quat(np.column_stack([found[n] for n in (*QUATERNION[1:], QUATERNION[0])]))
        np.testing.assert_allclose(turned.as_matrix(), truth, atol=1e-12)
        found = rotate_axes(columns(EULER, angles), check_frame("m", EULER, [body, ground]))
        back = Rotation.from_euler("ZYX", np.column_stack([found[n] for n in EULER])[:, ::-1]).as_matrix()
        np.testing.assert_allclose(back, truth, atol=1e-9)
    ros = rotate_axes(columns(EULER, np.array([[0.1, -0.2, 0.3]])), ("flu", "enu"))
    assert [ros[n][0] for n in EULER] == pytest.approx([0.1, 0.2, np.pi / 2 - 0.3])


def test_what_cannot_be_turned_alone() -> None:
    for names in (("phi",), ("vn",), ("V",), ("p", "vn"), ("q0", "q1")):
        with pytest.raises(LogError, match="says nothing about"):
            check_frame("m.toml: group.x", names, "enu")

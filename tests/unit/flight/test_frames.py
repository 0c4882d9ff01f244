"""Other axes turned into ours, against rotation matrices written down by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stoop.base.arrays import FloatArray
from stoop.base.variables import EULER, QUATERNION
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


@pytest.mark.parametrize(
    ("frame", "names"), [("flu", ("p", "q", "r")), ("enu", ("vn", "ve", "vd")), ("nwu", ("pn", "pe", "pd"))]
)
def test_vectors(frame: str, names: tuple[str, ...]) -> None:
    rows = np.random.default_rng(1).normal(size=(5, 3))
    turn = (BODY | GROUND)[frame]
    found = rotate_axes(columns(names, rows), check_frame("m", names, frame))
    np.testing.assert_allclose(np.column_stack([found[n] for n in names]), rows @ turn.T)


def test_wind_over_ground_of_east_and_north() -> None:
    names = ("wind_n", "wind_e")
    found = rotate_axes(columns(names, np.array([[3.0, 7.0]])), check_frame("m", names, "enu"))
    assert (found["wind_n"][0], found["wind_e"][0]) == (7.0, 3.0)


@pytest.mark.parametrize(("body", "ground"), FRAMES)
def test_attitudes(body: str, ground: str) -> None:
    """The same rotation, told in other axes: R_ours = G R B'."""
    theirs = Rotation.random(20, random_state=np.random.RandomState(2))
    truth = GROUND[ground] @ theirs.as_matrix() @ BODY[body].T
    xyzw = theirs.as_quat()
    found = rotate_axes(
        columns(QUATERNION, np.roll(xyzw, 1, axis=1)), check_frame("m", QUATERNION, [body, ground])
    )
    parts = np.column_stack([found[n] for n in QUATERNION])
    np.testing.assert_allclose(Rotation.from_quat(np.roll(parts, -1, axis=1)).as_matrix(), truth, atol=1e-12)
    angles = theirs.as_euler("ZYX")[:, ::-1]
    found = rotate_axes(columns(EULER, angles), check_frame("m", EULER, [body, ground]))
    back = Rotation.from_euler("ZYX", np.column_stack([found[n] for n in EULER])[:, ::-1]).as_matrix()
    np.testing.assert_allclose(back, truth, atol=1e-9)


def test_yaw_of_ros_becomes_a_heading() -> None:
    """REP 103: yaw zero is east and counts to the left; pitch counts nose down."""
    angles = np.array([[0.1, -0.2, 0.3]])
    found = rotate_axes(columns(EULER, angles), ("flu", "enu"))
    assert [found[n][0] for n in EULER] == pytest.approx([0.1, 0.2, np.pi / 2 - 0.3])


@pytest.mark.parametrize("names", [("phi",), ("vn",), ("V",), ("p", "vn"), ("q0", "q1")])
def test_what_cannot_be_turned_alone(names: tuple[str, ...]) -> None:
    with pytest.raises(LogError, match="says nothing about"):
        check_frame("m.toml: group.x", names, "enu")

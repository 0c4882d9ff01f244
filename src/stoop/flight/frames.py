"""Axes of other systems, turned into ours: body forward-right-down, ground north-east-down.

"flu" is a body with forward, left, up (ROS, Crazyflie); "enu" a ground with east, north, up; "nwu" one with
north, west, up, or with x where the vehicle pointed when it was switched on.

References
----------
REP 103 of ROS, Standard units of measure and coordinate conventions, section "Axis orientation".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import euler_angles, product, quaternions_of
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import LogError

Frame: TypeAlias = tuple[str, ...]
BODY: Final = ("frd", "flu")
GROUND: Final = ("ned", "enu", "nwu")
_BODY_VECTORS: Final = (
    RATES,
    ("p_dot", "q_dot", "r_dot"),
    SPECIFIC_FORCE,
    ("control_roll", "control_pitch", "control_yaw"),
)
_GROUND_VECTORS: Final = (
    VELOCITY,
    ("vn_smooth", "ve_smooth", "vd_smooth"),
    POSITION,
    ("an", "ae", "ad"),
    ("wind_n", "wind_e"),
)
_SIGNS: Final = (1.0, -1.0, -1.0)  #: of y and z, when left and up become right and down
_HALF: Final = float(np.sqrt(0.5))
_GROUND_TURNS: Final = {
    "ned": (1.0, 0.0, 0.0, 0.0),
    "nwu": (0.0, 1.0, 0.0, 0.0),
    "enu": (0.0, _HALF, _HALF, 0.0),
}  #: quaternion that takes coordinates of that ground into ned: half a turn about north, or about north-east


def check_frame(at: str, variables: tuple[str, ...], given: str | Sequence[str]) -> Frame:
    """Check that a frame means something for these variables.

    Parameters
    ----------
    at : file and key, for the error message
    variables : that are in this frame
    given : one name, or two for an attitude: those of body and ground

    Raises
    ------
    LogError
        When the variables cannot be turned one by one.
    """
    frame = (given,) if isinstance(given, str) else tuple(given)
    for name in variables if frame else ():
        if _can_be_turned(name, variables, frame):
            continue
        ground = next((vector for vector in _GROUND_VECTORS if name in vector), None)
        whole = next((attitude for attitude in (EULER, QUATERNION) if name in attitude), None)
        advice = "; leave it out there"
        if ground:
            advice = f" alone; name {', '.join(ground)} together in one group, with columns x, y, z"
        elif whole:
            names = ", ".join(whole)
            advice = f' alone; name {names} together in one group, with frame = ["flu", "enu"] or the like'
        raise LogError(f"{at}.frame = {', '.join(frame)} says nothing about {name}{advice}")
    return frame


def _can_be_turned(name: str, variables: tuple[str, ...], frame: Frame) -> bool:
    if set(variables) in (set(EULER), set(QUATERNION)):
        return len(frame) == 2 and frame[0] in BODY and frame[1] in GROUND
    if len(frame) == 1 and any(name in vector for vector in _BODY_VECTORS):
        return frame[0] in BODY
    vector = next((vector for vector in _GROUND_VECTORS if name in vector), None)
    if len(frame) != 1 or vector is None:
        return False
    whole = frame[0] != "enu" or name not in vector[:2] or set(vector[:2]) <= set(variables)
    return frame[0] in GROUND and whole


def rotate_axes(values: Mapping[str, FloatArray], frame: Frame) -> dict[str, FloatArray]:
    """Bring vectors and attitudes into our axes; all of these rotations are their own inverse.

    Parameters
    ----------
    values : variable -> (n,) SI; those of a vector stand in the order x, y, z of its own frame
    frame : checked by `check_frame`; empty leaves all as it is
    """
    if not frame:
        return dict(values)
    if set(values) == set(QUATERNION):
        q = np.column_stack([values[name] for name in QUATERNION])
        return dict(zip(QUATERNION, _rotate(q, *frame).T, strict=True))
    if set(values) == set(EULER):
        q = quaternions_of(np.column_stack([values[name] for name in EULER]))
        return dict(zip(EULER, euler_angles(_rotate(q, *frame)).T, strict=True))
    out = dict(values)
    for vector in _BODY_VECTORS if frame[0] in BODY else _GROUND_VECTORS:
        there = {name: values[name] for name in vector if name in values}
        if frame[0] in ("flu", "nwu"):
            out |= {name: _SIGNS[vector.index(name)] * x for name, x in there.items()}
        elif frame[0] == "enu":
            north, east, *_ = vector
            out |= {name: -x for name, x in there.items() if name not in (north, east)}
            out |= {north: there[east], east: there[north]} if north in there else {}
    return out


def _rotate(q: FloatArray, body: str, ground: str) -> FloatArray:
    """Turn quaternions (n, 4) that take body into ground coordinates: ground' * q * body'."""
    out = product(np.array(_GROUND_TURNS[ground]), q)
    if body == "flu":  # half a turn about the forward axis, which is its own inverse but for the sign
        out = product(out, np.array([0.0, 1.0, 0.0, 0.0]))
    return out

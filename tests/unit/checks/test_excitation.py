"""Inputs that cannot tell: they move with each other, or with the motion, as a loop makes them."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.checks.excitation import collinear

TIME = 0.01 * np.arange(2000)
RNG = np.random.default_rng(0)
ALPHA: FloatArray = 0.05 * np.sin(2.0 * TIME)
Q: FloatArray = 0.1 * np.cos(2.0 * TIME)
MOTIONS = {
    "V": 0.3 * np.sin(0.3 * TIME),
    "alpha": ALPHA,
    "q": Q,
    "beta": 0.02 * np.sin(3.0 * TIME),
    "p": 0.2 * np.cos(5.0 * TIME),
}


def noise(size: float) -> FloatArray:
    return size * RNG.standard_normal(len(TIME))


def told(**controls: FloatArray) -> list[Notice]:
    return list(collinear(controls, MOTIONS))


def test_an_open_loop_input_is_not_accused() -> None:
    assert told(elevator=0.1 * np.sign(np.sin(1.3 * TIME)), aileron=0.1 * np.sign(np.sin(0.7 * TIME))) == []


def test_feedback_of_one_motion_is_named() -> None:
    (found,) = told(elevator=-2.0 * ALPHA + noise(0.005))
    assert (found.code, found.subject, found.values["other"]) == (
        "control-follows-motion",
        "elevator",
        "alpha",
    )
    assert found.values["correlation"] == pytest.approx(-1.0, abs=0.01)


def test_feedback_of_several_motions_is_named() -> None:
    (found,) = told(elevator=1.0 * ALPHA + 0.6 * Q + noise(0.002))
    assert (found.code, found.values["motions"]) == ("control-combination", ("V", "alpha", "q"))


def test_controls_that_are_mixed_are_named() -> None:
    moved = 0.1 * np.sign(np.sin(0.7 * TIME))
    found = told(aileron=moved, rudder=0.5 * moved + noise(0.002))
    assert ("controls-correlated", "aileron", "rudder") in [
        (n.code, n.subject, n.values.get("other")) for n in found
    ]

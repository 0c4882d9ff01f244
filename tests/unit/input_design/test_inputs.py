from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.errors import SimulationError
from stoop.input_design.inputs import SHAPES, Frame
from stoop.simulation.maneuver import Maneuver

FRAME = Frame({"elevator": 0.05, "rudder": 0.02}, math.radians(60.0), 12.0, 2.0, 0.1)


def deflections(shape: str, x: np.ndarray, rate: float = 1000.0) -> dict[str, np.ndarray]:
    inputs = SHAPES[shape](FRAME).inputs(x)
    return Maneuver.model_validate({"duration": 12.0, "rate": rate, "input": inputs}).deflections()


@pytest.mark.parametrize("shape", SHAPES)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_amplitude_and_slew_hold_everywhere_in_the_box(shape: str, data: st.DataObject) -> None:
    dimension = SHAPES[shape](FRAME).dimension
    x = np.array(data.draw(st.lists(st.floats(0.0, 1.0), min_size=dimension, max_size=dimension)))
    for control, move in deflections(shape, x).items():
        # a multisine is bounded on a grid of 16 points per period of its highest harmonic: 2 % between them
        assert np.abs(move).max() <= FRAME.amplitude[control] * 1.02
        assert np.abs(np.diff(move)).max() <= FRAME.slew / 1000.0 * 1.02
        assert move[0] == move[-1] == 0.0


@pytest.mark.parametrize("shape", SHAPES)
def test_guesses_are_in_the_box_and_use_the_amplitude(shape: str) -> None:
    family = SHAPES[shape](FRAME)
    assert family.starts.shape[1] == family.dimension
    assert family.starts.min() >= 0.0
    assert family.starts.max() <= 1.0
    for control, move in deflections(shape, family.starts[0]).items():
        assert np.abs(move).max() > 0.9 * FRAME.amplitude[control]


def test_multisines_of_two_controls_are_orthogonal() -> None:
    family = SHAPES["multisine"](FRAME)
    x = np.random.default_rng(3).uniform(size=family.dimension)
    a, b = (move[500:-501] for move in deflections("multisine", x).values())
    assert abs(a @ b) < 1e-9 * np.sqrt((a @ a) * (b @ b))


def test_square_wave_fills_the_time() -> None:
    family = SHAPES["square"](FRAME)
    x = np.random.default_rng(4).uniform(size=family.dimension)
    for spec in family.inputs(x):
        assert spec.start + sum(spec.lengths) == pytest.approx(11.5)
        assert all(a * b < 0.0 for a, b in zip(spec.levels, spec.levels[1:], strict=False))


def test_a_band_without_harmonics_is_refused() -> None:
    narrow = Frame(FRAME.amplitude, FRAME.slew, 12.0, 0.1, 0.1)
    with pytest.raises(SimulationError, match="design for longer, or with a higher band"):
        SHAPES["multisine"](narrow).inputs(np.zeros(3))


@pytest.mark.parametrize("shape", ["3-2-1-1", "doublet", "square"])
@pytest.mark.parametrize("at", [0.0, 0.5, 1.0])
def test_a_slow_surface_moves_as_far_as_it_gets(shape: str, at: float) -> None:
    """60 degrees at 60 deg/s within steps of a second: a smaller step, and no error."""
    slow = Frame({"elevator": math.radians(60.0)}, math.radians(60.0), 8.0, 2.0, 0.1)
    family = SHAPES[shape](slow)
    for x in (np.full(family.dimension, at), *family.starts):
        maneuver = Maneuver.model_validate({"duration": 8.0, "rate": 1000.0, "input": family.inputs(x)})
        move = maneuver.deflections()["elevator"]
        assert np.abs(np.diff(move)).max() <= slow.slew / 1000.0 * 1.001
        assert np.abs(move).max() > 0.02

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stoop.errors import SimulationError
from stoop.simulation.maneuver import Maneuver, Steps
from stoop_plan.input_design.inputs import COUNTED_SHAPES, HANDS_OFF, SHAPES, STEADY, USUAL_SHAPES, Frame

SLEW = dict.fromkeys(("elevator", "rudder"), math.radians(60.0))
FRAME = Frame({"elevator": 0.05, "rudder": 0.02}, SLEW, 12.0, 2.0, 0.1)


def deflections(shape: str, x: np.ndarray, frame: Frame = FRAME) -> dict[str, np.ndarray]:
    entries = {"duration": frame.duration, "rate": 1000.0, "input": SHAPES[shape](frame).inputs(x)}
    return Maneuver.model_validate(entries).deflections()


@pytest.mark.parametrize("shape", USUAL_SHAPES)
@settings(max_examples=15)
@given(data=st.data())
def test_amplitude_and_slew_hold_everywhere_in_the_box(shape: str, data: st.DataObject) -> None:
    dimension = SHAPES[shape](FRAME).dimension
    x = np.array(data.draw(st.lists(st.floats(0.0, 1.0), min_size=dimension, max_size=dimension)))
    for control, move in deflections(shape, x).items():
        # a multisine is bounded on a grid of 16 points per period of its highest harmonic: 2 % between them
        assert np.abs(move).max() <= FRAME.amplitude[control] * 1.02
        assert np.abs(np.diff(move)).max() <= FRAME.slew[control] / 1000.0 * 1.02
        assert move[0] == move[-1] == 0.0


@pytest.mark.parametrize("shape", USUAL_SHAPES)
def test_guesses_are_in_the_box_and_use_the_amplitude(shape: str) -> None:
    family = SHAPES[shape](FRAME)
    assert family.starts.shape[1] == family.dimension
    assert 0.0 <= family.starts.min() <= family.starts.max() <= 1.0
    for control, move in deflections(shape, family.starts[0]).items():
        assert np.abs(move).max() > 0.9 * FRAME.amplitude[control]


def test_multisines_are_orthogonal_and_square_waves_fill_the_time() -> None:
    x = np.random.default_rng(3).uniform(size=SHAPES["multisine"](FRAME).dimension)
    a, b = (move[500:-501] for move in deflections("multisine", x).values())
    assert abs(a @ b) < 1e-9 * np.sqrt((a @ a) * (b @ b))
    family = SHAPES["square"](FRAME)
    for spec in family.inputs(np.random.default_rng(4).uniform(size=family.dimension)):
        assert spec["start"] + sum(spec["lengths"]) == pytest.approx(11.5)
        assert all(p * q < 0.0 for p, q in zip(spec["levels"], spec["levels"][1:], strict=False))


def test_shapes_that_the_time_does_not_hold_are_refused() -> None:
    short, low = (Frame(FRAME.amplitude, SLEW, *rest, 0.1) for rest in ((3.0, 5.0), (12.0, 0.1)))
    for shape, frame, x, says in (
        ("multisine", low, 3, "design for longer, or with a higher band"), ("sweep", short, 6, "sweeps of 0.5 s do not reach"),
        ("3-2-1-1", counted(1.0, 20.0), 4, "takes 21 s at least"),
    ):  # fmt: skip
        with pytest.raises(SimulationError, match=says):
            SHAPES[shape](frame).inputs(np.full(x, 0.5))
    assert SHAPES["3-2-1-1"](counted(1.0, 21.0)).inputs(np.full(4, 0.5))[1]["start"] == 11.0


@pytest.mark.parametrize("shape", ["3-2-1-1", "doublet", "square"])
def test_a_slow_surface_moves_as_far_as_it_gets(shape: str) -> None:
    """60 degrees at 60 deg/s within steps of a second: a smaller step, and no error."""
    slow = Frame({"elevator": math.radians(60.0)}, SLEW, 8.0, 2.0, 0.1)
    family = SHAPES[shape](slow)
    for x in (*np.tile([[0.0], [0.5], [1.0]], family.dimension), *family.starts):
        move = deflections(shape, x, slow)["elevator"]
        assert np.abs(np.diff(move)).max() <= slow.slew["elevator"] / 1000.0 * 1.001
        assert np.abs(move).max() > 0.02


def counted(beat: float, duration: float = 40.0) -> Frame:
    return Frame(FRAME.amplitude, SLEW, duration, 2.0, 0.1, dict.fromkeys(SLEW, 0.01), beat)


@pytest.mark.parametrize("shape", COUNTED_SHAPES)
@settings(max_examples=15)
@given(data=st.data(), beat=st.sampled_from([0.25, 0.5, 1.0]))
def test_steps_by_hand_fall_on_the_beat(shape: str, data: st.DataObject, beat: float) -> None:
    family, end = SHAPES[shape](counted(beat)), STEADY - HANDS_OFF
    box = st.lists(st.floats(0.0, 1.0), min_size=family.dimension, max_size=family.dimension)
    for spec in map(Steps.model_validate, family.inputs(np.array(data.draw(box)))):
        assert spec.start / beat == pytest.approx(round(spec.start / beat))
        assert spec.step / beat == pytest.approx(max(1, round(spec.step / beat)))
        assert spec.start >= end + HANDS_OFF - 1e-9
        end = spec.start + sum(Steps.PATTERNS[shape]) * spec.step
        stops = 2.0 * math.degrees(abs(spec.amplitude))  # of half degrees
        assert stops == pytest.approx(round(stops))
        assert 0.01 <= abs(spec.amplitude) <= family.frame.amplitude[spec.control]
    assert end + HANDS_OFF <= 40.0 + 1e-9


@settings(max_examples=15)
@given(st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6))
@example([1.0, 0.0, 1.0] * 2)  # full size up to the band, which the slew does not allow
def test_sweeps_keep_amplitude_slew_and_band(drawn: list[float]) -> None:
    frame = Frame(FRAME.amplitude, SLEW, 40.0, 5.0, 0.1)
    x = np.array(drawn)
    specs, moves = SHAPES["sweep"](frame).inputs(x), deflections("sweep", x, frame)
    assert not np.any((moves["elevator"] != 0.0) & (moves["rudder"] != 0.0)), "one after the other"
    for control, move in moves.items():
        assert np.abs(move).max() <= frame.amplitude[control]
        assert np.abs(np.diff(move)).max() <= SLEW[control] / 1000.0 * 1.02
    assert all(6.0 / spec["duration"] <= spec["low"] <= spec["band"] / 2.0 + 1e-9 for spec in specs)
    assert all(spec["band"] <= 5.0 + 1e-9 for spec in specs)


@pytest.mark.parametrize("shape", [*USUAL_SHAPES, "2-1-1"])
def test_no_input_is_smaller_than_what_can_be_flown(shape: str) -> None:
    frame = Frame({"elevator": 0.05}, SLEW, 12.0, 2.0, 0.1, {"elevator": 0.03})
    for at in (0.5, 0.4):  # the middle of a signed amplitude is none
        move = deflections(shape, np.full(SHAPES[shape](frame).dimension, at), frame)["elevator"]
        assert np.abs(move).max() >= 0.0294

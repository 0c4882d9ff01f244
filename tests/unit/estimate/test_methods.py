"""Which method is meant where none is named: the vehicle says, and how fast its motors were logged."""

from dataclasses import replace

import numpy as np
import pytest

from stoop import Flight, load_vehicle
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.flight.flight import dataset, from_columns
from stoop.flight.gridding import Channels, grid_channels
from stoop.strategy.method import MIN_MOTOR_RATE
from stoop.strategy.run import choose_method

MOTORS = tuple(f"motor_{i}" for i in range(1, 5))


def logged(rate: float, grid: float = 100.0) -> Flight:
    """Return seconds of a log whose motors came at a rate of their own, and one other channel at 250 Hz."""
    fast, slow = np.arange(0.0, 4.0, 0.004), np.arange(0.0, 4.0, 1.0 / rate)
    motors = Channels("actuator_outputs", slow, {m: 0.5 + 0.1 * np.sin(slow) for m in MOTORS})
    laid, data, sources = grid_channels([Channels("gyro", fast, {"p": np.sin(fast)}), motors], grid, "log")
    return Flight("log", None, dataset(laid.time, data), grid, sources)


@pytest.mark.parametrize(("rate", "name"), [(43.0, "equation-error"), (250.0, "multiple-shooting")])
def test_motors_that_were_logged_slowly_choose(rate: float, name: str) -> None:
    found = choose_method("", load_vehicle("quad-x"), [replace(logged(250.0), name="fast"), logged(rate)])
    assert found.options.method == name
    assert [(n.code, n.values["rate"]) for n in found.notices] == (
        [("motors-logged-slowly", pytest.approx(43.0, abs=0.5))] if rate < MIN_MOTOR_RATE else []
    )


def test_what_lies_on_the_grid_as_it_was_commanded_is_not_slow() -> None:
    """A simulated flight at 40 Hz holds all that was commanded, and a clock of 49.9 Hz is one of 50 Hz; a log of 40 Hz lacks
    what came between its samples, whatever its grid.
    """
    vehicle, time = load_vehicle("quad-x"), np.arange(0.0, 4.0, 0.025)
    given = from_columns("flight", time, {c: np.sin(time) for c in ("p", "theta", *MOTORS)})
    for one in (given, logged(49.9)):
        found = choose_method("", vehicle, [one])
        assert (found.options.method, found.notices, found.in_calm) == ("multiple-shooting", (), "")
    for grid in (50.0, 100.0):
        assert choose_method("", vehicle, [logged(40.0, grid)]).options.method == "equation-error"


def test_gyros_and_accelerometers_alone_are_regressed() -> None:
    """Without velocity and attitude; one channel of either, and windows can be simulated."""
    time = np.arange(0.0, 4.0, 0.01)
    columns = {c: np.sin(time) for c in (*RATES, *SPECIFIC_FORCE, *MOTORS)}
    vehicle, log = load_vehicle("quad-x"), from_columns("log", time, columns)
    found = choose_method("", vehicle, [log])
    assert found.options.method == "equation-error"
    assert [n.code for n in found.notices] == ["no-states-recorded"]
    other = from_columns("log", time, {**columns, "theta": 0.1 * np.sin(time)})
    assert choose_method("", vehicle, [log, other]).options.method == "multiple-shooting"

"""Motors that are shaken faster than they were logged: where `stoop.strategy.method.MIN_MOTOR_RATE` lies.

A quadrotor flies doublets while its motors are shaken between 30 and 200 Hz, as by an autopilot that answers the noise of
its gyros. The log holds every n-th command. What was faster than half the rate of the log looks slow in it, so that the
vehicle seems to answer less.
"""

from dataclasses import dataclass

import pytest
from helpers.fits import fit_by
from helpers.flown import maneuver

from stoop import Flight, Vehicle, load_vehicle, simulate_flight
from stoop.flight.flight import dataset
from stoop.flight.gridding import Channels, grid_channels
from stoop.problem.windows import Window
from stoop.simulation.maneuver import Maneuver
from stoop.strategy.method import MIN_MOTOR_RATE
from stoop.strategy.run import choose_method
from stoop.workflow.identification import fit

SECONDS = 20.0
FINE = 500.0  #: Hz, of the simulation
SHAKEN = 1.5  #: rad/s2, of the commanded angular accelerations
INERTIA = ("mass.inertia.xx", "mass.inertia.yy")
WINDOWS, REGRESSION = "multiple-shooting", "equation-error"
INPUTS = [
    (control, shape, t + start, step, amplitude)
    for t in (0.0, 10.0)
    for control, shape, start, step, amplitude in (
        ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.5, 0.15, 8.0), ("yaw", "doublet", 4.0, 0.4, 1.5),
        ("heave", "3-2-1-1", 5.5, 0.25, 2.0), ("roll", "doublet", 8.0, 0.15, -8.0), ("pitch", "doublet", 9.0, 0.15, -8.0),
    )
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Log:
    vehicle: Vehicle
    flown: Flight

    def at(self, rate: float) -> Flight:
        parts, names = [], [*map(str, self.flown.data.data_vars)]
        for stream, step in (("motion", 2), ("motors", round(FINE / rate))):
            own = [c for c in names if c.startswith("motor_") == (stream == "motors")]
            few = slice(step // 2, None, step)
            parts.append(Channels(stream, self.flown.time[few], {c: self.flown.column(c)[few] for c in own}))
        grid, data, sources = grid_channels(parts, 100.0, "log")
        return Flight("log", None, dataset(grid.time, data), grid.rate, sources)

    def off(self, rate: float, method: str) -> float:
        begun = self.vehicle.with_numbers({name: {"free": True, "bounds": (1e-3, 1.0)} for name in INERTIA})
        found = fit_by(method, begun, {"log": self.at(rate)}, [Window("log", 0.2, SECONDS - 0.2)])
        return max(abs(found.estimates[n] / self.vehicle.value(n) - 1.0) for n in INERTIA)


@pytest.fixture(scope="module")
def log() -> Log:
    keys = {"shape": "multisine", "start": 0.0, "duration": SECONDS, "amplitude": SHAKEN, "band": 200.0}
    shaken = [{"control": c, "first": 601 + i, "stride": 7, **keys} for i, c in enumerate(("roll", "pitch"))]
    doublets = maneuver(SECONDS, *INPUTS).model_dump(mode="json", exclude_defaults=True)["input"]
    flown = Maneuver.model_validate({"duration": SECONDS, "rate": FINE, "input": [*doublets, *shaken]})
    vehicle = load_vehicle("quad-x")
    return Log(vehicle, simulate_flight(vehicle, flown, seed=1, name="log"))


def test_half_the_threshold_is_too_slow_and_five_times_is_not(log: Log) -> None:
    """At 25, 50, 100, 125, 250 Hz: 2.44, 0.39, 0.13, 0.05, 0.01 by windows; 0.34, 0.24, 0.06, 0.03, 0.001 by regression."""
    slow, fast = log.at(0.5 * MIN_MOTOR_RATE), log.at(5.0 * MIN_MOTOR_RATE)
    assert choose_method("", log.vehicle, [slow]).options.method == REGRESSION
    assert choose_method("", log.vehicle, [fast]).options.method == WINDOWS
    assert log.off(5.0 * MIN_MOTOR_RATE, WINDOWS) < 0.03
    wrong = log.off(0.5 * MIN_MOTOR_RATE, WINDOWS)
    assert wrong > 0.2
    assert log.off(0.5 * MIN_MOTOR_RATE, REGRESSION) < 0.75 * wrong


def test_error_bars_at_the_threshold_hold_the_moments_of_inertia(log: Log) -> None:
    """As a user fits them, with a lag to estimate: by equation error they are 8 standard errors off."""
    free = {n: {"free": True, "value": 1.3 * log.vehicle.value(n), "bounds": (1e-3, 1.0)} for n in INERTIA}
    begun = log.vehicle.with_numbers({**free, "rotors.lag": {"free": True, "bounds": (0.002, 0.3)}})
    found = fit(begun, log.at(MIN_MOTOR_RATE), [f"0.2:{SECONDS - 0.2}"]).result
    assert found.method == WINDOWS
    for name in INERTIA:
        own = found.parameters[name]
        assert own.std_error is not None
        assert abs(own.estimate - log.vehicle.value(name)) < 2.0 * own.std_error < log.vehicle.value(name)

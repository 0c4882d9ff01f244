"""Which stretches of a flight are windows: maneuvers of any size and length, flights that are one; the greedy choice."""

from typing import Any

import numpy as np
import pytest
from helpers.flown import maneuver
from tune.made_up import quad

from stoop.base.arrays import FloatArray
from stoop.errors import FlightError
from stoop.flight import Flight, FlownManeuver, from_columns
from stoop.flight.windows import Proposed
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_plan.input_design import windows as stretches
from stoop_plan.input_design.candidates import Candidate, Excitation, saturated, with_motors
from stoop_plan.input_design.windows import CandidateInformation, Selection, doubts, find_windows, select
from stoop_plan.report import information_strip

RATE = 50.0
TIME = np.arange(0.0, 60.0, 1.0 / RATE)


def rolled(aileron: FloatArray, gust: FloatArray, feedback: float = 0.0) -> Flight:
    """Return a flight whose roll rate follows ailerons and gusts by one lag: p' = -5 p + 40 delta + gust."""
    p, phi, delta = (np.zeros(TIME.size) for _ in range(3))
    for k in range(1, TIME.size):
        delta[k - 1] = aileron[k - 1] - feedback * (p[k - 1] + phi[k - 1])
        p[k] = p[k - 1] + (-5.0 * p[k - 1] + 40.0 * delta[k - 1] + gust[k - 1]) / RATE
        phi[k] = phi[k - 1] + p[k - 1] / RATE
    columns = {"p": p, "q": 0.0 * p, "r": 0.0 * p, "phi": phi, "aileron": delta}
    return from_columns("f", TIME, columns | {"vn": 20.0 + 0.0 * p, "ve": 0.0 * p, "vd": 0.0 * p})


def doublets(*inputs: tuple[float, float, float]) -> FloatArray:
    """Return doublets: start [s], step [s], amplitude [rad]."""
    out = np.zeros(TIME.size)
    for start, step, size in inputs:
        out += size * ((start <= TIME) & (start + step > TIME))
        out -= size * ((start + step <= TIME) & (start + 2.0 * step > TIME))
    return out


CALM = np.zeros(TIME.size)


@pytest.mark.parametrize("step", [0.2, 0.3, 0.5])
@pytest.mark.parametrize("size", [0.06, 0.2])
def test_a_small_or_short_doublet_beside_a_large_one_is_a_window(step: float, size: float) -> None:
    found = find_windows({"f": rolled(doublets((10.0, 0.6, 0.2), (40.0, step, size)), CALM)}).windows
    assert [w.start <= start and w.stop >= start + 1.0 for w, start in zip(found, (10.0, 40.0), strict=True)]
    assert len(found) == 2


def noise(seed: int, seconds: float) -> FloatArray:
    levels = np.random.default_rng(seed).normal(size=TIME.size)
    return np.repeat(levels, round(seconds * RATE))[: TIME.size]


def test_a_log_that_is_busy_throughout_has_windows_and_an_autopilot_in_gusts_has_none() -> None:
    busy = find_windows({"f": rolled(0.05 * noise(1, 0.4), CALM)}).windows
    assert sum(w.stop - w.start for w in busy if w.purpose == "fit") > 10.0
    with pytest.raises(FlightError, match="no maneuver here"):
        find_windows({"f": rolled(CALM, 2.0 * noise(2, 0.4), feedback=0.1)})

    vehicle = builtin_vehicle("twin-boom")
    still = simulate_flight(vehicle, maneuver(20.0, airspeed=35.0), seed=1, name="still")
    with pytest.raises(FlightError, match="no maneuver here"):
        find_windows({"still": still}, vehicle)


@pytest.fixture(scope="module")
def pulsed() -> tuple[Vehicle, Flight]:
    vehicle = quad("pwm", gain=0.001, idle=1000)
    roll = maneuver(8.0, ("roll", "3-2-1-1", 2.0, 0.15, 12.0), rate=100.0)
    return vehicle, simulate_flight(vehicle, roll, seed=1, name="f")


def test_windows_of_pulses(pulsed: tuple[Vehicle, Flight]) -> None:
    vehicle, flight = pulsed
    assert not flight.carried_by_rotors()
    assert "roll" in [w.axis for w in find_windows({"f": flight}, vehicle).windows]
    assert not [d for d in doubts({"f": flight}, vehicle) if "rotors" in d.code]


def test_motors_are_told_by_gain_and_idle_and_a_pusher_does_not_lift(pulsed: tuple[Vehicle, Flight]) -> None:
    vehicle, flight = pulsed
    told = with_motors(flight, vehicle)
    assert np.allclose(told.column("motor_3"), 0.001 * (flight.column("pwm_3") - 1000.0))
    assert told.flying().all()
    for one, by in ((flight, None), (flight, builtin_vehicle("twin-boom")), (told, vehicle)):
        assert with_motors(one, by) is one
    tried, bare = (stretches._candidates(told, by, Excitation.of(told)) for by in (vehicle, None))
    assert {c.maneuver is None for c in tried} == {True, False}
    assert all(c.maneuver is not None for c in bare)
    last = vehicle.text.index('channel = "pwm_4"')
    pusher = parse_vehicle(vehicle.text[:last] + "axis = [1, 0, 0]\n" + vehicle.text[last:], "pusher.toml")
    names = set(with_motors(flight, pusher).data) & {f"motor_{i}" for i in range(1, 5)}
    assert names == {"motor_1", "motor_2", "motor_3"}


def at(start: float, seconds: float = 8.0, axis: str = "") -> Candidate:
    found = FlownManeuver(axis, "u", start, start + seconds, 1.0, 2, 9.0, 1.0) if axis else None  # type: ignore[arg-type]
    return Candidate("f", start, start + seconds, found)


def chosen(found: list[Candidate], *told: np.ndarray) -> Selection:
    return select(found, CandidateInformation(np.eye(len(told[0])), tuple(told)))


@pytest.mark.parametrize(
    ("windows", "told", "fitted", "held_out"),
    [
        ([(0.0,), (20.0,), (40.0,)], [(100.0, 0.0), (102.0, 0.0), (0.0, 50.0)], {1, 2}, {0}),  # doubles
        ([(0.0,), (4.0,)], [(100.0, 0.0), (0.0, 99.0)], {0}, set()),  # they overlap
        ([(0.0,), (1.0, 4.0)], [(30.0, 30.0)] * 2, {1}, set()),  # the shorter of two equals
        ([(0.0, 4.0), (0.5, 5.0, "roll")], [(30.0, 30.0)] * 2, {1}, set()),  # a whole maneuver
        ([(0.0,)], [(0.05, 0.05, 0.05)], set(), set()),  # what tells little is left
        # the weaker one of an axis is held out, and the only one about an axis never is
        ([(0.0, 7.0, "roll"), (10.0, 3.0, "roll"), (20.0, 5.0, "yaw")], [(900.0, 0.0), (400.0, 0.0), (0.0, 50.0)], {0, 2}, {1}),
        ([(0.0, 7.0, "roll"), (20.0, 5.0, "yaw")], [(900.0, 0.0), (0.0, 50.0)], {0, 1}, set()),
        # each axis flown twice is predicted once
        ([(10.0 * i, 5.0, ("pitch", "yaw", "roll")[i % 3]) for i in range(6)], [*60.0 * np.eye(3), *10.0 * np.eye(3)],
         {0, 1, 2}, {3, 4, 5}),
    ],
)  # fmt: skip
def test_windows_that_tell_different_things_are_taken(
    windows: Any, told: Any, fitted: Any, held_out: Any
) -> None:
    choice = chosen([at(*one) for one in windows], *map(np.diag, told))
    assert (set(choice.fitted), set(choice.held_out)) == (fitted, held_out)
    if len(windows) == 3 and told[0][0] == 100.0:
        assert choice.gains[0] == pytest.approx(0.25 * np.log(103.0))


def test_greedy_is_near_the_best_of_its_size() -> None:
    """Submodular: no worse than 1 - 1/e of the best; here against all pairs."""
    rng = np.random.default_rng(0)
    told = [(v := rng.normal(size=(4, 2)) * rng.uniform(1, 9)) @ v.T for _ in range(9)]
    information = CandidateInformation(np.eye(4), tuple(told))
    both = select([at(10.0 * i) for i in range(9)], information).fitted[:2]

    def total(pair: tuple[int, ...]) -> float:
        return float(np.linalg.slogdet(information.total(pair))[1])

    best = max(total((i, j)) for i in range(9) for j in range(i))
    assert total(both) > (1.0 - 1.0 / np.e) * best


def test_a_command_that_rests_at_its_end_is_saturated_and_a_peak_or_a_pulsed_pusher_is_not() -> None:
    flying, x = np.ones(400, dtype=bool), 0.5 + 0.3 * np.sin(np.arange(400) / 20.0)
    assert not saturated(x, flying).sum() > 16
    held, starved = np.minimum(x, 0.7), np.maximum(x, 0.3)
    found = saturated(held, flying)
    assert found[held == 0.7].all()
    assert not found[np.abs(held - 0.5) < 0.1].any()
    assert saturated(starved, flying)[starved == 0.3].all()
    for moved in (np.full(100, 0.4), 0.3 + 0.1 * np.random.default_rng(0).random(100)):
        assert not saturated(np.concatenate([np.zeros(100), moved, np.zeros(200)]), flying).any()


def test_no_more_is_held_out_than_the_error_bars_allow() -> None:
    """Doubled information shrinks error bars by log(2) / 2, each pair alone by half of that over two numbers: 0.17, then 0.35."""
    told = [np.diag([1e6, 0.0]), np.diag([0.0, 1e6])] * 2
    choice = chosen([at(10.0 * i, 5.0, ("pitch", "roll")[i % 2]) for i in range(4)], *told)
    assert (len(choice.held_out), len(choice.fitted)) == (1, 3)


def test_information_is_drawn_over_its_windows_alone() -> None:
    spans = ((1.0, 3.0, 2.0), (3.0, 8.0, 0.5))
    strip = information_strip([Proposed("f", a, b, "roll", "why", x, 0.0, True, "fit") for a, b, x in spans])
    (series,) = strip.series
    assert series.x == pytest.approx(np.array([1.0, 3.0, np.nan, 3.0, 8.0, np.nan]), nan_ok=True)
    assert series.y == pytest.approx(np.array([2.0, 2.0, np.nan, 0.5, 0.5, np.nan]), nan_ok=True)
    assert strip.zero

"""Delays of commands and of sensors are found in the record; a file that gives one decides, and none is made up."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from core.strategy import test_strategy as short
from core.strategy.test_strategy import known

from stoop.assessment.error_bars import ErrorBars
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, SPECIFIC_FORCE, VELOCITY
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.estimate.regression.command_delay import LONGEST, Scan, scan_delays
from stoop.flight import Flight
from stoop.flight.flight import from_columns
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.reconstruction.compatibility import Compatibility
from stoop.results.extensions import ExtensionTest, ExtensionTests
from stoop.strategy import Strategy, sensor_delays
from stoop.strategy.assumptions import with_found_delays
from stoop.strategy.decision import Fitted, Setup, estimate
from stoop.strategy.run import setup_of
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import catalogue
from stoop.workflow.identification import search
from stoop_studies.verify import scenes
from stoop_studies.verify.delays import WIND, late_sensors

CONTROLS, NAMES = ("elevator", "aileron", "rudder"), ("pitch", "roll")
NUMBER, WINDOWS = "controls.elevator.delay", [Window(name, 0.0, scenes.DURATION) for name in NAMES]


@cache
def flown() -> tuple[Flight, ...]:
    fly, truth, maneuvers = scenes.simulate_flight, scenes.aircraft(), scenes.maneuvers()
    return tuple(fly(truth, maneuvers[n], noise=True, seed=seed, name=n) for seed, n in enumerate(NAMES))


def commanded_early(flight: Flight, seconds: float) -> Flight:
    n = round(seconds * flight.rate)
    ahead = {c: ("time", np.append(flight.column(c)[n:], np.full(n, flight.column(c)[-1]))) for c in CONTROLS}
    return replace(flight, data=flight.data.assign(ahead))


def scanned(flights: list[Flight]) -> Scan | None:
    vehicle = scenes.aircraft()
    pieces = Prepared.of(vehicle, {one.name: one for one in flights}, WINDOWS).pieces
    return scan_delays(vehicle, pieces, [vehicle.inputs.index(c) for c in CONTROLS])


def best(flights: list[Flight]) -> float:
    scan = scanned(flights)
    assert scan is not None
    assert scan.delays[-1] == pytest.approx(LONGEST)
    return float(scan.delays[np.argmax(scan.log_likelihood)])


def found(vehicle: Vehicle, seconds: float) -> dict[str, float]:
    flights = {one.name: commanded_early(one, seconds) for one in flown()}
    changed, notices = with_found_delays(setup_of(Strategy.default(), vehicle, flights, WINDOWS), vehicle)
    assert {n.subject for n in notices} == {n for n in changed.rows if n == NUMBER and n not in vehicle.rows}
    return {n.subject: float(str(n.values["delay"])) for n in notices}


@pytest.mark.parametrize("seconds", [0.0, 0.12, 0.46])
def test_the_scan_finds_the_sample(seconds: float) -> None:
    flights = [commanded_early(one, seconds) for one in flown()]
    assert best(flights) == pytest.approx(seconds, abs=0.5 / flown()[0].rate)


def test_a_delay_by_which_controls_turn_the_wrong_way_is_none() -> None:
    """Commands that answer a motion explain it at the delay of the answer, with the other sign."""
    early = [commanded_early(one, 0.3) for one in flown()]
    back = [replace(e, data=e.data.assign({c: ("time", -e.column(c)) for c in CONTROLS})) for e in early]
    scan = scanned(back)
    assert scan is not None
    there = int(np.argmin(np.abs(scan.delays - 0.3)))
    # no better than no control at all, which any delay may be
    assert scan.log_likelihood[there] == pytest.approx(scan.log_likelihood.min(), abs=1.0)
    lost = {c: ("time", np.full(len(flown()[0].time), np.nan)) for c in "pqr"}
    assert scanned([replace(one, data=one.data.assign(lost)) for one in flown()]) is None, "no rates"


def test_a_delay_beyond_the_usual_is_found_and_none_is_made_up() -> None:
    assert found(scenes.aircraft(), 0.0) == {}
    assert found(scenes.aircraft(), 0.06) == {}  # the usual prior covers it
    assert found(scenes.aircraft(), 0.3) == {NUMBER: pytest.approx(0.3, abs=0.011)}


@pytest.mark.parametrize("entry", [0.0, {"value": 0.0, "free": True, "bounds": [0.0, 0.1]}])
def test_a_file_that_gives_a_delay_decides(entry: object) -> None:
    given = with_entries(scenes.aircraft(), {("controls", c, "delay"): entry for c in CONTROLS})
    flights = {one.name: commanded_early(one, 0.3) for one in flown()}
    changed, notices = with_found_delays(setup_of(Strategy.default(), given, flights, WINDOWS), given)
    assert changed is given
    assert not notices


def test_a_drafted_prior_of_a_delay_is_moved() -> None:
    """As stoop vehicle new writes it: usual of an autopilot and a logger, not of a radio link."""
    shared = "=controls.elevator.delay"
    first = {("controls", "elevator", "delay"): {"value": 0.02, "prior": 0.02}}
    others = {("controls", c, "delay"): shared for c in CONTROLS[1:]}
    drafted = with_entries(scenes.aircraft(), first | others)
    flights = [commanded_early(one, 0.4) for one in flown()]
    done = search(drafted, flights, [str(w) for w in WINDOWS], options=Options(seed=1))
    names = [p.name for p in done.estimate.problem.layout.parameters]
    std = ErrorBars.of(done.estimate).std[names.index(NUMBER)]
    assert std < 0.005
    assert abs(done.estimate.estimates[NUMBER] - 0.4) < 4.0 * std
    assert [n.code for n in done.estimate.notices].count("command-delay-found") == 1


@pytest.mark.parametrize("lost", [0.06, 0.3])
def test_a_reading_that_one_maneuver_lacks_for_a_while(lost: float) -> None:
    first, second = (commanded_early(one, 0.3) for one in flown())
    alpha = second.column("alpha").copy()
    alpha[: round(lost * len(alpha))] = np.nan
    blind = replace(second, data=second.data.assign(alpha=("time", alpha)))
    assert best([first, blind]) == pytest.approx(0.3, abs=0.5 / first.rate)


def searched(flights: list[Flight], vehicle: Vehicle | None = None) -> Fitted:
    options = Options(seed=1, method="output-error")
    return search(vehicle or scenes.aircraft(), flights, [f"roll@0:{scenes.DURATION}"], options=options)


def freed(done: Fitted) -> list[str]:
    return [one.subject for one in done.estimate.notices if one.code == "sensor-delay-freed"]


@pytest.mark.parametrize(
    ("late", "name"), [(("beta",), "beta"), (("phi", "theta", "psi"), "attitude"), ((), "")]
)
def test_a_late_sensor_is_found_and_what_is_in_time_stays(late: tuple[str, ...], name: str) -> None:
    fly, roll = scenes.simulate_flight, scenes.maneuvers()["roll"]
    flight = fly(scenes.aircraft(), roll, noise=True, seed=3, name="roll")
    readings = {c: (flight.data[c].dims, scenes.recorded_late(flight.data[c].to_numpy())) for c in late}
    flights = [replace(flight, data=flight.data.assign(readings))]
    done = searched(flights)
    assert freed(done) == ([f"sensors.{name}.delay"] if late else [])
    numbers = [one for one in done.estimate.estimates if one.endswith(".delay")]
    assert numbers == [f"sensors.{one}.delay" for one in late[:1]]
    for number in numbers:
        index = [p.name for p in done.estimate.problem.layout.parameters].index(number)
        assert abs(done.estimate.estimates[number] - scenes.LATE) < 3.0 * done.tested.bars.std[index]
        assert done.tested.bars.std[index] < 0.005
    if late == ("beta",):  # a file that gives the delay decides for itself
        given = with_entries(scenes.aircraft(), {("sensors", "beta", "delay"): 0.0})
        assert freed(searched(flights, given)) == []


@cache
def calm() -> Fitted:
    options = Options(seed=1, budget=400.0, method="output-error")
    return estimate(setup_of(Strategy.default(), known(), short.flights(), short.WINDOWS, options=options))


def stopped(found: Fitted, status: str) -> Fitted:
    outcome = replace(found.estimate.outcome, status=status, state=None, advice="")
    return replace(found, estimate=replace(found.estimate, outcome=outcome))


@pytest.fixture
def asks_for_a_delay(monkeypatch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    late = next(one for one in catalogue(known()) if one.readings)
    test = ExtensionTest(late.name, "delay", 0.02, 0.001, "s", 20.0, 1e-9, 200.0, "x", 0.02)
    asked, compared = [ExtensionTests(10, 0.05, (test,))], list[tuple[float, float]]()
    bars = cache(lambda: ErrorBars.of(calm().estimate))

    def rise(before: Estimate, after: Estimate) -> float:
        compared.append((before.cost, after.cost))
        return before.cost - after.cost

    for name, one in {
        "test": lambda found, left_out: (sensor_delays.Tested(bars(), asked.pop() if asked else ExtensionTests()), False),
        "penalized_rise": rise, "log_likelihood_rise": lambda *fits: (rise(*fits), 1.0), "_notices": lambda *args: [],
    }.items():  # fmt: skip
        monkeypatch.setattr(sensor_delays, name, one)
    return compared


@pytest.mark.parametrize("gain", [3.0, -3.0])
def test_likelihoods_of_two_methods_are_not_compared(asks_for_a_delay: list, gain: float) -> None:
    """A filter falls back to the method of calm air: the fit by that method without the delay is the one to beat."""
    filtered = calm().setup.by("filter-error")

    def fit(setup: Setup) -> Fitted:
        free = setup.vehicle is not known()
        by_filter = setup.options.method == "filter-error" and not free
        cost = 1000.0 if by_filter else 20.0 - gain * free
        done = setup if by_filter else setup.by("output-error")
        return stopped(replace(calm(), setup=done, estimate=replace(calm().estimate, cost=cost)), "converged")

    found = sensor_delays.free_delays(filtered, fit)
    assert asks_for_a_delay[0] == (20.0, 20.0 - gain)
    assert [one.gained for one in found.records.values()] == ([gain] if gain > 0.0 else [])
    assert found.estimate.cost == (20.0 - gain if gain > 0.0 else 1000.0)


@cache
def hovered(late: float) -> Flight:
    vehicle, rng, t = builtin_vehicle("quad-x"), np.random.default_rng(2), np.arange(0.0, 60.0, 0.02)
    slow = [np.convolve(rng.standard_normal(t.size), np.hanning(150), "same") for _ in range(6)]
    motion = [one / np.std(one) for one in slow]
    velocity, angles = np.column_stack(motion[:3]), 0.2 * np.column_stack(motion[3:])
    felt = np.gradient(velocity, 0.02, axis=0) - [0.0, 0.0, STANDARD_GRAVITY]
    force = to_body(quaternions_of(angles), felt)
    steps = np.clip(np.arange(t.size) - round(late / 0.02), 0, None)
    columns = dict.fromkeys(("p", "q", "r"), np.zeros(t.size))
    for names, values in ((EULER, angles), (SPECIFIC_FORCE, force), (VELOCITY, velocity[steps])):
        columns |= dict(zip(names, (values + 0.05 * rng.standard_normal(values.shape)).T, strict=True))
    columns |= dict.fromkeys(vehicle.inputs, np.full(t.size, 0.5))
    return from_columns("hover", t, columns)


@pytest.mark.parametrize(
    ("method", "late", "free"),
    [("multiple-shooting", 0.2, True), ("filter-error", 0.2, False), ("multiple-shooting", 0.0, False)],
)
def test_the_delay_of_velocities_is_known_before_the_fit(method: str, late: float, free: bool) -> None:
    flights, windows = {"hover": hovered(late)}, (Window("hover", 0.0, 5.0),)
    quad, options = builtin_vehicle("quad-x"), Options(method=method)
    change = sensor_delays.find_delay(setup_of(Strategy.default(), quad, flights, windows, options=options))
    assert change is not None
    (row,) = [one for one in change.setup.vehicle.parameters if one.name == "sensors.vn.delay"]
    assert row.free is free
    assert row.value == pytest.approx(late, abs=0.02)
    assert [one.code for one in change.setup.notices] == ["sensor-delay-found"] * bool(late)
    assert sensor_delays.find_delay(change.setup) is None  # the file decides now


@pytest.mark.parametrize("ends", ["at once", "further", "refused"])
def test_a_fit_with_a_delay_that_does_not_end_leaves_the_other(asks_for_a_delay: list, ends: str) -> None:
    """After an interruption there is no further fit; a filter refuses delays, which must be known."""
    asked = list[bool]()

    def fit(setup: Setup) -> Fitted:
        asked.append(setup.vehicle is not known())
        if ends == "refused" and asked[-1]:
            raise IdentificationError("delays of sensors must be known")
        return stopped(calm(), "interrupted" if asked[-1] or ends == "at once" else "converged")

    found = sensor_delays.free_delays(calm().setup, fit)
    assert asked == [False, True][: 1 if ends == "at once" else 2]
    assert not asks_for_a_delay
    assert not found.records
    assert found.estimate.outcome.status == ("converged" if ends == "refused" else "interrupted")
    assert (sensor_delays.DOING in found.estimate.outcome.advice) == (ends == "further")
    assert found.estimate.estimates == calm().estimate.estimates


@pytest.fixture(scope="module")
def checked() -> tuple[object, object]:
    flight, delays = late_sensors(1)
    return Compatibility.of(flight)[0], delays


def test_delays_wind_and_vanes_come_back(checked: tuple[object, object]) -> None:
    result, delays = checked
    found = result.findings  # type: ignore[attr-defined]
    truth = {f"{name}.delay": value for name, value in delays.items()}  # type: ignore[attr-defined]
    truth |= {"wind.n": WIND[0], "wind.e": WIND[1], "alpha.scale": 1.0, "beta.scale": 1.0, "V.scale": 1.0}
    for name, value in truth.items():
        assert abs(found[name].estimate - value) < 4.0 * found[name].std_error, name
    assert found["velocity.delay"].std_error < 0.003
    assert not any("inconsistent" in warning for warning in map(str, result.notices))  # type: ignore[attr-defined]

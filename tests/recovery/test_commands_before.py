"""A window that begins while commands are on their way, and air data that were reconstructed by a wrong wind."""

from dataclasses import replace

import numpy as np
import pytest

import stoop
from stoop import Flight, Strategy, Vehicle, load_vehicle, simulate_flight
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.variables import EULER, RATES
from stoop.problem.archive import problem_arrays, problem_document, restored_problem
from stoop.problem.misfit import HISTORY, Misfit, Piece
from stoop.problem.observation import at_center_of_gravity
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.document import with_entries
from stoop.workflow.demo import MANEUVER
from stoop.workflow.identification import search
from stoop_studies.verify import scenes

CONTROLS = ("elevator", "aileron", "rudder")
DELAY = 0.3  #: s
ERROR = np.array([1.6, -1.1, 0.0])  #: m/s, of a wind that was found by a flight that turns little
AIR = ("V", "alpha", "beta")


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    own = {"value": DELAY, "free": True, "prior": 0.1}
    shared = {("controls", c, "delay"): "=controls.elevator.delay" for c in CONTROLS[1:]}
    return with_entries(scenes.aircraft(), {("controls", "elevator", "delay"): own} | shared)


@pytest.fixture(scope="module")
def flight() -> Flight:
    """A maneuver whose commands are stamped before they act."""
    flown = scenes.simulate_flight(scenes.aircraft(), scenes.maneuvers()["pitch"], noise=True, name="pitch")
    n = round(DELAY * flown.rate)
    ahead = {c: ("time", np.append(flown.column(c)[n:], np.full(n, flown.column(c)[-1]))) for c in CONTROLS}
    return replace(flown, data=flown.data.assign(ahead))


def begun(flight: Flight) -> float:
    moved = np.abs(np.diff(flight.column("elevator"))) > 0.0
    return float(flight.time[np.flatnonzero(moved)[0] + round(0.5 * DELAY * flight.rate)])


def pieces(vehicle: Vehicle, flight: Flight, start: float) -> tuple[Piece, ...]:
    return Prepared.of(vehicle, {flight.name: flight}, [Window(flight.name, start, scenes.DURATION)]).pieces


def test_a_window_receives_what_the_whole_record_does(vehicle: Vehicle, flight: Flight) -> None:
    rows = vehicle.parameter_rows()
    (whole,), (late,) = pieces(vehicle, flight, 0.0), pieces(vehicle, flight, begun(flight))
    first = len(whole.time) - len(late.time)
    expected = whole.received(vehicle, rows)[first:]
    assert late.received(vehicle, rows) == pytest.approx(expected, abs=1e-12)
    assert np.abs(replace(late, before=None).received(vehicle, rows) - expected).max() > 0.01
    part = whole.part(first, len(whole.time), late.start)
    assert part.received(vehicle, rows) == pytest.approx(expected, abs=1e-12)


def test_commands_are_known_back_to_a_hole(vehicle: Vehicle, flight: Flight) -> None:
    elevator = flight.column("elevator").copy()
    elevator[int(np.searchsorted(flight.time, 2.0)) - 7] = np.nan
    holed = replace(flight, data=flight.data.assign(elevator=("time", elevator)))
    given = ((flight, 2.0), (holed, 2.0), (flight, 0.0))
    shapes = [p.before.shape for f, start in given for p in pieces(vehicle, f, start) if p.before is not None]
    assert shapes == [(n, len(vehicle.recorded)) for n in (round(HISTORY * flight.rate), 6, 0)]


def test_a_fit_of_such_a_window_finds_the_truth(vehicle: Vehicle, flight: Flight) -> None:
    window, textbook = f"{begun(flight)}:{scenes.DURATION}", Strategy.named("textbook")
    done, truth = search(vehicle, [flight], [window], strategy=textbook).estimate, scenes.aircraft()
    assert done.estimates["controls.elevator.delay"] == pytest.approx(DELAY, abs=0.005)
    assert done.estimates["Cmq"] == pytest.approx(truth.value("Cmq"), rel=0.1)
    again: Misfit = restored_problem(problem_document(done.problem), problem_arrays(done.problem))
    for kept, restored in zip(done.problem.pieces, again.pieces, strict=True):
        assert np.array_equal(np.asarray(kept.before), np.asarray(restored.before))


def vehicle_with(sensors: str) -> Vehicle:
    own = load_vehicle("twin-boom")
    return parse_vehicle(f"{own.text}\n[sensors]\n{sensors}\n", "wind.toml")


def reconstructed(flight: Flight, error: np.ndarray) -> Flight:
    """Return a flight whose air data are its velocity over ground through air of another wind."""
    V, alpha, beta = (flight.column(n) for n in AIR)
    angles = np.stack([flight.column(n) for n in EULER], axis=1)
    turned = to_body(quaternions_of(angles), np.tile(error, (len(V), 1))).T
    along = np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    u, v, w = V * along + turned
    speed = np.sqrt(u**2 + v**2 + w**2)
    read = {"V": speed, "alpha": np.arctan2(w, u), "beta": np.arcsin(v / speed)}
    columns = {n: flight.column(n) for n in flight.channels} | read
    return replace(flight, data=type(vars(flight)["data"])(flight.time, columns))


@pytest.fixture(scope="module")
def flown() -> Flight:
    return simulate_flight(load_vehicle("twin-boom"), parse_maneuver(MANEUVER, "m"), name="sim", seed=3)


@pytest.mark.parametrize("pitot", [False, True])
def test_a_start_that_was_read_is_the_true_one(pitot: bool, flown: Flight) -> None:
    scale = "V = { scale = 1.0 }" if pitot else ""
    vehicle, wrong = vehicle_with(f"wind_error = {ERROR.tolist()}\n{scale}"), reconstructed(flown, ERROR)
    read = {n: wrong.column(n)[::50] for n in (*AIR, *RATES, *EULER)}
    if pitot:
        read["V"] = flown.column("V")[::50]
    found = at_center_of_gravity(vehicle, read)
    for n in AIR:
        np.testing.assert_allclose(found[n], flown.column(n)[::50], atol=1e-9)


def test_coefficients_hold_although_the_wind_was_wrong(flown: Flight) -> None:
    """The error bars contain the wind's error; a scale of the airspeed in its place is known too well, and wrong."""
    wrong, truth, z = reconstructed(flown, ERROR), load_vehicle("twin-boom"), {}
    for name, sensors in (
        ("wind", "wind_error = [{value = 0.0, prior = 1.5}, {value = 0.0, prior = 1.5}, 0.0]"),
        ("scale", "V = { scale = {value = 1.0, prior = 0.08} }"),
    ):
        fitted = stoop.fit(vehicle_with(sensors), wrong, maneuvers=["0:12"], strategy="textbook")
        found = fitted.result.parameters
        aerodynamic = {n: p for n, p in found.items() if n[0] == "C" and p.identifiable and not p.at_bound}
        assert len(aerodynamic) > 12
        z[name] = np.array([(p.estimate - truth.value(n)) / p.std_error for n, p in aerodynamic.items()])
        if name == "wind":
            one = found["sensors.wind_error.x"]
            assert abs(one.estimate - ERROR[0]) < 2.0 * one.std_error < 1.5
            true = float(flown.column("V")[flown.time <= 12.0].mean())
            assert fitted.result.modes[0].airspeed == pytest.approx(true, abs=2.0 * one.std_error)
    rms = {name: float(np.sqrt(np.mean(x**2))) for name, x in z.items()}
    assert rms["wind"] < 1.3
    assert rms["scale"] > 2.0

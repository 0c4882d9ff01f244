"""Made-up vehicles, their flights and logs, and the truth of files that others wrote, for `stoop verify defaults`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.flight import load
from stoop.flight.airborne import carried_by_rotors, flying
from stoop.simulation import initial_states, parameter_rows
from stoop.vehicle import parse_vehicle
from stoop_studies.verify import instruments, pilots, truths
from stoop_studies.verify.defaults import (
    FLIGHTS,
    airspeed_scale,
    drafted_file,
    flight_of,
    fly,
    known_file,
    quick_file,
    right,
    scores,
    spoiled,
)
from stoop_studies.verify.defects import edited
from stoop_studies.verify.made_up import KINDS, made_up
from stoop_studies.verify.truths import Deflection


def test_vehicles_can_exist_and_are_as_drawn() -> None:
    """Mass within the range of its kind, moments of inertia of a body, and the same numbers for the same number."""
    assert len(KINDS) == 20
    assert FLIGHTS == 40
    for i, (template, _, (low, high)) in enumerate(KINDS):
        made = made_up(i)
        value = made.vehicle.value
        xx, yy, zz = (value(f"mass.inertia.{a}") for a in ("xx", "yy", "zz"))
        assert made.template == template
        assert low <= value("mass.mass") <= high
        assert zz < xx + yy
        assert xx < yy + zz
        assert abs(made.tape["mass"] / value("mass.mass") - 1.0) < 0.05
    made_up.cache_clear()
    assert made_up(3).vehicle.text == made_up(3).vehicle.text


def test_seeds_fly_every_flight_once() -> None:
    numbers = [flight_of(seed) for seed in range(FLIGHTS)]
    assert sorted(numbers) == list(range(FLIGHTS))
    assert sorted(n // 2 for n in numbers[: len(KINDS)]) == list(range(len(KINDS)))
    assert {n % 2 for n in numbers[:2]} == {0, 1}


def test_a_glider_is_steady_without_thrust() -> None:
    vehicle = made_up(4).vehicle
    point = pilots.steady(vehicle)
    rows = parameter_rows(vehicle)
    state = initial_states(vehicle, point.start, rows, point.inputs)
    rates, _ = vehicle.kernel().evaluate(rows, state, point.inputs[:, None])
    moving = [vehicle.states.index(s) for s in ("u", "v", "w", "p", "q", "r")]
    assert np.abs(rates[moving]).max() < 1e-6


def test_both_simulators_fly_the_same() -> None:
    """In calm air the flights of stoop and of JSBSim, under the same pilot, stay together."""
    made = made_up(0)
    flown = [
        pilots.FLYING[name](
            made.vehicle, pilots.plan(made.vehicle, made.throw, np.random.default_rng(1)), made.throw, rng
        )
        for name in ("stoop", "JSBSim")
        for rng in (np.random.default_rng(2),)
    ]
    for channel, limit in (
        ("V", 0.05),
        ("alpha", 0.001),
        ("p", 0.01),
        ("q", 0.01),
        ("phi", 0.01),
        ("az", 0.1),
    ):
        assert np.abs(flown[0][channel] - flown[1][channel]).max() < limit, channel


def test_gusts_have_the_intensity_of_the_file() -> None:
    table = {a: {"intensity": 0.7, "length": 30.0} for a in "uvw"}
    vehicle = parse_vehicle(edited(made_up(0).vehicle.text, {"turbulence": table}), "gusty")
    gusts = pilots.dryden(vehicle, 100_000, np.random.default_rng(0))
    assert gusts.std(axis=0) == pytest.approx([0.7] * 3, rel=0.1)


def test_logs_are_read_back(tmp_path: Path) -> None:
    """What a recorder knows comes back with units and signs; the truth stays out; at rest nothing moves."""
    for number in (0, 2, 4):  # PX4, ArduPilot, a table
        flown = fly(number, tmp_path)
        flight = load(flown.path)
        aloft = flight.time > flown.time[0] + instruments.GROUND + 3.0
        surface = "elevator" if flown.vehicle.record == "csv" else "control_pitch"
        gain = 1.0 if surface == "elevator" else -flown.vehicle.throw["elevator"]
        commanded = np.interp(flight.time[aloft], flown.time, flown.commands["elevator"])
        assert gain * flight.column(surface)[aloft] == pytest.approx(commanded, abs=0.02)
        assert np.nanmean(flight.column("az")[aloft]) == pytest.approx(-9.8, abs=1.0)
        assert "thrust" not in flight.data
    assert not list(tmp_path.glob("*truth*"))


def test_a_lost_reading_is_not_logged(tmp_path: Path) -> None:
    number = next(n for n in range(FLIGHTS) if fly(n, tmp_path).defect.gaps)
    flown = fly(number, tmp_path)
    name = {"rates": "p", "attitude": "phi", "velocity": "vn"}[flown.defect.gaps]
    assert np.isnan(load(flown.path).column(name)).any()


def test_truth_of_a_file_gives_the_same_forces() -> None:
    """A file with other lengths, working point, signs and zeros of surfaces accelerates as the truth, with its true numbers."""
    truth = made_up(1).vehicle
    surfaces = {
        "elevator": Deflection(-0.8, 0.02),
        "aileron": Deflection(1.3, -0.01),
        "rudder": Deflection(0.9, 0.005),
    }
    value = truth.value
    changes: dict[str, Any] = {
        "reference.area": 1.1 * value("reference.area"), "reference.span": 0.95 * value("reference.span"),
        "reference.chord": 1.07 * value("reference.chord"), "reference.alpha": value("reference.alpha") + 0.04,
    }  # fmt: skip
    for name in surfaces:
        changes[f"controls.{name}.lag"] = None
    file = parse_vehicle(edited(truth.text, changes), "file")
    plain = parse_vehicle(edited(truth.text, {f"controls.{n}.lag": None for n in surfaces}), "plain")
    known = truths.aerodynamic(plain, file, surfaces, value("reference.airspeed"), held=False)
    file = file.with_numbers({n: {"value": x} for n, x in known.items()})
    rng = np.random.default_rng(0)
    for _ in range(5):
        start = {"V": 20.0, "alpha": rng.normal(0.05, 0.05), "beta": rng.normal(0.0, 0.1), "h": 250.0}
        start |= dict(zip("pqr", rng.normal(0.0, 0.5, 3).tolist(), strict=True))
        own = {n: rng.normal(0.0, 0.1) for n in surfaces} | {"control_throttle": 0.5}
        true = own | {n: m.gain * own[n] + m.offset for n, m in surfaces.items()}
        rates = []
        for vehicle, deflected in ((plain, true), (file, own)):
            rows = parameter_rows(vehicle)
            inputs = np.array([deflected[c] for c in vehicle.inputs])
            state = initial_states(vehicle, start, rows, inputs)
            rates.append(vehicle.kernel().evaluate(rows, state, inputs[:, None])[0])
        assert rates[1] == pytest.approx(rates[0], rel=1e-9, abs=1e-9)


def test_deflections_of_a_file_are_compared_with_the_commands(tmp_path: Path) -> None:
    """The quick start guesses 0.35 rad at full command, whatever the truth is."""
    flown = fly(0, tmp_path)
    flight, file = load(flown.path), quick_file(flown)
    span = (flown.time[0] + 14.0, flown.time[-1])
    found = truths.deflections(file, flight, flown.time, flown.commands, span)
    for name, one in found.items():
        assert one.gain == pytest.approx(flown.vehicle.throw[name] / 0.35, rel=0.01)
        assert one.offset == pytest.approx(0.0, abs=1e-3)
    same = truths.deflections(known_file(flown), flight, flown.time, flown.commands, span)
    assert [m.gain for m in same.values()] == pytest.approx([1.0] * 3, rel=0.01)


def record(**changes: Any) -> dict[str, Any]:
    known = {"Clp": [-0.5, 0.02, -0.51, 0.0, 1.0], "Cmq": [-10.0, 1.0, -11.0, 0.0, 1.0]}
    return {
        "numbers": known, "per_inertia": known, "predictions": [["p", 0.1, 0.3, True]], "grade": "usable",
        "uses": ["control design"], "needs": {"control design": [["Clp"], ["Cmq"]]}, "stopped": "",
    } | changes  # fmt: skip


def test_a_verdict_is_right_where_the_truth_bears_it_out() -> None:
    wrong = {"Clp": [-0.5, 0.02, -1.0, 0.0, 1.0], "Cmq": [-10.0, 1.0, -11.0, 0.0, 1.0]}
    assert right(record())
    assert not right(record(grade="do not use", uses=[]))
    assert not right(record(numbers=wrong))
    assert right(record(numbers=wrong, grade="do not use", uses=[]))
    assert right(record(numbers=wrong, uses=[]))
    assert not right(record(predictions=[["p", 0.3, 0.1, False]], grade="trusted"))
    assert spoiled(record(predictions=[["p", 0.3, 0.1, False]]))


def test_a_number_at_a_bound_holds_nothing_and_an_unidentifiable_one_is_not_counted() -> None:
    rows = {"a": [1.0, 0.1, 1.1, 0.0, 1.0], "b": [1.0, 0.1, 1.0, 1.0, 1.0], "c": [1.0, 9.0, 5.0, 0.0, 0.0]}
    z, bound = scores([record(numbers=rows)], "numbers")
    assert z == pytest.approx([-1.0])
    assert bound == 1


def test_a_draft_frees_what_all_maneuvers_share(tmp_path: Path) -> None:
    """Air data that were reconstructed may be wrong by the wind; those of vanes and pitot by the pitot's position."""
    rebuilt, measured = (drafted_file(fly(number, tmp_path)) for number in (0, 4))
    free = {p.name: p.prior for p in rebuilt.parameters if p.free}
    assert 0.05 < (free["sensors.wind_error.x"] or 0.0) < 1.0
    assert 0.05 < (free["sensors.wind_error.y"] or 0.0) < 1.0
    assert 0.002 < (free["sensors.alpha.bias"] or 0.0) == (free["sensors.beta.bias"] or 0.0) < 0.05
    assert "sensors.V.scale" not in free
    other = {p.name: p.prior for p in measured.parameters if p.free}
    assert other["sensors.V.scale"] == 0.05
    assert not {"sensors.alpha.bias", "sensors.wind_error.x"} & other.keys()


def test_a_glider_on_its_hill_does_not_hover(tmp_path: Path) -> None:
    """It stands above the lowest point of its flight with four servos at their middle, which its parameters name."""
    flown = fly(8, tmp_path)
    flight = load(flown.path)
    up = flight.time[flying(flight)]
    assert not carried_by_rotors(flight)
    assert up[0] > flown.time[0] + instruments.GROUND


def test_the_scale_of_the_airspeed_is_that_of_the_loaded_flight(tmp_path: Path) -> None:
    """A pitot that reads 8 % low is calibrated when its log is loaded: what a model has to find is the rest, 1 %."""
    flown = fly(32, tmp_path)
    assert flown.defect.scale["V"] == pytest.approx(0.925, abs=0.001)
    span = (flown.time[0] + instruments.GROUND + 2.0, float(flown.time[-1]))
    assert airspeed_scale(flown, load(flown.path), span) == pytest.approx(0.99, abs=0.005)

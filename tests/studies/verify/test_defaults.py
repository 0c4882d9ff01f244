from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.flight import load_flight
from stoop.vehicle import parse_vehicle
from stoop_studies.verify import instruments, truths
from stoop_studies.verify.defaults import fly, right, scores, spoiled
from stoop_studies.verify.defects import edited
from stoop_studies.verify.made_up import made_up
from stoop_studies.verify.truths import Deflection


def test_logs_are_read_back(tmp_path: Path) -> None:
    for number in (0, 2, 4):  # PX4, ArduPilot, a table
        flown = fly(number, tmp_path)
        flight = load_flight(flown.path)
        aloft = flight.time > flown.time[0] + instruments.GROUND + 3.0
        surface = "elevator" if flown.vehicle.record == "csv" else "control_pitch"
        gain = 1.0 if surface == "elevator" else -flown.vehicle.throw["elevator"]
        commanded = np.interp(flight.time[aloft], flown.time, flown.commands["elevator"])
        assert gain * flight.column(surface)[aloft] == pytest.approx(commanded, abs=0.02)
        assert np.nanmean(flight.column("az")[aloft]) == pytest.approx(-9.8, abs=1.0)
        assert "thrust" not in flight.data
    assert not list(tmp_path.glob("*truth*"))


def test_truth_of_a_file_gives_the_same_forces() -> None:
    """A file with other lengths, working point, signs and zeros of surfaces accelerates as the truth, with its true numbers."""
    truth = made_up(1).vehicle
    elevator, aileron, rudder = Deflection(-0.8, 0.02), Deflection(1.3, -0.01), Deflection(0.9, 0.005)
    surfaces = {"elevator": elevator, "aileron": aileron, "rudder": rudder}
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
            rows = vehicle.parameter_rows()
            inputs = np.array([deflected[c] for c in vehicle.inputs])
            state = vehicle.initial_states(start, rows, inputs)
            rates.append(vehicle.kernel().evaluate(rows, state, inputs[:, None])[0])
        assert rates[1] == pytest.approx(rates[0], rel=1e-9, abs=1e-9)


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

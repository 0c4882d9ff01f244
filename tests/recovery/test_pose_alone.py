"""Truth from pose alone: an airplane and a multirotor of which motion capture recorded position and attitude."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.flown import maneuver

import stoop
from stoop import Vehicle, load_vehicle
from stoop.base.variables import EULER, POSITION, VARIABLES
from stoop.errors import VehicleError
from stoop.vehicle import parse_vehicle
from stoop.vehicle.document import with_entries
from stoop_studies.open_loop import ARX, LINE
from stoop_studies.verify import capture, defaults

PLACES = {("sensors", c): {"sigma": 0.001} for c in POSITION}
#: deflections of the twin-boom aircraft, rad
MANEUVER = maneuver(
    12.0, ("elevator", "3-2-1-1", 1.0, 0.4, 0.06), ("aileron", "doublet", 5.0, 0.5, 0.08), ("rudder", "doublet", 8.0, 0.7, 0.10),
    rate=100.0,
)  # fmt: skip
OTHER = maneuver(8.0, ("aileron", "3-2-1-1", 1.0, 0.4, -0.05), ("elevator", "doublet", 4.0, 0.8, 0.05), rate=100.0)  # fmt: skip


@cache
def captured() -> Vehicle:
    return with_entries(parse_vehicle(load_vehicle("twin-boom").text, "twin-boom"), PLACES)


def pose_of(flight: stoop.Flight, folder: Path) -> stoop.Flight:
    """Write what motion capture and the radio know, with noise of 1 mm and 0.3 deg, and read it."""
    rng, sizes = np.random.default_rng(5), dict.fromkeys(POSITION, 0.001) | dict.fromkeys(EULER, 0.005)
    inputs = [n for n in ("elevator", "aileron", "rudder", "throttle") if n in flight.names]
    columns = {c: flight.column(c) + s * rng.standard_normal(len(flight.time)) for c, s in sizes.items()}
    columns |= {n: flight.column(n) for n in inputs}
    rows = np.column_stack([flight.time, *columns.values()])
    np.savetxt(folder / "room.csv", rows, delimiter=",", header="t," + ",".join(columns), comments="")
    lines = [f'{n} = {{ column = "{n}", unit = "{VARIABLES[n].unit}" }}' for n in columns]
    text = '[time]\ncolumn = "t"\nunit = "s"\n[variables]\n' + "\n".join(lines) + "\n"
    (folder / "room.csv.toml").write_text(text, encoding="utf-8")
    return stoop.load_flight(folder / "room.csv")


def test_an_airplane_is_identified_from_its_pose(tmp_path: Path) -> None:
    truth = captured()
    flight = pose_of(stoop.simulate(truth, MANEUVER), tmp_path)
    start = truth.with_numbers({
        n: {"value": 0.8 * truth.value(n)} for n in ("CLalpha", "Cmalpha", "Cmq", "Clp", "Claileron", "Cnbeta", "Cnr")
    })  # fmt: skip
    model = stoop.fit(start, [flight], ["0:12"])
    for name in ("CLalpha", "Cmalpha", "Cmq", "Cmelevator", "Clp", "Claileron", "Cnbeta", "Cnr", "Cnrudder"):
        one = model.result.parameters[name]
        assert one.std_error < 0.12 * abs(truth.value(name)), name
        assert abs(one.estimate - truth.value(name)) < 4.0 * one.std_error, name
    assert not {n.code for n in model.result.notices} & {"rates-not-recorded", "airspeed-not-measured"}
    assert set(model.result.noise_covariance.channels) == {*EULER, *POSITION}
    assert model.result.initial_states[0].values["pn"].unit == "m"
    (tmp_path / "second").mkdir()
    second = pose_of(stoop.simulate(truth, OTHER), tmp_path / "second")
    (scores,) = stoop.validate(model, second, ["0:8"], initial_state="measured").record.open_loop.values()
    assert scores["model"] < 0.15  # noise of differentiated rates
    assert scores["model"] < 0.5 * min(scores[name] for name in ("draft", LINE, ARX))


def test_a_model_leaves_the_room_without_its_position(tmp_path: Path) -> None:
    assert captured().positions == POSITION
    with pytest.raises(VehicleError, match="turbulence: the air is still"):
        with_entries(captured(), {("turbulence", "u"): {"intensity": 0.5, "length": 100.0}})
    linear = stoop.linearize(captured())
    assert not set(POSITION) & {*linear.outputs, *linear.states}
    assert linear.C.shape == (len(linear.outputs), len(linear.states))
    stoop.export(captured(), "state-space", tmp_path / "linear")
    stoop.export(captured(), "jsbsim", tmp_path / "aircraft")
    assert captured().without_positions().positions == ()


@pytest.mark.parametrize(("case", "seed", "grade"), [("wings", 2, "trusted"), ("rotors", 0, "usable")])
def test_made_up_vehicles_are_right_by_the_defaults(case: str, seed: int, grade: str) -> None:
    found = capture.examine({"case": case, "seed": seed}, [None])[0]
    assert not found["stopped"]
    errors, _ = defaults.scores([found], "numbers")
    assert np.mean(np.abs(errors) < 2.0) > 0.85
    assert np.sqrt(np.mean(errors**2)) < 1.6
    (value, _, late, *_), *_ = found["late"]
    assert abs(value - late) < capture.DELAY_ERROR
    assert found["grade"] == grade
    assert defaults.right(found)

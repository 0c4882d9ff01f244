"""Linear models as files: re-read equal, and standard errors that a textbook formula gives too."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from scipy.io import loadmat

from stoop.exporters.matlab import StateSpace, json_text, mat_bytes, state_space, variables
from stoop.simulation import Trim
from stoop.simulation.derivatives import ParameterCovariance
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.load import parse_vehicle

SIGMA = 0.1


@pytest.fixture(scope="module")
def found(twin_boom: Vehicle, steady: Trim) -> StateSpace:
    return state_space(twin_boom, steady, ParameterCovariance(("Cmalpha", "Cmq"), np.diag([SIGMA**2, 0.0])))


def test_json_reads_back(found: StateSpace) -> None:
    read = json.loads(json_text(found))
    assert read["format"] == "stoop-state-space/1"
    for name in "ABCD":
        assert np.array_equal(np.array(read[name]), getattr(found.model, name))
    assert [s["name"] for s in read["states"]] == list(found.model.states)
    assert [s["unit"] for s in read["inputs"]] == ["rad", "rad", "rad"]
    trim = {s["name"]: s["trim"] for s in read["states"] + read["inputs"] + read["outputs"]}
    assert trim["V"] == 35.0
    assert trim["elevator"] == found.point.deflections["elevator"]
    assert trim["az"] == pytest.approx(-9.80665 * np.cos(trim["theta"]) * np.cos(trim["phi"]))
    assert read["parameters"]["propulsion.thrust"] == found.point.changes["propulsion.thrust"]


def test_mat_reads_back(found: StateSpace) -> None:
    content = mat_bytes(variables(found))
    assert content == mat_bytes(variables(found)), "no date in it"
    read = loadmat(io.BytesIO(content))
    for name in "ABCD":
        assert np.array_equal(read[name], getattr(found.model, name))
        assert np.array_equal(read[f"{name}_std"], found.standard_errors[name])
    assert [str(c[0]) for c in read["states"][:, 0]] == list(found.model.states)
    assert np.array_equal(read["x0"][:, 0], found.x)


def test_delays_are_those_that_matlab_takes(steady: Trim) -> None:
    text = builtin_vehicle("twin-boom").text
    late = "\n[controls.elevator]\ndelay = 0.1\n[controls.aileron]\n[controls.rudder]\n[sensors.q]\ndelay = 0.04\n"
    found = state_space(parse_vehicle(text + late, "late.toml"), steady)
    assert json.loads(json_text(found))["standard_errors"] == {}, "without a covariance there are none"
    read = loadmat(io.BytesIO(mat_bytes(variables(found))))
    assert read["InputDelay"].shape == (len(found.model.inputs), 1)
    assert dict(zip(found.model.inputs, read["InputDelay"][:, 0], strict=True))["elevator"] == 0.1
    document = json.loads(json_text(found))
    assert {s["name"]: s["delay"] for s in document["outputs"] if s["delay"]} == {"q": 0.04}
    assert read["OutputDelay"][:, 0].tolist() == [s["delay"] for s in document["outputs"]]


def test_standard_errors_of_pitch_stiffness(found: StateSpace) -> None:
    """d q' / d alpha grows by qbar S c / Iyy with Cmalpha, and nothing else does; the twin-boom has no Ixy, Iyz."""
    n = found.vehicle.value
    pressure = 0.5 * n("environment.density") * 35.0**2
    moment = pressure * n("reference.area") * n("reference.chord") / n("mass.inertia.yy")
    errors = found.standard_errors["A"]
    states = found.model.states
    assert errors[states.index("q"), states.index("alpha")] == pytest.approx(SIGMA * moment, rel=1e-6)
    errors = errors.copy()
    errors[states.index("q"), states.index("alpha")] = 0.0
    errors[:, states.index("V")] = 0.0  # the pitching moment changes with speed too
    assert errors.max() < 1e-9


def test_what_the_data_cannot_tell_is_no_small_error(twin_boom: Vehicle, steady: Trim) -> None:
    """Of two parameters one has no variance: what it moves is unknown, what it does not move is as before."""
    names = ("Cmalpha", "CLq")
    both = state_space(twin_boom, steady, ParameterCovariance(names, np.diag([SIGMA**2, np.inf])))
    alone = state_space(twin_boom, steady, ParameterCovariance(names[:1], np.array([[SIGMA**2]])))
    states, errors = both.model.states, both.standard_errors["A"]
    assert np.isinf(errors[states.index("alpha"), states.index("q")])
    pitch = states.index("q"), states.index("alpha")
    assert errors[pitch] == alone.standard_errors["A"][pitch] > 0.0
    row, column = states.index("alpha"), states.index("q")
    assert json.loads(json_text(both))["standard_errors"]["A"][row][column] is None
    lost = state_space(twin_boom, steady, ParameterCovariance(names[1:], np.array([[np.inf]])))
    assert np.array_equal(np.isinf(lost.standard_errors["A"]), np.isinf(errors))


def test_states_of_rotors_have_their_own_units() -> None:
    vehicle = builtin_vehicle("quad-x")
    point = Trim({"u": 0.0, "h": 0.0}, {}, {}, np.full(4, 0.6), {}, 0.0)
    signals = {s["name"]: s for s in json.loads(json_text(state_space(vehicle, point)))["states"]}
    assert [signals[n]["unit"] for n in ("u", "p", "theta", "m1.lag")] == ["m/s", "rad/s", "rad", "1"]
    assert signals["m3.lag"]["trim"] == pytest.approx(0.6)

"""Aircraft files read back, whatever the vehicle is called; functions compute its terms; the autopilot holds the attitude."""

import math
from collections.abc import Callable
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import sympy as sp

from stoop.errors import SimulationError, VehicleError
from stoop.simulation import Trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle, terms
from stoop.vehicle.builtin import builtin_vehicle
from stoop_analysis.known_model import without_turbulence
from stoop_export.jsbsim_aircraft import aircraft, folder, relative_errors
from stoop_export.jsbsim_autopilot import AttitudeHold, fly_in_jsbsim
from stoop_export.jsbsim_flight import file_name, steady_record
from stoop_export.jsbsim_model import convert, number
from stoop_export.matlab import identifier
from stoop_studies.verify.export import VEHICLES, load


def test_numbers_read_back() -> None:
    for name in ("twin-boom", "v-tail", "flying-wing", "crooked", "quad-x", "quadplane"):
        vehicle = load(name) if name in VEHICLES else builtin_vehicle(name)
        difference = relative_errors(vehicle, aircraft(vehicle))
        written = {n for group in vehicle.terms.values() for n in group} | {"mass.mass", "mass.inertia.xx"}
        if vehicle.file.rotor:
            written = {"mass.mass", "rotors.T2", "rotors.torque_ratio", "body_drag.quadratic.x"}
            written |= {n for n in vehicle.rows if n.startswith("rotor.m1.position")}
        if name == "crooked":  # points and products of inertia change their axes
            written |= {f"mass.inertia.{axes}" for axes in ("xy", "xz", "yz")}
            written |= {f"mass.center_of_gravity.{axis}" for axis in "xyz"}
        assert written <= set(difference), name
        assert max(difference.values()) < 4e-16, name


def test_any_name_is_well_formed(twin_boom: Vehicle, steady: Trim) -> None:
    name = '<b>"A & B\'s" ]]> \x07\u200b\U0001f600'
    odd = twin_boom.file.model_copy(update={"name": name, "notes": (name,)})
    vehicle = Vehicle(odd, twin_boom.text, twin_boom.where)
    for place, text in folder(vehicle, steady_record(vehicle, steady)).items():
        assert place.isascii()
        ET.fromstring(text)  # noqa: S314 - our own
    root = ET.fromstring(aircraft(vehicle))  # noqa: S314
    assert root.get("name", "").startswith('<b>"A & B\'s" ]]>')
    for name, file, function in (
        ("V-tail 8.5 kg (altlnt)", "v-tail-8-5-kg-altlnt", "v_tail_8_5_kg_altlnt"), ("", "vehicle", "vehicle"),
        ("747", "747", "vehicle_747"), ("../../etc", "etc", "etc"), ("Ä" * 99, "vehicle", "vehicle"),
    ):  # fmt: skip
        assert (file_name(name), identifier(name)) == (file, function)


def test_refusals(twin_boom: Vehicle) -> None:
    early = load("flying-wing").with_numbers({"controls.elevator.delay": {"value": -0.02}})
    lateral = twin_boom.reduced("lateral")
    for vehicle, said in ((lateral, r"or set model\.reduce"), (early, "acts before it is recorded")):
        with pytest.raises(VehicleError, match=said):
            aircraft(vehicle)
    with pytest.raises(SimulationError, match="flies on wings; give the maneuver an airspeed"):
        fly_in_jsbsim(builtin_vehicle("quad-x"), Maneuver(duration=1.0))


def test_turbulence_is_left_out(twin_boom: Vehicle) -> None:
    assert without_turbulence(twin_boom) == (twin_boom, ())
    table = "\n[turbulence]\nu = { intensity = 1.0, length = 200.0 }\n"
    vehicle, notices = without_turbulence(parse_vehicle(twin_boom.text + table, "gusty"))
    assert [n.code for n in notices] == ["turbulence-not-exported"]
    assert vehicle.states == twin_boom.states
    assert aircraft(vehicle) == aircraft(twin_boom)


VALUES = {"alpha": 0.31, "beta": -0.12, "q": 0.05, "elevator": -0.2}
OPERATIONS: dict[str, Callable[..., float]] = {"sum": lambda *a: math.fsum(a), "product": lambda *a: math.prod(a),
                                               "quotient": lambda a, b: a / b, "pow": lambda a, b: a**b,
                                               "abs": abs}  # fmt: skip


def evaluate(element: ET.Element) -> float:
    """Compute a JSBSim function as its manual says."""
    if element.tag == "value":
        return float(element.text or "")
    if element.tag == "property":
        return VALUES[(element.text or "").removeprefix("of/")]
    return OPERATIONS[element.tag](*map(evaluate, element))


def test_terms() -> None:
    symbols = {n: sp.Symbol(n, real=True) for n in VALUES}
    for text in (
        "1", "alpha", "-elevator", "alpha^2*beta", "alpha/(1 + beta^2)", "abs(beta)*q - 0.3", "(alpha - 2*q)^3 / 7",
        "1/alpha^2", "2^3*q", "alpha^0", "1e-3*beta/abs(alpha)", "abs(alpha - 3*(beta - q)/(2 + alpha^2))^2",
    ):  # fmt: skip
        tree = terms.parse(text, tuple(VALUES), "here")
        found = evaluate(convert(terms.convert(tree, symbols), {s: f"of/{n}" for n, s in symbols.items()}))
        assert found == pytest.approx(float(terms.convert(tree, VALUES)), rel=1e-12, abs=1e-15), text
    with pytest.raises(NotImplementedError, match="sin has no form"):
        convert(sp.sin(sp.Symbol("a")), {sp.Symbol("a"): "a"})
    for x in (0.1 + 0.2, -1.0 / 3.0, 5e-324, 1.7976931348623157e308, 2.0**53 + 2.0, -0.0):
        assert float(number(x)) == x, "all digits"


def maneuver(duration: float, *inputs: dict[str, object]) -> Maneuver:
    return Maneuver.model_validate({"duration": duration, "rate": 50, "airspeed": 35, "input": list(inputs)})


def test_wings_are_leveled_after_a_pulse(twin_boom: Vehicle) -> None:
    """The spiral of the free aircraft keeps its bank; the autopilot's aileron works against the pulse."""
    pulse = {"control": "aileron", "shape": "pulse", "start": 1.0, "duration": 1.0, "amplitude": 0.03}
    course = maneuver(12.0, pulse)
    flown, free = (fly(twin_boom, course, noise=False) for fly in (fly_in_jsbsim, simulate_flight))
    assert np.abs(flown.column("phi")).max() > 0.05
    assert abs(flown.column("phi")[-1]) < 0.3 * abs(free.column("phi")[-1])
    aileron = flown.column("aileron") - flown.column("aileron")[0]
    assert aileron[51:100].max() < 0.0301
    assert aileron[100:130].min() < -0.001


def test_what_it_commands_is_feedback_of_attitude_and_rates(twin_boom: Vehicle, steady: Trim) -> None:
    hold = AttitudeHold.of(twin_boom, steady)
    state = {**dict.fromkeys("pqr", 0.0), **hold.point.start, "phi": 0.1, "q": 0.1}
    moved = dict(zip(hold.controls, hold.deflections(state), strict=True))
    assert moved["aileron"] < 0.0, "left aileron against a bank to the right"
    assert moved["elevator"] > 0.0, "nose down against pitching up"
    assert abs(moved["rudder"]) < -0.1 * moved["aileron"], "against the yawing moment of the ailerons alone"


def test_noise_is_that_of_the_vehicle_file(twin_boom: Vehicle) -> None:
    quiet, noisy = (fly_in_jsbsim(twin_boom, maneuver(4.0), seed=3, noise=on) for on in (False, True))
    sigma = twin_boom.file.sensors.V.sigma
    assert np.std(noisy.column("V") - quiet.column("V")) == pytest.approx(sigma, rel=0.2)
    assert np.array_equal(noisy.column("elevator"), quiet.column("elevator"))

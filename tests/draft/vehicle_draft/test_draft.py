"""Drafted vehicle files: they load, trim, and hold the mixers that an autopilot's log was made with."""

import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.flown import maneuver

from stoop.base.arrays import FloatArray
from stoop.errors import VehicleError
from stoop.flight import Flight, load_flight
from stoop.flight.flight import from_columns
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.vehicle.builtin import builtin_vehicle
from stoop_draft.vehicle_draft.autopilot import Scale
from stoop_draft.vehicle_draft.draft import Drafted, draft
from stoop_draft.vehicle_draft.inertia import PUBLISHED, SPREAD, of_airplane, of_multirotor
from stoop_draft.vehicle_draft.power import Lift, Rotor, thrust_law
from stoop_draft.vehicle_draft.request import TEMPLATES, Request
from stoop_plan.flight_logs import save_flight_as

MASS, SPAN, CHORD = 189.4, 5.19, 0.55  #: of the twin boom
FULL = 0.5  #: rad, throw of the servos of the simulated log


@pytest.fixture(scope="module")
def flown() -> Flight:
    up, roll = ("elevator", "3-2-1-1", 1.0, 0.3, 0.05), ("aileron", "doublet", 6.0, 0.5, 0.05)
    asked = maneuver(18.0, up, roll, ("rudder", "doublet", 11.0, 0.8, 0.1), airspeed=35.0)
    return simulate_flight(builtin_vehicle("twin-boom"), asked, seed=1, name="flown")


def without_surfaces(flight: Flight, added: Mapping[str, FloatArray], known: Mapping[str, float]) -> Flight:
    kept = {str(n): flight.column(str(n)) for n in flight.data.data_vars}
    for name in ("elevator", "aileron", "rudder"):
        kept.pop(name)
    outputs = from_columns("log", flight.time, {**kept, **added})
    return replace(outputs, parameters=known)


def drafted(flight: Flight, template: str | None = None) -> Drafted:
    return draft(Request(template, MASS, SPAN, CHORD), [flight])


def as_log(flight: Flight, path: Path) -> Flight:
    save_flight_as(flight, path)
    return load_flight(path, rate=50.0)


def check_deflections(drafted: Drafted, flight: Flight, flown: Flight, tolerance: float) -> None:
    """Drafts take another full throw than the log was made with: deflections are in proportion to the truth."""
    controls = drafted.vehicle.file.controls
    assert set(controls) == {"elevator", "aileron", "rudder"}
    for name, control in controls.items():
        centers = {n: q.value for n, q in control.center.items()}
        mix = control.mix or {}
        x = sum(q.value * (flight.column(n) - centers.get(n, 0.0)) for n, q in mix.items())
        truth = flown.column(name) * 0.35 / FULL
        size = min(x.size, truth.size)
        assert np.abs(x[:size] - truth[:size]).max() < tolerance, name


def commands_of(flown: Flight) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normalized moments: nose up, right wing down, nose right."""
    signs = {"elevator": -1.0, "aileron": 1.0, "rudder": -1.0}
    up, roll, right = (sign * flown.column(name) / FULL for name, sign in signs.items())
    return up, roll, right


def test_px4_vtail(flown: Flight, tmp_path: Path) -> None:
    up, roll, right = commands_of(flown)
    servos = {"servo_1": -roll, "servo_2": roll, "servo_3": up + right, "servo_4": up - right}
    parameters = {"CA_AIRFRAME": 1, "CA_SV_CS_COUNT": 4}
    shares = ((1, -0.5, 0.0, 0.0), (2, 0.5, 0.0, 0.0), (7, 0.0, 0.5, 0.5), (8, 0.0, 0.5, -0.5))
    for i, (kind, *moments) in enumerate(shares):
        parameters |= {f"CA_SV_CS{i}_TYPE": kind}
        parameters |= {f"CA_SV_CS{i}_TRQ_{axis}": x for axis, x in zip("RPY", moments, strict=True)}
    flight = as_log(without_surfaces(flown, servos, parameters), tmp_path / "log.ulg")
    found = drafted(flight)
    assert found.text.count("template v-tail") == 1  # by the parameters
    check_deflections(found, flight, flown, 2e-3)
    assert not {n.code for n in found.notices} & {"draft-control-sign", "draft-surfaces", "draft-lift"}


def test_ardupilot_conventional(flown: Flight, tmp_path: Path) -> None:
    up, roll, right = commands_of(flown)
    pulses = {"pwm_1": 1480.0 + 400.0 * roll, "pwm_2": 1500.0 - 500.0 * up, "pwm_4": 1500.0 + 450.0 * right}
    pulses["pwm_6"] = 1520.0 - 400.0 * roll  # the other aileron, reversed
    outputs = {1: (4, 1080, 1480, 1880, 0), 2: (19, 1000, 1500, 2000, 1), 4: (21, 1050, 1500, 1950, 0),
               6: (4, 1120, 1520, 1920, 1)}  # fmt: skip
    parameters: dict[str, float] = {}
    for n, values in outputs.items():
        keys = ("FUNCTION", "MIN", "TRIM", "MAX", "REVERSED")
        parameters |= {f"SERVO{n}_{key}": float(v) for key, v in zip(keys, values, strict=True)}
    flight = as_log(without_surfaces(flown, pulses, parameters), tmp_path / "log.bin")
    found = drafted(flight)
    assert set(found.vehicle.file.controls["aileron"].mix or {}) == {"pwm_1", "pwm_6"}
    check_deflections(found, flight, flown, 3e-3)


def test_commands_without_parameters(flown: Flight) -> None:
    added = dict(zip(("control_pitch", "control_roll", "control_yaw"), commands_of(flown), strict=True))
    flight = without_surfaces(flown, added, {})
    found = drafted(flight)
    check_deflections(found, flight, flown, 1e-9)
    wing = {n.code for n in drafted(flight, "flying-wing").notices}
    assert "draft-rudder" in wing - {n.code for n in found.notices}
    wrong = without_surfaces(flown, {**added, "control_pitch": -added["control_pitch"]}, {})
    doubted = {n.subject for n in drafted(wrong).notices if n.code == "draft-control-sign"}
    assert "controls.elevator" in doubted


def test_slow_outputs_are_not_taken(flown: Flight) -> None:
    """Servos that were logged at 10 Hz are aliased: the moments at 50 Hz are taken, by whose name the signs are known."""
    up = -flown.column("elevator") / FULL
    parameters = {"CA_SV_CS_COUNT": 1, "CA_SV_CS0_TYPE": 3, "CA_SV_CS0_TRQ_P": 1.0}
    flight = without_surfaces(flown, {"servo_1": up, "control_pitch": up}, parameters)
    mixes = {}
    for rate in (50.0, 10.0):
        slow = replace(flight.sources["servo_1"], rate=rate)
        found = drafted(replace(flight, sources={**flight.sources, "servo_1": slow}))
        mixes[rate] = set(found.vehicle.file.controls["elevator"].mix or {})
    assert mixes == {50.0: {"servo_1"}, 10.0: {"control_pitch"}}


def test_guessed_mixers(flown: Flight) -> None:
    up, roll, right = commands_of(flown)
    flight = without_surfaces(flown, {"servo_1": roll, "servo_2": up, "servo_3": right}, {})
    found = drafted(flight, "conventional")
    controls = found.vehicle.file.controls
    for name, servo, sign in (("elevator", 2, -1), ("aileron", 1, 1), ("rudder", 3, -1)):
        assert sign * controls[name].mix[f"servo_{servo}"].value > 0.0
    assert "draft-mixers-guessed" in {n.code for n in found.notices}
    assert "GUESS" in found.text


def test_recorded_deflections(flown: Flight) -> None:
    found = drafted(flown)
    assert all(control.mix is None for control in found.vehicle.file.controls.values())
    assert found.vehicle.value("reference.airspeed") == pytest.approx(35.0, rel=0.05)
    point = trim(found.vehicle, 35.0, 200.0)
    assert abs(point.deflections["elevator"]) < 0.2
    backward = {str(n): flown.column(str(n)) for n in flown.data.data_vars}
    backward["aileron"] = -backward["aileron"]
    turned = drafted(from_columns("turned", flown.time, backward))
    assert turned.vehicle.value("Claileron") == pytest.approx(-found.vehicle.value("Claileron"))
    kept = {str(n): flown.column(str(n)) for n in flown.data.data_vars if n != "elevator"}
    vehicle = drafted(from_columns("still", flown.time, kept)).vehicle
    terms = [t for group in vehicle.terms.values() for t in group.values()]
    assert "elevator" not in {*vehicle.controls, *terms}
    assert vehicle.terms["CD"]["CDbeta2"] == "beta^2"


def test_a_mass_that_is_wrong_by_far(flown: Flight) -> None:
    for factor, said in ((0.25, {"draft-lift-unusual"}), (1.0, set()), (3.0, {"draft-lift"})):
        found = draft(Request("conventional", MASS * factor, SPAN, CHORD), [flown]).notices
        assert {"draft-lift", "draft-lift-unusual"} & {n.code for n in found} == said, factor


@pytest.mark.parametrize("template", TEMPLATES)
def test_templates_without_a_log(template: str) -> None:
    """Every template makes a file that loads. Moments of inertia are free where rotors lift: thrust by the weight shows them."""
    wings = template not in ("quad", "hexa", "octo")
    found = draft(Request(template, 3.0, 1.8 if wings else 0.6, 0.25 if wings else None, engine="electric"))
    assert 45 <= len(found.text.splitlines()) <= 135
    assert max(map(len, found.text.splitlines())) <= 170
    moments = [p for p in found.vehicle.parameters if p.name.startswith("mass.inertia") and p.prior]
    lift = template in ("quad", "hexa", "octo", "quadplane")
    expected = {"xx": lift, "yy": lift, "zz": lift} | ({"xz": True} if wings else {})
    assert {p.name[-2:]: p.free for p in moments} == expected


def test_the_propeller_of_a_piston_engine_has_angular_momentum() -> None:
    """That of a 75 in metal propeller, 2.3 kg m2 (JSBSim's prop_75in2f), lies within three standard deviations."""
    found = draft(Request("conventional", 550.0, 10.7, 1.6, engine="piston")).vehicle
    (inertia,) = (p for p in found.parameters if p.name == "propulsion.inertia")
    scaled = 2.264 * (found.value("propulsion.diameter") / 1.905) ** 5
    assert inertia.free
    assert abs(inertia.value - scaled) < 3.0 * inertia.prior
    electric = draft(Request("conventional", 550.0, 10.7, 1.6, engine="electric"))
    assert "propulsion.inertia" not in electric.vehicle.rows
    assert "# no angular momentum: its direction is not known" in electric.text


def test_what_is_missing_is_said_with_its_usual_size() -> None:
    usual = "--mass .*usual: .* kg for this span.*--chord .*usual: .* m for this span"
    blimp = Request("blimp", 1.0, 1.0, 0.2), "choose one of"
    for request, says in (
        (Request("conventional", span=2.0), usual),
        (Request(mass=2.0), "--template"),
        blimp,
    ):
        with pytest.raises(VehicleError, match=says):
            draft(request)


def test_published_inertias_scatter_as_the_prior_says() -> None:
    drafts = [(one, of_airplane(one.template, one.mass, one.span, one.chord)) for one in PUBLISHED.values()]
    for axis in ("xx", "yy", "zz"):
        factors = np.log([getattr(one, axis) / found[axis].value for one, found in drafts])
        assert np.abs(factors).max() < 3.0 * SPREAD
        assert abs(np.mean(factors)) < 0.2
        assert 0.7 * SPREAD < np.sqrt(np.mean(factors**2)) < 1.1 * SPREAD


def test_inertias_of_multirotors() -> None:
    for name in ("quad-x", "hexa-x", "octo-x"):
        vehicle = builtin_vehicle(name)
        places = [tuple(vehicle.value(f"rotor.{r}.position.{a}") for a in "xyz") for r in vehicle.rotors]
        found = of_multirotor(vehicle.value("mass.mass"), places)  # type: ignore[arg-type]
        for axis in ("xx", "yy", "zz"):
            assert abs(found[axis].value - vehicle.value(f"mass.inertia.{axis}")) < 2.0 * found[axis].std


#: mass, arm, m, speed, rad/s, and command at hover; T2, inflow and drag over the speed, torque over thrust, m, and lag, s:
#: AscTec's Hummingbird (Svacha et al. 2017), Crazyflie Brushless (Grafe et al. 2026), PX4's simulator, Crazyflie (RotorPy)
QUADROTORS = {
    "hummingbird": (0.5, 0.17, 469.0, 0.313, (5.57e-6, 2.32e-4, 1.19e-4, 0.0244, 0.005)),
    "brushless": (0.044, 0.043, 1632.0, 0.526, (4.052e-8, 1.19e-5, 5.09e-6, 0.0192, 0.05)),
    "sihsim": (1.0, 0.2404, 700.4, 0.7, (5e-6, 0.0, 0.0, 0.02, 0.05)),
    "crazyflie": (0.03, 0.043, 1789.0, 0.7155, (2.3e-8, 7.55e-7, 1.03e-6, 0.0339, 0.072)),
}  # fmt: skip


def test_published_quadrotors_are_within_what_a_draft_leaves_open() -> None:
    names = ("T2", "inflow", "drag", "torque_ratio", "lag")
    for (name, published), kind in itertools.product(QUADROTORS.items(), ("rotor", "motor")):
        mass, arm, speed, level, known = published
        at, full = (speed, 1.0) if kind == "rotor" else (level, speed / level)
        side = arm * 0.5**0.5
        places = [(x * side, y * side, 0.0) for x, y in ((1, 1), (-1, -1), (1, -1), (-1, 1))]
        rotors = tuple(Rotor(f"{kind}_{i}", p, "ccw") for i, p in enumerate(places, 1))
        powers = {"T2": full**2, "inflow": full, "drag": full}
        true = {"T1": 0.0} | {n: x * powers.get(n, 1.0) for n, x in zip(names, known, strict=True)}
        found = thrust_law(Lift(rotors, Scale(), "", True), mass, at)
        for number in true.keys() & found.keys():
            assert abs(found[number].value - true[number]) < 3.5 * found[number].std, (name, kind, number)

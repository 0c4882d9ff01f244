"""Drafts of vehicles with rotors: positions and turning by the parameters, thrust by the level of hover."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.base.units import STANDARD_GRAVITY
from stoop.errors import VehicleError
from stoop.flight import Flight, load_flight
from stoop.flight.flight import from_columns
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_draft.vehicle_draft.draft import draft
from stoop_draft.vehicle_draft.request import Request
from stoop_plan.flight_logs import save_flight_as

LEVEL = 0.55  #: command at hover


def hovering(count: int, seconds: float = 60.0, rate: float = 50.0) -> Flight:
    """Return a vehicle that hovers, its motors moved apart from each other at random."""
    time = np.arange(0.0, seconds, 1.0 / rate)
    rng = np.random.default_rng(count)
    motions = ("p", "q", "r", "phi", "theta", "psi", "ax", "ay")
    columns = {name: rng.normal(0.0, 0.02, time.size) for name in motions}
    columns["az"] = rng.normal(-STANDARD_GRAVITY, 0.1, time.size)
    columns |= {name: np.zeros(time.size) for name in ("vn", "ve", "vd", "pn", "pe")}
    columns["pd"] = np.full(time.size, -10.0)
    columns |= {f"motor_{n}": LEVEL + rng.normal(0.0, 0.02, time.size) for n in range(1, count + 1)}
    return from_columns("hover", time, columns)


def px4_parameters(vehicle: Vehicle) -> dict[str, float]:
    found: dict[str, float] = {"CA_AIRFRAME": 0, "CA_ROTOR_COUNT": len(vehicle.rotors)}
    for i, (name, rotor) in enumerate(vehicle.file.rotor.items()):
        for axis in "xyz":
            found[f"CA_ROTOR{i}_P{axis.upper()}"] = vehicle.value(f"rotor.{name}.position.{axis}")
        found[f"CA_ROTOR{i}_KM"] = 0.05 if rotor.spin == "ccw" else -0.05
    return found


def check_places(found: Vehicle, truth: Vehicle, names: Mapping[str, str], **near: float) -> None:
    """Check that rotors stand and turn as those of the truth, whose channels have the names that `names` holds."""

    def places(vehicle: Vehicle) -> dict[str, tuple[float, ...]]:
        places = {n: tuple(vehicle.value(f"rotor.{n}.position.{a}") for a in "xy") for n in vehicle.rotors}
        return {r.channel: places[n] for n, r in vehicle.file.rotor.items()}

    known = {names.get(channel, channel): place for channel, place in places(truth).items()}
    assert places(found) == {channel: pytest.approx(place, **near) for channel, place in known.items()}
    spins = [{r.channel: r.spin for r in v.file.rotor.values()} for v in (found, truth)]
    assert spins[0] == {names.get(channel, channel): spin for channel, spin in spins[1].items()}


@pytest.mark.parametrize("name", ["quad-x", "octo-x"])
def test_px4_log(name: str, tmp_path: Path) -> None:
    truth = builtin_vehicle(name)
    flight = replace(hovering(len(truth.rotors)), parameters=px4_parameters(truth))
    save_flight_as(flight, tmp_path / "log.ulg")
    mass = truth.value("mass.mass")
    # neither template nor span is needed
    found = draft(Request(mass=mass), [load_flight(tmp_path / "log.ulg")])
    check_places(found.vehicle, truth, {}, abs=1e-3)
    t1, t2 = (found.vehicle.value(f"rotors.{n}") for n in ("T1", "T2"))
    lift = len(truth.rotors) * (t1 * LEVEL + t2 * LEVEL**2)
    assert lift == pytest.approx(mass * STANDARD_GRAVITY, rel=0.02)
    assert not {n.code for n in found.notices} - {"draft-not-excited"}


def test_ardupilot_log(tmp_path: Path) -> None:
    order = {1: 5, 2: 2, 3: 1, 4: 3}  # motor -> output
    flight = hovering(4)
    columns = {str(n): flight.column(str(n)) for n in flight.data.data_vars}
    commands = {n: columns.pop(f"motor_{n}") for n in order}
    columns |= {f"pwm_{pin}": 1100.0 + 800.0 * commands[n] for n, pin in order.items()}
    parameters = {f"SERVO{pin}_FUNCTION": 32.0 + n for n, pin in order.items()}
    parameters |= {"SERVO1_FUNCTION": 35.0, "FRAME_CLASS": 1, "FRAME_TYPE": 1}
    parameters |= {"MOT_PWM_MIN": 1100, "MOT_PWM_MAX": 1900}
    log = replace(from_columns("log", flight.time, columns), parameters=parameters)
    save_flight_as(log, tmp_path / "log.bin")
    found = draft(Request(mass=1.5, span=0.5), [load_flight(tmp_path / "log.bin")])
    names = {f"motor_{n}": f"pwm_{pin}" for n, pin in order.items()}
    check_places(found.vehicle, builtin_vehicle("quad-x"), names, abs=2e-3)
    assert found.vehicle.value("rotors.idle") == 1100.0
    assert found.vehicle.value("rotors.gain") == pytest.approx(1.0 / 800.0)


def test_a_template_with_other_rotors() -> None:
    """Six motors run: a quad is refused as a template, with what runs; a hexa is what the log shows."""
    flight = hovering(6)
    found = {n.code: n.values for n in draft(Request("quad", 2.4, 0.55), [flight]).notices}["draft-motors"]
    assert (found["expected"], found["count"]) == (4, 6)
    with pytest.raises(VehicleError, match=r"has 8 rotors, but 6 motors run"):
        draft(Request("octo", 2.4, 0.55), [flight])
    assert "template hexa" in draft(Request(None, 2.4, 0.55), [flight]).text
    winged = draft(Request("conventional", 2.4, 1.5, 0.2), [flight])
    assert "draft-hovers" in {n.code for n in winged.notices}
    both = draft(Request("hexa", 2.4, 0.55), [flight, hovering(4)]).notices
    counts = [n.values["count"] for n in both if n.code == "draft-motors"]
    assert counts == [4], "the second is of another vehicle"


def test_a_mass_that_the_frame_cannot_have() -> None:
    unusual, disc = {"draft-mass-unusual", "draft-disc-loading"}, {"draft-disc-loading"}
    for mass, codes in ((0.3, disc), (0.5, unusual), (1.5, set()), (4.5, unusual), (12.0, disc)):
        found = unusual & {n.code for n in draft(Request("quad", mass, 0.5)).notices}
        assert bool(found & codes) == bool(found) == bool(codes), mass


NAMES = [
    "CA_AIRFRAME", "CA_ROTOR_COUNT", "CA_ROTOR0_PX", "CA_ROTOR0_PY", "CA_ROTOR1_PZ", "CA_ROTOR0_KM", "CA_SV_CS_COUNT",
    "CA_SV_CS0_TYPE", "CA_SV_CS0_TRQ_P", "SERVO1_FUNCTION", "SERVO2_FUNCTION", "SERVO1_MIN", "SERVO1_MAX", "FRAME_CLASS",
    "FRAME_TYPE", "PWM_MAIN_FUNC1", "PWM_MAIN_REV",
]  # fmt: skip


@settings(max_examples=20)
@given(parameters=st.dictionaries(st.sampled_from(NAMES), st.floats(width=32) | st.integers(-5, 300)))
def test_hostile_parameters(parameters: dict[str, float]) -> None:
    flight = replace(hovering(4, 20.0), parameters=parameters)
    for template in ("quad", "conventional"):
        with suppress(VehicleError):
            found = draft(Request(template, 1.5, 0.5, 0.1 if template == "conventional" else None), [flight])
            assert all(np.isfinite(p.value) for p in found.vehicle.parameters)


def test_quadplane() -> None:
    found = draft(Request("quadplane", 5.0, 2.1, 0.26))
    check_places(found.vehicle, builtin_vehicle("quadplane"), {}, rel=0.05)
    assert found.vehicle.file.propulsion is not None
    assert found.vehicle.file.propulsion.channel == "motor_5"  # type: ignore[union-attr]


def test_the_height_of_rotors_in_one_plane_is_a_guess_that_a_fit_estimates() -> None:
    flight = hovering(4)
    vehicle = draft(Request("quad", 1.5, 0.5), [flight]).vehicle
    (one,) = (p for p in vehicle.free_parameters if p.name.startswith("rotor") and ".position" in p.name)
    assert one.prior == pytest.approx(0.05)  # a tenth of the frame
    other = vehicle.with_numbers({one.name: {"value": 0.01}})
    assert {other.value(f"rotor.{name}.position.z") for name in other.rotors} == {0.01}
    # what an autopilot gives for each rotor is known
    parameters = px4_parameters(builtin_vehicle("quad-x")) | {"CA_ROTOR1_PZ": 0.04}
    known = draft(Request(mass=1.5), [replace(flight, parameters=parameters)]).vehicle
    assert not [p for p in known.free_parameters if p.name.startswith("rotor.")]
    assert known.value("rotor.m2.position.z") == 0.04


def test_what_was_not_recorded_has_no_place_and_no_density_of_its_own() -> None:
    flight = hovering(4)
    columns = {str(n): flight.column(str(n)) for n in flight.data.data_vars}
    low = {n: x for n, x in columns.items() if n not in ("ax", "ay", "az")}
    high = columns | {"altitude": 500.0 + 0.0 * flight.time}
    flights = ([from_columns("log", flight.time, c)] for c in (columns, low, high))
    seen, lacking, at_height, nothing = (draft(Request("quad", 1.5, 0.5), some) for some in (*flights, []))
    for one, there in ((seen, True), (lacking, False), (nothing, True)):
        assert ("accelerometer_position" in one.text) == there
    assert seen.vehicle.value("environment.density") == pytest.approx(1.224)  # 10 m above the origin
    # the standard atmosphere (US, 1976) at 5 km
    alps = from_columns("alps", flight.time, columns | {"pd": -5000.0 + 0.0 * flight.time})
    of_alps = draft(Request("quad", 1.5, 0.5), [alps]).vehicle
    assert of_alps.value("environment.density") == pytest.approx(0.7364, abs=5e-4)
    for one in (at_height, nothing):
        assert one.vehicle.file.environment.density == "standard"

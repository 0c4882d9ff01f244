from typing import Any

import numpy as np
import pytest

from stoop.vehicle import Vehicle
from stoop_studies.verify import jsbsim_flight as flight
from stoop_studies.verify.jsbsim import derivatives, inertia, moment_at_reference, vehicle_of
from stoop_studies.verify.jsbsim_flight import FLEET, Aircraft, Recording, State, fly, trimmed

CESSNA = FLEET[0]
TUMBLING = State(V=48.0, altitude=1500.0, alpha=0.05, beta=0.05, phi=0.2, theta=0.1, p=0.5, q=0.2, r=0.3)
TURNING = {f"{a}_dot": (f"accelerations/{a}dot-rad_sec2", 1.0) for a in "pqr"}


@pytest.fixture(scope="module")
def cessna() -> Aircraft:
    jsbsim = Aircraft(CESSNA)
    jsbsim.put(TUMBLING, {"elevator": 0.05, "aileron": 0.1, "rudder": -0.1})
    return jsbsim


def test_inertia_is_the_one_that_jsbsim_turns_by(cessna: Aircraft) -> None:
    i = inertia(cessna)
    xy, xz, yz = (-i[a] for a in ("xy", "xz", "yz"))
    tensor = np.array([[i["xx"], xy, xz], [xy, i["yy"], yz], [xz, yz, i["zz"]]])
    rates = cessna.read([f"velocities/{a}i-rad_sec" for a in "pqr"])
    turning = cessna.read([f"accelerations/{a}idot-rad_sec2" for a in "pqr"])
    moment = cessna.read([f"moments/{a}-total-lbsft" for a in "lmn"]) * 1.3558179483314004
    assert tensor @ turning + np.cross(rates, tensor @ rates) == pytest.approx(moment, abs=1e-8)
    assert np.abs([xy, xz, yz]).min() > 1.0, "all three signs count"


def test_moment_at_the_reference_point_is_the_sum_of_the_tables(cessna: Aircraft) -> None:
    axes = ("Clb Clp Clr ClDa Cldr", "Cmo Cmalpha Cmq Cmadot Cmde Cmdf", "Cnb Cnp Cnr Cnda Cndr")
    sums = [sum(cessna[f"aero/coefficient/{name}"] for name in names.split()) for names in axes]
    assert moment_at_reference(cessna) == pytest.approx(sums, rel=1e-9)


def test_truth_is_what_the_tables_say() -> None:
    """Constants in the aircraft's file; the moment due to the rate of the angle of attack adds to that of pitching."""
    _, _, found = short_case()
    constants = {
        "CQbeta": -0.1370 / 0.3490, "CQrudder": 0.187, "Clp": -0.484, "Claileron": 0.229, "Clrudder": 0.0147,
        "Cnbeta": 0.0205 / 0.3490, "Cnp": -0.0278, "Cnr": -0.0937, "Cnaileron": -0.0053, "CDbetaabs": 0.17,
    }  # fmt: skip
    assert {n: found[n] for n in constants} == pytest.approx(constants, rel=1e-3)
    assert found["Cmq"] == pytest.approx(-12.4 - 7.27, rel=0.02)
    assert found["CLq"] == pytest.approx(3.9 + 1.7, rel=0.02)


def test_equations_agree_at_the_states_flown() -> None:
    """No fit: with JSBSim's derivatives our equations give JSBSim's accelerations and readings at its own states."""
    vehicle, flown, truth = short_case()
    known = flown.columns
    vehicle = vehicle.with_numbers({n: {"value": v} for n, v in truth.items()})
    rows = vehicle.parameter_rows({}, len(flown.time))
    inputs = np.ascontiguousarray([known[c] for c in vehicle.inputs])
    states = {c: known[c] for c in ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi")}
    start = vehicle.initial_states({**states, "h": known["altitude"]}, rows, inputs)
    rates, readings = vehicle.kernel().evaluate(rows, start, inputs)
    ours = dict(zip(vehicle.outputs, readings, strict=True))
    ours |= {f"{a}_dot": rates[vehicle.states.index(a)] for a in "pqr"}
    for name in (*TURNING, "ax", "ay", "az"):
        assert np.sqrt(np.mean((ours[name] - known[name]) ** 2)) < 0.01 * np.std(known[name]), name


def brief(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(flight, "DURATION", 6.0)
    patch.setattr(flight, "READ", {**flight.READ, **TURNING})


def short_case() -> tuple[Vehicle, Recording, dict[str, float]]:
    jsbsim = Aircraft(CESSNA)
    trim = trimmed(jsbsim)
    jsbsim.put(trim.state, trim.deflections)
    vehicle = vehicle_of(jsbsim, trim)
    with pytest.MonkeyPatch.context() as patch:
        brief(patch)
        flown = fly(jsbsim, trim)
    return vehicle, flown, derivatives(jsbsim, trim, vehicle, flown)


def test_flights_are_the_same_again(monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    brief(monkeypatch)
    first, second = (fly(one, trimmed(one)) for one in (Aircraft(CESSNA), Aircraft(CESSNA)))
    assert all(np.array_equal(first.columns[c], second.columns[c]) for c in first.columns)
    assert "".join(capfd.readouterr()) == "", "JSBSim greets on stdout unless it is told not to"

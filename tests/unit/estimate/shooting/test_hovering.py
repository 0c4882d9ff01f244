"""A quadrotor, flown by its autopilot: short windows and accelerations find it, and a log that tells nothing is said so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from unit.estimate.fits import fit_by
from unit.flown import maneuver

from stoop.checks.excitation import in_ratio, ratios
from stoop.checks.rotors import foreign_motors, rotor_notices
from stoop.errors import FlightError, IdentificationError
from stoop.estimate import multiple_shooting
from stoop.estimate.fit import Options, estimation_problem
from stoop.flight import from_columns
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow import identify

WINDOW = [Window("sim", 0.0, 16.0)]
WIND = (2.0, -1.0, 0.0)
INPUTS = (
    ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("north", "doublet", 6.0, 2.0, 2.5), ("east", "doublet", 8.0, 2.0, 2.5),
    ("down", "doublet", 9.5, 2.0, 1.0), ("roll", "doublet", 13.0, 0.15, -8.0), ("pitch", "doublet", 14.0, 0.15, -8.0),
)  # fmt: skip
WRONG = {
    "rotors.T1": 0.8, "rotors.T2": 1.2, "rotors.inflow": 1.3, "rotors.drag": 0.7, "rotors.torque_ratio": 1.25,
    "rotors.lag": 1.3,
}  # fmt: skip


@pytest.fixture(scope="module")
def quad():
    text = resolve_vehicle("quad-x").text.replace("lag = ", "delay = 0.012\nlag = ", 1)
    return parse_vehicle(text.replace("# front left\n", "# front left\nfactor = 0.85\n", 1), "quad.toml")


@pytest.fixture(scope="module")
def flight(quad):
    return simulate_flight(quad, maneuver(16.0, *INPUTS, rate=100.0, wind=WIND), seed=1, name="sim")


@pytest.fixture(scope="module")
def start(quad):
    wrong = {n: {"value": quad.value(n) * f, "free": True} for n, f in WRONG.items()}
    more = {"rotors.delay": {"value": 0.02, "free": True}, "rotor.m3.factor": {"value": 1.0, "free": True}}
    return quad.with_numbers({**wrong, **more})


@pytest.fixture(scope="module")
def job(start, flight):
    return identify(start, flight, ["0:11"], validate=["11.5:16"])


def test_windows_are_the_default_and_find_the_truth(quad, job):
    result = job.result
    assert (result.method, result.status) == ("multiple-shooting", "converged")
    off = [(p.estimate - quad.value(n)) / p.std_error for n, p in result.parameters.items()]
    assert np.abs(off).max() < 3.5
    assert result.parameters["rotor.m3.factor"].estimate == pytest.approx(0.85, abs=0.01)
    assert result.parameters["rotors.delay"].estimate == pytest.approx(0.012, abs=1e-3)
    for channel, blown in zip(("vn", "ve", "vd"), WIND, strict=True):
        bias = result.biases[0].values[channel]
        assert abs(bias.estimate - blown) < 4.0 * bias.std_error
    # what was not fitted is predicted window by window
    predicted = result.maneuvers[1].channels
    assert max(predicted[channel].theil for channel in ("p", "q", "r", "az")) < 0.3
    assert predicted["az"].theil < predicted["az"].baseline_theil
    assert "predicted-in-windows" in [n.code for n in result.data_notices]
    assert "multiple-shooting-rotors" in [n.code for n in result.basis]


def test_accelerations_alone_come_close(quad, start, flight):
    """They are taken where motors were logged slowly."""
    sources = {name: replace(s, rate=43.0) if "motor" in name else s for name, s in flight.sources.items()}
    result = identify(start, replace(flight, sources=sources), ["0:16"]).result
    assert result.method == "equation-error"
    assert [n.values["rate"] for n in result.basis if n.code == "motors-logged-slowly"] == [43.0]
    for name in ("rotors.T2", "rotors.torque_ratio", "rotors.drag", "rotor.m3.factor", "rotors.delay"):
        assert result.parameters[name].estimate == pytest.approx(quad.value(name), rel=0.1), name
    with pytest.raises(IdentificationError, match="equation-error or multiple-shooting"):
        fit_by("frequency-domain", start, {"sim": flight}, WINDOW)


def test_a_hopeless_start_is_searched_for(start, flight, monkeypatch, resumed):
    """Without the regression's start, and with thrust and torque far off, the optimizer takes over; it may be interrupted."""
    monkeypatch.setattr(
        multiple_shooting, "starts",
        lambda problem, _: problem.layout.unit(np.array([p.value for p in problem.layout.parameters]))[None],
    )  # fmt: skip
    groups = ("rotors.", "rotor.", "body_drag.")
    numbers = {p.name: {"free": False} for p in start.parameters if p.free and p.name.startswith(groups)}
    right = {n: start.value(n) / f for n, f in WRONG.items()}
    right |= {"rotors.delay": 0.012, "rotor.m3.factor": 0.85}
    numbers |= {n: {"value": v, "free": False} for n, v in right.items()}
    for name, far, bounds in (("rotors.T2", 0.7, (0.1, 20.0)), ("rotors.T1", 0.5, (0.0, 10.0))):
        numbers[name] = {"value": far, "free": True, "bounds": bounds}
    args = (start.with_numbers(numbers), {"sim": flight}, [Window("sim", 0.0, 8.0)], Options(budget=900.0))
    fit = resumed(multiple_shooting.fit, *args)
    assert fit.outcome.optimizer == "ps-gde-lm"
    assert fit.estimates["rotors.T2"] == pytest.approx(6.0, rel=0.02)
    assert "global-start" in [n.code for n in fit.notices]


def test_without_mass_and_inertia_ratios_are_told(quad, flight):
    free = {n: {"free": True} for n in ("mass.mass", *(f"mass.inertia.{a}" for a in ("xx", "yy", "zz")))}
    unknown = quad.with_numbers({**free, "mass.mass": {"value": 3.0, "free": True}})
    problem, _ = estimation_problem(unknown, {"sim": flight}, WINDOW, Options())
    names = {p.name for p in problem.layout.parameters}
    assert names & {"mass.mass", "mass.inertia.xx"} == {"mass.inertia.xx"}
    assert "rotors.T2 4 +/- 0.1 N/kg" in ratios(problem.layout.vehicle, {"rotors.T2": (12.0, 0.3)})
    text = quad.text.replace("[rotors]", "[rotors]\ndrag_inflow = { value = 0.001, free = %s }", 1)
    told, held = (parse_vehicle(text % word, "quad").with_numbers(free) for word in ("true", "false"))
    assert "rotors.drag_inflow" in {p.name for p in in_ratio(told)}
    weighed = unknown.with_numbers({"mass.mass": {"value": 1.5, "prior": 0.1}})
    known = quad.with_numbers({"mass.mass": {"free": True}})
    for vehicle in (held, weighed, known):  # a force that is known tells the mass, and so does inertia
        assert not in_ratio(vehicle)


def changed(flight, **columns):
    kept = {str(n): flight.column(str(n)) for n in flight.data.data_vars}
    return replace(from_columns("sim", flight.time, {**kept, **columns}, ()), sources=flight.sources)


def noticed(start, flight, **columns):
    return rotor_notices(estimation_problem(start, {"sim": changed(flight, **columns)}, WINDOW, Options())[0])


def test_motors_off_and_rates_that_lack_are_no_flight(start, flight):
    off = {f"motor_{i}": np.where(flight.time < 12.0, 0.01 * i, 0.6 + 0.01 * i) for i in range(1, 5)}
    blank = dict.fromkeys("pqr", np.full(len(flight.time), np.nan))
    for columns, advice in (
        (blank, r"none of the rates p, q, r was recorded.*\[variables\]"),
        (off, r"motors are off in 75% .*rotors\.idle"),
    ):
        with pytest.raises(IdentificationError, match=advice):
            estimation_problem(start, {"sim": changed(flight, **columns)}, WINDOW, Options())
    partly = {n: np.where(flight.time < 3.0, 0.0, flight.column(n)) for n in off}
    (one,) = (one for one in noticed(start, flight, **partly) if one.code == "motors-off")
    assert one.values["first"] == pytest.approx(3.0, abs=0.02)


def test_saturation_and_stillness_are_said(start, flight):
    full = np.where(flight.time < 4.0, 1.0, flight.column("motor_2"))
    (one,) = (one for one in noticed(start, flight, motor_2=full) if one.code == "command-saturated")
    assert (one.subject, one.values["end"]) == ("motor_2", "upper")
    assert one.values["share"] == pytest.approx(0.25, abs=0.005)
    rng = np.random.default_rng(0)
    still = {f"motor_{i}": 0.6 + 1e-4 * rng.standard_normal(len(flight.time)) for i in range(1, 5)}
    still |= {c: 0.01 * rng.standard_normal(len(flight.time)) for c in "pqr"}
    codes = [one.code for one in noticed(start, flight, **still)]
    assert codes.count("axis-not-excited") == 3
    assert "lift-not-excited" in codes


def test_the_log_of_another_vehicle_is_recognized(start, flight):
    hexa, more = resolve_vehicle("hexa-x"), ("motor_5", "motor_6")
    constant = changed(flight, **dict.fromkeys(more, np.zeros(len(flight.time))))
    for given, advice in (
        (flight, r"input .motor_5., .motor_6. is not in this flight.*\[rotor\.m5\]"),
        (constant, r"motor_5, motor_6 never change.*\[rotor\.m5\], \[rotor\.m6\]"),
    ):
        with pytest.raises((FlightError, IdentificationError), match=advice):
            estimation_problem(hexa, {"sim": given}, WINDOW, Options())
    (one,) = foreign_motors(start, changed(flight, **dict.fromkeys(more, flight.column("motor_1"))), WINDOW)
    assert (one.code, one.values["channels"]) == ("foreign-motors", more)


@pytest.mark.parametrize(("name", "wrong"), [("mass.mass", 1.2), ("mass.inertia.xx", 1.5)])
def test_a_wrong_mass_or_inertia_is_named_and_its_value_comes_out(name, wrong):
    """Thrust takes up the error silently: thrust nearly independent of the command, and much more drag."""
    vehicle = resolve_vehicle("quad-x")
    calm = simulate_flight(vehicle, maneuver(16.0, *INPUTS, rate=100.0, wind=WIND), seed=1, name="sim")
    off = vehicle.with_numbers({name: {"value": wrong * vehicle.value(name)}})
    given = identify(off, calm, ["0:11"], validate=["11.5:16"]).result
    assert given.extensions.found[0].name == name
    assert name == "mass.inertia.xx" or given.verdict.grade == "do not use"
    longer = identify(off, calm, ["0:11"], validate=["11.5:16"], extend=True).result
    assert longer.parameters[name].estimate == pytest.approx(vehicle.value(name), rel=0.01)
    assert longer.verdict.grade == "usable"

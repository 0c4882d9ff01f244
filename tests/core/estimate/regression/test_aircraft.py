"""Equations of aircraft and rotors: coefficients that were flown, and a simulated fall whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fits import posed
from helpers.flown import with_few_free

from stoop import Flight, Vehicle, load_vehicle
from stoop.base.rotations import matrices_of_angles
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.estimate.regression.aircraft import History, Motion, balance
from stoop.estimate.regression.least_squares import Estimates, TimeDomain
from stoop.estimate.regression.rotors import MOMENTS, RotorEquations
from stoop.flight.flight import from_columns
from stoop.vehicle import parse_vehicle
from stoop.vehicle.delays import first_order_lag
from stoop.vehicle.document import with_entries


def of(vehicle: Vehicle, flight: Flight) -> History:
    problem = posed(vehicle, flight)
    (found,) = (h for piece in problem.pieces for h in History.of(problem.layout.vehicle, piece))
    return found


def by_hand(vehicle: Vehicle, flight: Flight) -> dict[str, np.ndarray]:
    """Return the coefficients that eq. (1) gives for what was flown."""
    k = vehicle.value
    V, b, c = k("reference.airspeed"), k("reference.span"), k("reference.chord")
    a, beta = flight.column("alpha") - k("reference.alpha"), flight.column("beta")
    p, q, r = (flight.column(n) * s / (2.0 * V) for n, s in (("p", b), ("q", c), ("r", b)))
    dV = flight.column("V") / V - 1.0
    de, da, dr = (flight.column(n) for n in ("elevator", "aileron", "rudder"))
    return {
        "CL": k("CL0") + k("CLalpha") * a + k("CLq") * q + k("CLV") * dV + k("CLelevator") * de,
        "CD": k("CD0") + k("CDalpha") * a + k("CDalpha2") * a**2 + k("CDV") * dV,
        "CQ": k("CQ0") + k("CQbeta") * beta + k("CQp") * p + k("CQr") * r + k("CQrudder") * dr + k("CQV") * dV,
        "Cl": k("Cl0") + k("Clbeta") * beta + k("Clp") * p + k("Clr") * r + k("Claileron") * da + k("Clrudder") * dr,
        "Cm": k("Cm0") + k("Cmalpha") * a + k("Cmq") * q + k("CmV") * dV + k("Cmelevator") * de,
        "Cn": k("Cn0") + k("Cnbeta") * beta + k("Cnp") * p + k("Cnr") * r + k("Cnaileron") * da + k("Cnrudder") * dr,
    }  # fmt: skip


def test_the_coefficients_are_those_that_were_flown(full: Vehicle, clean: Flight) -> None:
    """Against eq. (1) written out; rates are differentiated, so moments are as exact as a spline."""
    wanted = by_hand(full, clean)
    for coefficient, flown in of(full, clean).coefficients.items():
        tolerance = 1e-5 if coefficient in ("CL", "CD", "CQ") else 2e-3
        error = np.abs(flown - wanted[coefficient])[50:-50].max()
        assert error < tolerance * np.ptp(wanted[coefficient]), coefficient


def test_instruments_are_undone_and_terms_of_the_file_do_not_count(full: Vehicle, noisy: Flight) -> None:
    """A turned inertial unit and biases; a coefficient without a constant; the three of a lateral vehicle."""
    angles, biases = (0.05, -0.04, 0.3), {"alpha": 0.02, "az": 0.5, "q": 0.01}
    aligned = with_entries(full, {("sensors", "imu_alignment"): list(angles)})
    crooked = full.with_numbers({f"sensors.{c}.bias": {"value": b} for c, b in biases.items()})
    off = replace(noisy, data=noisy.data.assign({c: noisy.data[c] + b for c, b in biases.items()}))
    fewer = full.text.replace("CL0 = 0.385", "CL0 = false").replace("Cmq = -47.6", "Cmq = false")
    thrust = {"propulsion.thrust": {"value": full.value("propulsion.thrust")}}
    bare, plain = parse_vehicle(fewer, "bare").with_numbers(thrust), of(full, noisy)
    groups = [np.column_stack([noisy.column(c) for c in axes]) for axes in (RATES, SPECIFIC_FORCE)]
    read = np.hstack([x @ matrices_of_angles(np.array(angles)) for x in groups]).T
    named = {c: ("time", x) for c, x in zip((*RATES, *SPECIFIC_FORCE), read, strict=True)}
    turned = replace(noisy, data=noisy.data.assign(named))
    for vehicle, flight in ((aligned, turned), (crooked, off), (bare, noisy)):
        found = of(vehicle, flight)
        for coefficient, flown in plain.coefficients.items():
            np.testing.assert_allclose(found.coefficients[coefficient], flown, rtol=1e-8, atol=1e-9)
    assert tuple(of(full.reduced("lateral"), noisy).coefficients) == ("CQ", "Cl", "Cn")


def test_terms_are_the_ones_that_the_kernel_flies(full: Vehicle, noisy: Flight) -> None:
    """A regressor is what the coefficient's accelerations change by for a unit of its parameter."""
    history, kernel, found = of(full, noisy), full.kernel(), Motion.of(full, posed(full, noisy).pieces[0])
    shifted = {"CLq": 3.0, "Clp": 0.7, "Cnrudder": -0.2, "CDalpha2": 1.5}
    x, rows = found.kernel_states(full), found.rows.copy()
    for name, delta in shifted.items():
        rows[full.rows[name]] += delta
    before, after = (kernel.evaluate(r, x, found.inputs) for r in (found.rows, rows))
    _, gains = balance(full, found)
    told = np.zeros((6, len(history.time)))
    for name, delta in shifted.items():
        place = ("CL", "CD", "CQ", "Cl", "Cm", "Cn").index(name[:2])
        told += gains[:, place] * delta * history.regressor(full.terms[name[:2]][name])
    turning = [full.states.index(c) for c in "pqr"]
    felt = [full.outputs.index(c) for c in ("ax", "ay", "az")]
    moved = np.concatenate([(after[0] - before[0])[turning], (after[1] - before[1])[felt]])
    np.testing.assert_allclose(told, moved, rtol=0.0, atol=1e-9 * np.abs(moved).max())


def test_a_lag_answers_a_ramp_as_its_formula_says() -> None:
    t, lag = 0.02 * np.arange(200), 0.1
    np.testing.assert_allclose(first_order_lag(t, lag, 0.02), t - lag * (1.0 - np.exp(-t / lag)), atol=1e-12)


DT, TRUTH = 0.01, {"rotors.T2": 7.0, "rotors.inflow": 0.3, "rotors.drag": 0.1}
WOBBLE = 0.06  #: rad/s, of the gyros' noise


def flown(vehicle: Vehicle, mixed: bool, truth: dict[str, float], **noise: np.ndarray) -> Flight:
    """Return seconds of a quadrotor under commands that swing; mixed hides which of its motors was which."""
    t = DT * np.arange(400)
    common = 0.12 * np.sin(6.0 * t) + 0.06 * np.sin(17.0 * t)
    own = 0.006 * np.sin(np.outer(t, [19.0, 23.0, 29.0, 31.0]))
    own -= own.mean(axis=1, keepdims=True)
    inputs = np.zeros((len(t), len(vehicle.inputs)))
    motors = [vehicle.inputs.index(vehicle.file.rotor[name].channel) for name in vehicle.rotors]
    inputs[:, motors] = 0.6 + common[:, None] + own
    rows = vehicle.parameter_rows(truth)
    start = vehicle.initial_states({"u": 3.0, "v": -1.0, "w": 0.5, "h": 50.0}, rows, inputs[0])
    out, told = vehicle.kernel().trajectories(rows, start, inputs, DT)[0], inputs.copy()
    if mixed:
        told[:, motors] -= 2.0 * own  # what the log holds turns the vehicle the other way
    columns = dict(zip(vehicle.outputs, out.T, strict=True))
    columns |= {name: columns[name] + x for name, x in noise.items()}
    recorded = {c: told[:, i] for i, c in enumerate(vehicle.inputs) if c.startswith("motor")}
    return from_columns("quad", t, columns | recorded | {"altitude": np.full(len(t), 50.0)})


def regressed(mixed: bool) -> tuple[dict[str, float], Estimates]:
    vehicle = load_vehicle("quad-x")
    return solved_for(vehicle, flown(vehicle, mixed, TRUTH), tuple(TRUTH))


def solved_for(vehicle: Vehicle, flight: Flight, free: tuple[str, ...]) -> tuple[dict[str, float], Estimates]:
    """Fit some numbers and hold the others."""
    problem = posed(with_few_free(vehicle, free), flight, 3.99)
    solved = RotorEquations.of(problem.layout, problem.pieces).estimate(TimeDomain(), bounded=True)
    assert solved is not None
    return {p.name: v for p, v in zip(problem.layout.parameters, solved.values, strict=False)}, solved


def test_the_truth_comes_back() -> None:
    values, solved = regressed(mixed=False)
    assert values == {name: pytest.approx(value, rel=0.02) for name, value in TRUTH.items()}
    assert set(MOMENTS) <= solved.r2.keys()


def test_gyros_and_accelerometers_are_enough() -> None:
    """Thrust, lag and inertia of a vehicle without drag, from a log that holds neither velocity nor attitude."""
    truth = {"rotors.T2": 7.0, "rotors.lag": 0.06, "mass.inertia.xx": 0.02, "mass.inertia.yy": 0.03}
    vehicle, none = load_vehicle("quad-x"), ("rotors.inflow", "rotors.drag", "body_drag.")
    still = {p.name: {"value": 0.0} for p in vehicle.parameters if p.name.startswith(none)}
    vehicle = vehicle.with_numbers({**still, **{n: {"free": True} for n in truth}})
    noise = {c: 0.01 * np.random.default_rng(i).standard_normal(400) for i, c in enumerate(("ax", "ay"))}
    whole = flown(vehicle, False, truth, **noise)  # without drag they would read zero, as a dead sensor does
    sensed = replace(whole, data=whole.data.drop_vars(["vn", "ve", "vd", "phi", "theta", "psi"]))
    values, solved = solved_for(vehicle, sensed, tuple(truth))
    assert values == {name: pytest.approx(value, rel=0.02) for name, value in truth.items()}
    assert {"roll", "pitch", "vertical"} <= solved.r2.keys()


def test_moments_that_no_command_explains_are_left_out() -> None:
    """They would only teach how little the commands do; the forces tell the numbers without them."""
    values, solved = regressed(mixed=True)
    assert not {"roll", "yaw"} & solved.r2.keys()
    assert values == {name: pytest.approx(value, rel=0.1) for name, value in TRUTH.items()}


def test_a_turned_inertial_unit_with_scale_errors_is_in_the_equations() -> None:
    """At the truth the accelerations of the equations are those that the instruments tell."""
    text = load_vehicle("quad-x").text + (
        "\n[sensors]\nimu_alignment = [0.05, -0.04, 0.3]\naccelerometer_position = [0.05, 0.0, -0.02]\n"
        "p = { scale = 1.1 }\nr = { scale = 0.9 }\naz = { scale = 1.05 }\n"
    )
    vehicle = parse_vehicle(text, "turned")
    problem = posed(vehicle, flown(vehicle, False, {}), 3.99)
    (stretch,) = RotorEquations.of(problem.layout, problem.pieces).stretches
    inside = slice(20, -20)
    error = (stretch.measured - stretch.modeled(vehicle, vehicle.parameter_rows({})))[inside]
    assert np.all(np.abs(error).max(axis=0) < 0.02 * np.ptp(stretch.measured[inside], axis=0))

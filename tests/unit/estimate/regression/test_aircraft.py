"""Coefficient histories: those that were flown, whatever the file says of the terms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from unit.estimate.regression.conftest import posed

from stoop.estimate.regression.aircraft import History, Motion, balance, histories
from stoop.flight import Flight
from stoop.simulation.delays import first_order_lag
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.load import parse_vehicle
from stoop_studies.verify.defects import turned


def of(vehicle: Vehicle, flight: Flight) -> History:
    problem = posed(vehicle, flight)
    (found,) = (h for piece in problem.pieces for h in histories(problem.layout.vehicle, piece))
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
    bare = parse_vehicle(fewer, "bare").with_numbers(thrust)
    plain = of(full, noisy)
    for vehicle, flight in ((aligned, turned(*angles)(noisy)), (crooked, off), (bare, noisy)):
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

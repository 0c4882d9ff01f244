"""Two stages: known truth comes back within its intervals where noise of a vane misleads equation error."""

from __future__ import annotations

import numpy as np
import pytest
from unit.estimate.fits import deviations, fit_by
from unit.flown import maneuver, with_few_free

from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.estimate.regression.aircraft import Motion
from stoop.estimate.two_stage import reconstructed
from stoop.flight import Flight
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle

COEFFICIENTS = ("CL0", "CLalpha", "Cm0", "Cmalpha", "Cmq", "Cmelevator")
WINDOW = Window("sim", 0.0, 10.0)
FLIGHTS = 10
INPUTS = ("elevator", "3-2-1-1", 0.5, 0.4, 0.05), ("elevator", "doublet", 5.0, 0.6, 0.04)
MANEUVER = maneuver(10.0, *INPUTS, noise={"alpha": 0.015})
BIASES = """
[sensors.q]
bias = { value = 0.0, free = true, prior = 0.01 }
[sensors.az]
bias = { value = 0.0, free = true, prior = 0.1 }
"""
TRUTH = {"sensors.q.bias": 0.008, "sensors.az.bias": 0.1}


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    full = parse_vehicle(resolve_vehicle("twin-boom").text + BIASES, "biased").reduced("longitudinal")
    return with_few_free(full, (*COEFFICIENTS, "CD0", *TRUTH))


def flown(vehicle: Vehicle, seed: int) -> Flight:
    true = vehicle.with_numbers({name: {"value": x} for name, x in TRUTH.items()})
    return simulate_flight(true, MANEUVER, seed=seed, name="sim")


def errors(method: str, vehicle: Vehicle) -> tuple[FloatArray, FloatArray]:
    """Return the errors (flights, k) of the coefficients over their size, and over their standard errors."""
    truth = {n: vehicle.value(n) for n in COEFFICIENTS}
    found = [fit_by(method, vehicle, {"sim": flown(vehicle, seed)}, [WINDOW]) for seed in range(FLIGHTS)]
    shares = [[one.estimates[n] / true - 1.0 for n, true in truth.items()] for one in found]
    return np.array(shares), np.array([deviations(one, truth) for one in found])


def test_known_truth_comes_back_within_its_intervals(vehicle: Vehicle) -> None:
    """Of 60 intervals at 95 %, 50 hold the truth but for a chance of 1e-3; output error is the yardstick."""
    share, score = errors("two-stage", vehicle)
    best, _ = errors("output-error", vehicle)
    misled, refuted = errors("equation-error", vehicle)
    assert np.sum(np.abs(score) < 1.96) >= 50
    assert np.sum(np.abs(refuted) < 1.96) < 30
    rms, least, most = (np.sqrt(np.mean(x**2, axis=0)) for x in (share, best, misled))
    assert (rms < 0.1).all()
    assert (rms < 5.0 * least).all()
    assert (rms < 0.6 * most).all()


def test_states_and_biases_are_reconstructed(vehicle: Vehicle) -> None:
    """Against the flight without noise: the vane's noise of 0.015 rad is filtered to a tenth."""
    silent = vehicle.with_numbers({name: {"value": 0.0} for name in TRUTH})
    true = simulate_flight(silent, MANEUVER, noise=False, name="sim")
    (piece,) = prepare(vehicle, {"sim": flown(vehicle, 1)}, [WINDOW]).pieces
    noise = {c: getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs} | {"alpha": 0.015}
    (found, converged), measured = reconstructed(vehicle, piece, noise), Motion.of(vehicle, piece)
    assert converged
    alpha = true.column("alpha")[measured.samples]
    assert np.sqrt(np.mean((measured.states["alpha"] - alpha) ** 2)) == pytest.approx(0.015, rel=0.1)
    assert np.sqrt(np.mean((found.states["alpha"] - alpha) ** 2)) < 0.0015
    bias = np.mean(measured.states["q"] - found.states["q"])
    assert bias == pytest.approx(TRUTH["sensors.q.bias"], abs=1e-3)


def test_what_two_stages_cannot_do_is_told(vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    quad, flight = resolve_vehicle("quad-x"), flown(vehicle, 1)
    with pytest.raises(IdentificationError, match="two-stage is for aircraft; use --method"):
        fit_by("two-stage", quad, {}, [WINDOW])
    for steps, told in ((None, []), (1, ["warning"])):
        if steps:
            monkeypatch.setattr("stoop.estimate.two_stage.MAX_STEPS", steps)
        found = fit_by("two-stage", vehicle, {"sim": flight}, [WINDOW]).notices
        assert [n.severity for n in found if n.code == "path-not-converged"] == told

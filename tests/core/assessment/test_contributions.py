"""What a control contributes above noise and systematic residuals, and the advice that follows from the motion flown."""

import dataclasses

import numpy as np
import pytest

from stoop import Flight, Options, Vehicle, load_vehicle, simulate_flight
from stoop.assessment.coloring import ColoredNoise
from stoop.assessment.contributions import Contribution, contribution_notices, contributions
from stoop.assessment.covariance import data_information
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import fit
from stoop.problem.evidence import Evidence, PieceEvidence, Unknown
from stoop.problem.windows import Window
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.schema import Turbulence
from stoop.workflow.demo import MANEUVER

NAMES = ("CLelevator", "Cmelevator", "Cmalpha", "Cmq")
SLOW = 0.98  #: of an autoregression
COLORED = ColoredNoise(np.full((12, 1), SLOW), (1.0 - SLOW**2) * np.eye(12))


def evidence(jacobian: FloatArray, estimates: FloatArray, white: bool = False) -> Evidence:
    sizes = zip(NAMES, estimates.tolist(), strict=False)
    unknowns = tuple(Unknown(name, "parameter", x, abs(x)) for name, x in sizes)
    piece = PieceEvidence(np.zeros(jacobian.shape[:2]), jacobian)
    return Evidence(unknowns, (piece,), np.zeros((len(unknowns),) * 2), white=white)


def judged(data: Evidence, noise: ColoredNoise) -> Contribution:
    found = contributions(load_vehicle("twin-boom"), data, data_information(data.pieces), noise)
    return next(one for one in found if one.variable == "elevator")


def test_in_white_noise_it_is_the_square_root_of_wald_s_statistic() -> None:
    rng, estimates = np.random.default_rng(1), np.array([0.3, -1.0, -0.5, -9.0])
    data = evidence(rng.standard_normal((300, 12, 4)) @ rng.standard_normal((4, 4)), estimates)
    covariance = np.linalg.inv(data_information(data.pieces))[:2, :2]
    wald = float(estimates[:2] @ np.linalg.solve(covariance, estimates[:2]))
    found = judged(data, ColoredNoise.white(12))
    assert (found.noise, found.systematic) == (pytest.approx(wald**-0.5), 0.0)
    assert found.parameters == ("CLelevator", "Cmelevator")


def test_a_sine_is_compared_with_the_residuals_of_its_frequency() -> None:
    count, cycles = 4000, 40
    jacobian = np.zeros((count, 12, 1))
    jacobian[:, 4, 0] = np.sin(2.0 * np.pi * cycles * np.arange(count) / count)
    found, w = judged(evidence(jacobian, np.array([0.2])), COLORED), 2.0 * np.pi * cycles / count
    density, floor = ((1.0 - SLOW**2) / (1.0 + SLOW**2 - 2.0 * SLOW * np.cos(x)) for x in (w, np.pi))
    expected = np.sqrt(2.0 * (density - floor) / (0.2**2 * count / 2.0))
    assert (found.column, found.systematic) == (4, pytest.approx(expected, rel=0.05))


def test_fourier_coefficients_are_independent() -> None:
    rng = np.random.default_rng(2)
    found = judged(evidence(rng.standard_normal((50, 12, 2)), np.array([0.1, 0.2]), True), COLORED)
    assert found.systematic == 0.0


def flown(vehicle: Vehicle, amplitude: float, gusts: float) -> Flight:
    """Return a flight with elevator inputs of a share of the usual, through gusts of so many m/s."""
    if gusts:
        gust = {"intensity": {"value": gusts}, "length": 200.0}
        blown = {"turbulence": Turbulence.model_validate({"u": gust, "w": gust})}
        vehicle = dataclasses.replace(vehicle, file=vehicle.file.model_copy(update=blown))
    maneuver = parse_maneuver(MANEUVER, "test")
    inputs = [i.model_copy(update={"amplitude": amplitude * i.amplitude}) for i in maneuver.input]
    return simulate_flight(vehicle, maneuver.model_copy(update={"input": inputs}), seed=3, name="sim")


@pytest.mark.parametrize(("amplitude", "gusts"), [(1.0, 0.0), (0.02, 0.0), (1.0, 0.2), (0.1, 1.0)])
def test_small_deflections_are_doubted_only_where_residuals_could_fake_them(
    aircraft: Vehicle, wrong: Vehicle, amplitude: float, gusts: float
) -> None:
    flight, doubted = flown(aircraft, amplitude, gusts), gusts == 1.0
    found = fit(wrong, {"sim": flight}, [Window("sim", 0.0, 30.0)], Options())
    bars = ErrorBars.of(found)
    names = {n for told in contribution_notices(found, bars.contributions) for n in told.values["parameters"]}
    assert ("Cmelevator" in names) == doubted
    if amplitude < 1.0:
        assert (np.std(flight.column("elevator")) > np.radians(0.2)) == doubted, "the angle does not decide"
    off = abs(found.estimates["Cmelevator"] / aircraft.value("Cmelevator") - 1.0)
    assert (off > 0.5) == doubted, "what is doubted is wrong"

"""Responses of residuals to extensions, against differences of the residuals of a vehicle that has the extension."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.fits import posed
from helpers.flown import maneuver

from stoop import Vehicle, load_vehicle, simulate_flight
from stoop.base.arrays import FloatArray
from stoop.estimate.filter_gains import Noise, Steady, Varying, first_guess
from stoop.estimate.filter_likelihood import FrozenFilter, Likelihood
from stoop.estimate.fitted_filter import with_gusts
from stoop.estimate.linearization import undelayed
from stoop.estimate.multiple_shooting import LinearizedNodes
from stoop.estimate.refit_problem import RefitProblem
from stoop.estimate.response import Responses
from stoop.estimate.shooting_problem import ShootingProblem
from stoop.problem import Misfit
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.document import with_entries

GUSTS = """
[turbulence]
u = { intensity = { value = 0.5, free = true, bounds = [0.05, 6.0] }, length = 200.0 }
w = { intensity = { value = 0.5, free = true, bounds = [0.05, 6.0] }, length = 100.0 }
"""
ROTORS = maneuver(
    4.0, ("roll", "doublet", 0.4, 0.15, 8.0), ("heave", "doublet", 1.2, 0.25, 2.0), ("north", "doublet", 2.0, 0.7, 2.0),
    rate=100.0,
)  # fmt: skip


def problem_of(vehicle: Vehicle, flown: Maneuver, noise: bool = True) -> Misfit:
    return posed(vehicle, simulate_flight(vehicle, flown, seed=3, noise=noise, name="sim"))


def difference(local: RefitProblem, z: FloatArray, found: Responses, name: str) -> list[FloatArray]:
    """Return the response (N,) of one piece, and the difference of all residuals."""
    layout = local.problem.layout
    j, one = next((j, e) for j, e in enumerate(found.extensions) if e.name == name)
    vehicle = with_entries(layout.vehicle, one.entries(one.value(one.step)))
    extended = replace(replace(layout, vehicle=vehicle), parameters=layout.parameters)
    other = replace(local, problem=replace(local.problem, layout=extended))
    wanted = (other.residuals(z[None], 0) - local.residuals(z[None], 0))[0] / one.step
    return [np.concatenate([part[:, :, j].ravel() for part in [found.pieces[0], *found.gaps[:1]]]), wanted]


def error(found: FloatArray, wanted: FloatArray) -> float:
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


@pytest.mark.parametrize("gain", [Steady(), Varying()])
def test_innovations_respond_as_the_frozen_filter_does(gain: Steady | Varying) -> None:
    vehicle = parse_vehicle(load_vehicle("twin-boom").text + GUSTS, "gusty").reduced("longitudinal")
    problem = with_gusts(problem_of(vehicle, maneuver(6.0, ("elevator", "3-2-1-1", 1.0, 0.3, 0.06))))
    holes = problem.pieces[0].measured.copy()
    holes[100:140, 1] = np.nan
    problem = replace(problem, pieces=(replace(problem.pieces[0], measured=holes),))
    noise, shifted = Noise(vehicle, first_guess(vehicle, problem.pieces)), undelayed(problem)
    z = np.concatenate([problem.layout.start, np.zeros(problem.extra)])
    whole = np.concatenate([z, noise.start])
    local = FrozenFilter.of(Likelihood.of(shifted, noise, gain, whole), whole)
    found = local.responses(z)
    for name in ("controls.elevator.delay", "Cmalphaq", "sensors.q.scale"):  # each vehicle is compiled
        own, wanted = difference(local, z, found, name)
        assert error(own, wanted[: own.size]) < 0.05


def test_windows_respond_as_their_own_simulation_does() -> None:
    """About the optimum of a flight without noise; states are eliminated by a dense projection: the naive twin."""
    free = "lag = { value = 0.05, free = true, bounds = [0.01, 0.2] }"
    text = load_vehicle("quad-x").text.replace("lag = 0.05", free)
    problem = problem_of(parse_vehicle(text, "quad"), ROTORS, noise=False)
    shooting = replace(ShootingProblem.of(problem, 1.0), strictness=1.0)
    z = np.concatenate([problem.layout.start, np.zeros(problem.extra)])
    local = LinearizedNodes.of(shooting, shooting.iterate(z, [s.measured_nodes() for s in shooting.shots]))
    found, base = local.responses(z), local.residuals(z[None], 0)[0]
    shots, columns = local.shots[0], []
    for w in range(1, shots.count):
        for e in range(len(local.gap_weights)):
            step = np.zeros((len(local.gap_weights), shots.count))
            step[e, w] = 1e-5
            moved = replace(local, nodes=(shots.perturbed(local.nodes[0], step),))
            columns.append((moved.residuals(z[None], 0)[0] - base) / 1e-5)
    count = found.pieces[0][:, :, 0].size + found.gaps[0][:, :, 0].size
    by_state = np.linalg.qr(np.stack(columns, axis=1)[:count])[0]
    for name in ("mass.mass", "rotors.delay", "sensors.attitude.delay", "body_drag.linear.x"):
        own, wanted = difference(local, z, found, name)
        wanted = wanted[:count] - by_state @ (by_state.T @ wanted[:count])
        assert error(own, wanted) < 0.05

"""The quadrotor's noisy flights once more, by multiple shooting as `stoop identify` does: states are estimated too."""

from __future__ import annotations

import functools

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Options
from stoop.estimate.shooting.method import MultipleShooting
from stoop.problem.windows import Window
from stoop.simulate import parse_maneuver
from stoop.simulate.fly import simulate_flight
from stoop_studies.problems.multirotor import quad
from stoop_studies.problems.quad import LENGTH, MANEUVER, NOISE

NAME = "quadrotor"


@functools.cache
def shot(seed: int, box: str) -> dict[str, float]:
    """Return what is found of the flight whose noise has this seed, and whose box (its center is the start) too."""
    case = quad()
    noise = "\n".join(["[noise]", *(f"{c} = {s}" for c, s in NOISE.items())])
    flight = simulate_flight(case.vehicle, parse_maneuver(f"{MANEUVER}\n{noise}\n", NAME), seed, name=NAME)
    window = Window(NAME, 0.0, float(flight.time[-1]))
    known = Options(seed=seed, covariance=np.diag(case.sigma**2))
    return MultipleShooting(LENGTH)(case.boxed(box, seed), {NAME: flight}, [window], known).estimates


def shots(seeds: range, box: str, parameters: tuple[str, ...]) -> FloatArray:
    """Return what is found (n, D) of the flights of several seeds."""
    found = [shot(seed, box) for seed in seeds]
    return np.array([[one[name] for name in parameters] for one in found])

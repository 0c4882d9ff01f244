"""A quadrotor, simulated: ``multirotor`` and ``multirotor+noise``, ten numbers of the built-in quad-x.

Thrust, torque, inflow, drag, lag and the three inertias are found again from twelve seconds under the autopilot, the
mass known. The paper's optimizers search the same box, budget and cost (`stoop_studies.problems.short`).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.problem import Misfit, Piece, Weights
from stoop.simulate import initial_states, parameter_rows, parse_maneuver
from stoop.simulate.fly import Flown, fly
from stoop.simulate.initial import commanded
from stoop.simulate.paths import readings_along, states_flown
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.problems import Posed, take_none
from stoop_studies.problems.paper import box, of_known_truth
from stoop_studies.problems.quad import LENGTH, MANEUVER, NOISE, SOUGHT
from stoop_studies.problems.short import posed, windows

NAMES: Final = ("multirotor", "multirotor+noise")


@dataclass(frozen=True, eq=False)
class Quad:
    """The vehicle, its flight, and the truth that no instrument tells.

    Attributes
    ----------
    vehicle : Vehicle
        Its values are the truth.
    flown : Flown
    readings : (n, 12)
        What its sensors would read without noise when the recorded commands are flown again: one source, to rounding.
    beside : mapping
        What else is known at every sample (n,), exactly: ``NAME.lag``, by how much each rotor is off its command, as
        controllers that report the speed of their motor tell; the altitude ``h``, m, on which the density depends.
    """

    vehicle: Vehicle
    flown: Flown
    readings: FloatArray
    beside: dict[str, FloatArray]

    @property
    def truth(self) -> FloatArray:
        """The numbers sought, (D,), SI, in the order of `SOUGHT`."""
        return np.array([self.vehicle.value(n) for n in SOUGHT])

    def boxed(self, kind: str, seed: int) -> Vehicle:
        """Return the vehicle with the numbers sought free in a box, at its center; everything else is known."""
        low, high = box(kind, seed, self.truth)
        known = {p.name: {"free": False} for p in self.vehicle.parameters if p.free}
        bounds = {
            n: {"free": True, "bounds": (a, b), "value": (a + b) / 2.0}
            for n, a, b in zip(SOUGHT, low.tolist(), high.tolist(), strict=True)
        }
        return self.vehicle.with_numbers(known | bounds)

    def measured(self, seed: int, noise: bool) -> FloatArray:
        """Return readings (n, 12)."""
        draw = np.random.default_rng(seed).standard_normal(self.readings.shape)
        return np.asarray(self.readings + float(noise) * self.sigma * draw)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation (12,) of the noise; its inverse square is Q, with noise and without."""
        return np.array([NOISE[c] for c in self.vehicle.outputs])

    def problem(self, kind: str, seed: int, noise: bool) -> Misfit:
        """Pose the least-squares problem; the seed draws box and noise."""
        vehicle, flown = self.boxed(kind, seed), self.flown
        whole = Piece(0, flown.time, flown.inputs, self.measured(seed, noise), {})
        return posed(vehicle, windows(vehicle, whole, LENGTH, self.beside), Weights.of(self.sigma**2))


@functools.cache
def quad() -> Quad:
    """Return the quadrotor and its flight; made once in a process."""
    vehicle = resolve_vehicle("quad-x")
    flown = fly(vehicle, parse_maneuver(MANEUVER, "quadrotor"))
    rows = parameter_rows(vehicle, flown.trim.changes)
    start = initial_states(vehicle, flown.trim.start, rows, flown.inputs[0])
    step = float(flown.time[1] - flown.time[0])
    states = states_flown(vehicle, rows, start, flown.inputs, step, np.random.default_rng(0))
    every = np.repeat(rows, len(flown.inputs), axis=1)
    x = dict(zip(vehicle.states, states.T, strict=True))
    off = {f"{r}.lag": x[f"{r}.lag"] - commanded(vehicle, r, every, flown.inputs.T) for r in vehicle.rotors}
    return Quad(vehicle, flown, readings_along(vehicle, rows, states, flown.inputs), {"h": x["h"], **off})


def names() -> tuple[str, ...]:
    """Return the names of these problems."""
    return NAMES


def pose(name: str, seed: int, box: str = "N", **arguments: object) -> Posed:
    """Pose one of these problems; the seed draws box and noise.

    Parameters
    ----------
    name : str
    seed : int
    box : str
        N, S or W.

    Raises
    ------
    IdentificationError
        Another argument than ``box``, or another box.
    """
    take_none(name, arguments)
    case, noise = quad(), name.endswith("+noise")
    return of_known_truth(case.vehicle, case.problem(box, seed, noise), noise)

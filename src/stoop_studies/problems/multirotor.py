"""Rotorcraft over short windows: ``multirotor`` and ``multirotor+noise``, ten numbers of a simulated quad-x.

Open loop a vehicle on rotors diverges from any longer record, with the right numbers as with wrong ones: a simulation
from the first sample says nothing after a second or two. Over a part of a second every candidate stays near enough
to be compared, so the cost J = (Z - Y)' Q (Z - Y) of twelve channels is summed over windows, each of which begins in
the state that was measured there. Nothing but the numbers sought is unknown; optimizers without nuisances search the
same problem as those with.

Thrust, torque, inflow, drag, lag and the three inertias of the quadrotor are found again from twelve seconds under
the autopilot, the mass known.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.linearization import interpolated, unwrapped
from stoop.estimate.shooting_windows import edges
from stoop.problem import Layout, Misfit, Piece, Weights
from stoop.problem.observation import through_air
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import parse_maneuver
from stoop.simulation.trim import Flown
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.delays import first_order_lag
from stoop_studies.problems import Posed, data_text, take_none
from stoop_studies.problems.paper import box, freed, of_known_truth

NAMES: Final = ("multirotor", "multirotor+noise")
SOUGHT: Final = (
    "rotors.T1", "rotors.T2", "rotors.torque_ratio", "rotors.inflow", "rotors.drag", "rotors.lag",
    "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz", "body_drag.quadratic.x",
)  # fmt: skip
"""What is sought; the truths stand in the file of quad-x. The mass is known, without it only ratios show."""

LENGTH: Final = 0.5  #: s, of a window

NOISE: Final = {
    "vn": 0.3, "ve": 0.3, "vd": 0.3, "p": 0.005, "q": 0.005, "r": 0.005,
    "phi": 0.005, "theta": 0.005, "psi": 0.005, "ax": 0.05, "ay": 0.05, "az": 0.10,
}  # fmt: skip
"""Standard deviation of each channel, m/s, rad/s, rad, m/s2: that of the paper's problem, its airspeed's for velocity."""

MANEUVER: Final = data_text("quad_maneuver.toml")
"""From hover: 3-2-1-1 of angular acceleration about each axis (rad/s2), of climb (m/s2), then velocities (m/s)."""


def windows(vehicle: Vehicle, piece: Piece, length: float, beside: Mapping[str, FloatArray]) -> list[Piece]:
    """Return the windows, `length` s each, of a piece of a rotorcraft's flight without wind.

    `beside` is what is known of the state at every sample (n,) beside the readings: ``NAME.lag``, by how much each rotor is
    off its command, in units of x; the altitude ``h``, m.
    """
    read = {c: interpolated(unwrapped(piece.measured[:, i])) for i, c in enumerate(vehicle.outputs)}
    state = through_air({n: read[n] for n in ("vn", "ve", "vd", "phi", "theta", "psi")})
    state |= {n: read[n] for n in ("p", "q", "r")} | dict(beside)
    cuts = edges(len(piece.time), max(2, round(length / piece.dt)))
    begins = ({**piece.start, **{n: float(values[a]) for n, values in state.items()}} for a in cuts[:-1])
    return [piece.part(a, b, start) for (a, b), start in zip(pairwise(cuts), begins, strict=True)]


def windowed(vehicle: Vehicle, pieces: Sequence[Piece], weights: Weights) -> Misfit:
    """Return the problem: every free number of the vehicle is sought, biases of sensors among them."""
    sought = tuple(p for p in vehicle.parameters if p.free)
    return Misfit(Layout(vehicle, sought, ()), tuple(pieces), weights, (tuple(len(p.time) for p in pieces),))


def motors_behind(vehicle: Vehicle, piece: Piece) -> dict[str, FloatArray]:
    """Return by how much rotors are off their commands (n,), with the lag of the vehicle's file: none is measured."""
    rows = vehicle.parameter_rows(piece.changes)
    every, lag = np.repeat(rows, len(piece.inputs), axis=1), vehicle.value("rotors.lag")
    asked = {r: vehicle.commanded(r, every, piece.inputs.T) for r in vehicle.rotors}
    return {f"{r}.lag": first_order_lag(x, lag, piece.dt) - x for r, x in asked.items()}


@dataclass(frozen=True, eq=False)
class Quad:
    """The vehicle, its flight, and what is known exactly beside the readings."""

    vehicle: Vehicle  #: its values are the truth
    flown: Flown
    #: (n, 12), what its sensors would read without noise when the recorded commands are flown again: one source, to rounding
    readings: FloatArray
    #: (n,) each, also known exactly: ``NAME.lag``, by how much each rotor is off its command, as controllers that report the
    #: speed of their motor tell; the altitude ``h``, m, on which the density depends
    beside: dict[str, FloatArray]

    @property
    def truth(self) -> FloatArray:
        """The numbers sought, (D,), SI, in the order of `SOUGHT`."""
        return np.array([self.vehicle.value(n) for n in SOUGHT])

    def boxed(self, kind: str, seed: int) -> Vehicle:
        """Return the vehicle with the numbers sought free in a box, at its center; everything else is known."""
        return freed(self.vehicle, SOUGHT, *box(kind, seed, self.truth))

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
        return windowed(vehicle, windows(vehicle, whole, LENGTH, self.beside), Weights.of(self.sigma**2))


@functools.cache
def quad() -> Quad:
    """Return the quadrotor and its flight; made once in a process."""
    vehicle = load_vehicle("quad-x")
    flown = fly(vehicle, parse_maneuver(MANEUVER, "quadrotor"))
    rows = vehicle.parameter_rows(flown.trim.changes)
    start = vehicle.initial_states(flown.trim.start, rows, flown.inputs[0])
    step = float(flown.time[1] - flown.time[0])
    states = vehicle.states_along(rows, start, vehicle.late_inputs(flown.inputs, rows, step), step)
    every = np.repeat(rows, len(flown.inputs), axis=1)
    x = dict(zip(vehicle.states, states.T, strict=True))
    off = {f"{r}.lag": x[f"{r}.lag"] - vehicle.commanded(r, every, flown.inputs.T) for r in vehicle.rotors}
    return Quad(vehicle, flown, vehicle.readings_along(rows, states, flown.inputs), {"h": x["h"], **off})


def pose(name: str, seed: int, box: str = "N", **arguments: object) -> Posed:
    """Return one of these problems; the seed draws noise and box, of kind N, S or W."""
    take_none(name, arguments)
    case, noise = quad(), name.endswith("+noise")
    return of_known_truth(case.vehicle, case.problem(box, seed, noise), noise)

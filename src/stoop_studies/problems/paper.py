"""The paper's problems: ten coefficients of Table 1, and all longitudinal and all lateral terms of its eq. (1).

``paper-N``, ``paper-S``, ``paper-W``: six channels, 1500 samples, the elevator of Fig. 3; each also ``+noise``,
``+few`` (V, q and theta only), ``+few+noise``. ``longitudinal-full`` has 14 terms; ``lateral`` flies rudder and
aileron on all six degrees of freedom and finds 18 terms from twelve channels, the longitudinal ones known; each also
``+noise``.

Three boxes, as the paper prints no bounds; the truth lies somewhere in each, drawn with the seed, never on purpose
in its middle. No starting values, priors or equation-error estimate.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.optimize.ledger import Evaluations
from stoop.problem import Layout, Misfit, Piece, Weights
from stoop.problem.layout import Nuisance
from stoop.problem.misfit import horizon_ladder
from stoop.simulation.fly import fly
from stoop.simulation.maneuver import parse_maneuver
from stoop.simulation.trim import Flown
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.workflow.demo import MANEUVER, TABLE_1
from stoop_studies.problems import Posed, data_text, take_none

SAMPLES: Final = 1500  #: of the record that is fitted: 30 s at 50 Hz

NOISE: Final = {
    "V": 0.3, "alpha": 0.005, "beta": 0.005, "p": 0.005, "q": 0.005, "r": 0.005,
    "phi": 0.005, "theta": 0.005, "psi": 0.005, "ax": 0.05, "ay": 0.05, "az": 0.10,
}  # fmt: skip
"""Standard deviation of each channel, m/s, rad, rad/s, m/s2; Q is its inverse square (not printed)."""

LEFT_OUT: Final = {"CLV": 0.05, "CDV": 0.02, "CDalpha2": 1.2, "CmV": 0.03}
"""Longitudinal terms of eq. (1) that Table 1 leaves out, with truths of our own, none of them zero."""

LONGITUDINAL: Final = (*TABLE_1, *LEFT_OUT)

LATERAL: Final = (
    "CQ0", "CQbeta", "CQp", "CQr", "CQrudder", "CQV", "Cl0", "Clbeta", "Clp", "Clr", "Claileron", "Clrudder",
    "Cn0", "Cnbeta", "Cnp", "Cnr", "Cnaileron", "Cnrudder",
)  # fmt: skip
"""The lateral and directional terms of eq. (1); their truths, ours, stand in the vehicle file."""

BOXES: Final = ("N", "S", "W")
NAMES: Final = (
    *(f"paper-{kind}{more}" for kind in BOXES for more in ("", "+noise", "+few", "+few+noise")),
    *(f"{name}{more}" for name in ("longitudinal-full", "lateral") for more in ("", "+noise")),
)
FEW: Final = ("V", "q", "theta")
NEAR: Final = 1e-6  #: of J0 without noise; of the maximum-likelihood cost with it


def sigma_of(channels: Iterable[str]) -> FloatArray:
    """Return the noise's standard deviation (n_y,) of channels, SI."""
    return np.array([NOISE[c] for c in channels])


SIGMA: Final = sigma_of(("V", "alpha", "q", "theta", "ax", "az"))  #: of the longitudinal channels; SI


@dataclass(frozen=True)
class Paper:
    """A vehicle whose values are the truth, what its sensors would read without noise, and the numbers that are to be found."""

    vehicle: Vehicle
    flown: Flown
    names: tuple[str, ...] = TABLE_1

    @property
    def truth(self) -> FloatArray:
        """The free numbers, (D,), SI."""
        return np.array([self.vehicle.value(n) for n in self.names])

    def bounded(self, low: FloatArray, high: FloatArray, nuisances: Sequence[Nuisance] = ()) -> Layout:
        """Return the search vector with these bounds, (D,) each, SI; the names in the vehicle's order."""
        return Layout.of(freed(self.vehicle, self.names, low, high), nuisances)

    def problem(self, kind: str, seed: int, noise: bool, channels: Iterable[str] | None = None) -> Misfit:
        """Pose the least-squares problem of one box, N, S or W; the seed draws box and noise, `channels` are measured."""
        layout = self.bounded(*box(kind, seed, self.truth))
        return self.misfit(layout, self.measured(seed, noise, channels))

    def misfit(self, layout: Layout, measured: FloatArray) -> Misfit:
        """Return the cost of a search vector against readings (n, n_y)."""
        trim, n = self.flown.trim, len(measured)
        piece = Piece(0, self.flown.time[:n], self.flown.inputs[:n], measured, trim.start, trim.changes)
        weights = Weights.of(sigma_of(self.vehicle.outputs) ** 2)
        return Misfit(layout, (piece,), weights, horizon_ladder([piece]))

    def cost(self, values: FloatArray) -> FloatArray:
        """Return each channel's part (n_y,) of J, without noise, of values (D,), SI, in the order of `names`."""
        reach = np.abs(values) + np.abs(self.truth)
        problem = self.misfit(self.bounded(-reach, reach), self.measured(0, noise=False))
        ordered = dict(zip(self.names, values.tolist(), strict=True))
        z = problem.layout.unit(np.array([ordered[p.name] for p in problem.layout.parameters]))
        residuals = problem.residuals(z[None], len(problem.prices) - 1)
        return np.asarray((residuals.reshape(-1, len(self.vehicle.outputs)) ** 2).sum(axis=0))

    def measured(self, seed: int, noise: bool, channels: Iterable[str] | None = None) -> FloatArray:
        """Return readings (n, n_y), NaN in channels that are not measured."""
        readings = self.flown.outputs[:SAMPLES].copy()
        if noise:
            sigma = sigma_of(self.vehicle.outputs)
            readings += sigma * np.random.default_rng(seed).standard_normal(readings.shape)
        if channels is not None:
            readings[:, ~np.isin(self.vehicle.outputs, list(channels))] = np.nan
        return readings


def freed(vehicle: Vehicle, names: Sequence[str], low: FloatArray, high: FloatArray) -> Vehicle:
    """Return the vehicle with these numbers free in bounds, (D,) each, SI, at their center; all others are known."""
    known = {p.name: {"free": False} for p in vehicle.parameters if p.name not in names}
    bounds = zip(names, low.tolist(), high.tolist(), strict=True)
    return vehicle.with_numbers(
        known | {n: {"free": True, "bounds": (a, b), "value": (a + b) / 2.0} for n, a, b in bounds}
    )


def of_known_truth(vehicle: Vehicle, problem: Misfit, noise: bool) -> Posed:
    """Return a problem whose answer the vehicle is: near zero without noise, near the optimum at the truth with it."""
    reference = problem.reference(len(problem.prices) - 1)
    names = tuple(p.name for p in problem.layout.parameters)
    truth = np.array([vehicle.value(n) for n in names])
    return Posed(
        problem=problem,
        target=optimum(problem, vehicle) * (1.0 + NEAR) if noise else NEAR * reference,
        reference=reference,
        truth=truth,
        parameters=names,
        values=lambda x: problem.layout.physical(x[None, : problem.dimension])[0],
    )


def optimum(problem: Misfit, vehicle: Vehicle) -> float:
    """Return the cost where a refinement from the truth, the vehicle's values, ends."""
    truth = np.array([vehicle.value(p.name) for p in problem.layout.parameters])
    z = np.concatenate([problem.layout.unit(truth), np.zeros(problem.extra)])
    # stops at rounding only
    patient = optimize.Settings(iterations=200, gain=1e-14, predicted=1e-14, stall=0, stall_damping=np.inf)
    ledger = optimize.Ledger(problem, Evaluations.none(problem))
    return optimize.refine(ledger, z, len(problem.prices) - 1, patient).cost


def box(kind: str, seed: int, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return bounds: N is as wide as each value, W eight times, S begins or ends at zero (sign known).

    Raises
    ------
    IdentificationError
        There is none of that kind.
    """
    if kind not in BOXES:
        raise IdentificationError(f"box {kind}: there is none of that name; use N, S or W")
    rng, size = np.random.default_rng(10_000 + seed), np.abs(truth)
    if kind == "S":
        far = rng.uniform(2.0, 8.0, len(truth)) * truth
        return np.minimum(0.0, far), np.maximum(0.0, far)
    width = size if kind == "N" else 8.0 * size
    low = truth - rng.uniform(0.1, 0.9, len(truth)) * width
    return low, low + width


@functools.cache
def paper() -> Paper:
    """Return the paper's aircraft and its flight; made once in a process."""
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    return Paper(vehicle, fly(vehicle, parse_maneuver(MANEUVER, "paper")))


def aircraft() -> Vehicle:
    """Return the paper's aircraft with no coefficient of eq. (1) at zero."""
    return load_vehicle("twin-boom").with_numbers({n: {"value": v} for n, v in LEFT_OUT.items()})


@functools.cache
def longitudinal() -> Paper:
    """Return the 14 longitudinal terms and their flight; made once in a process."""
    vehicle = aircraft().reduced("longitudinal")
    return Paper(vehicle, fly(vehicle, parse_maneuver(MANEUVER, "longitudinal")), LONGITUDINAL)


def lateral_flight(vehicle: Vehicle) -> Flown:
    """Return a flight with rudder and aileron in turn."""
    return fly(vehicle, parse_maneuver(data_text("lateral_maneuver.toml"), "lateral"))


@functools.cache
def lateral() -> Paper:
    """Return the 18 lateral and directional terms and their flight; made once in a process."""
    vehicle = aircraft()
    return Paper(vehicle, lateral_flight(vehicle), LATERAL)


def pose(name: str, seed: int, **arguments: object) -> Posed:
    """Return a problem, such as ``paper-N+noise`` or ``lateral``; the seed draws box and noise.

    Problems that do not name their box take the argument ``box``: N (default), S or W.
    """
    kind, *more = name.split("+")
    noise = "noise" in more
    if kind.startswith("paper-"):
        take_none(name, arguments)
        case, kind = paper(), kind.removeprefix("paper-")
    else:
        case, kind = lateral() if kind == "lateral" else longitudinal(), str(arguments.pop("box", "N"))
        take_none(name, arguments)
    return of_known_truth(
        case.vehicle, case.problem(kind, seed, noise, FEW if "few" in more else None), noise
    )

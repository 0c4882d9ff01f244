"""Any recorded flight as a problem of comparison: ``flight``, with the arguments flight, vehicle and maneuvers.

The windows are prepared as `stoop identify` does: cut at dropouts, each piece with its own initial state and
sensor biases, the weights estimated once by refinements from the vehicle file's own values and then held.

There is one difference. `stoop identify` keeps initial states and biases apart from the parameters, and only
local refinement moves them. Here they are joined to the unit box, 5 prior standard deviations to either side of
where the measurements put them, so that every optimizer searches the same numbers.

What counts as solved is the least cost that a long search from the file's own values finds, and a thousandth
more. Nobody is given those values: every optimizer begins blind.
"""

from __future__ import annotations

import functools
from typing import Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import FlightError, IdentificationError
from stoop.estimate.fit import Options, estimation_problem, settle, starts
from stoop.estimate.refit_problem import Derived
from stoop.flight.load import load_several
from stoop.optimize.normal_equations import dense
from stoop.problem.windows import Window
from stoop.vehicle.builtin import load_vehicle
from stoop_studies.problems import Posed

NAMES: Final = ("flight",)
REACH: Final = 5.0  #: prior standard deviations of a nuisance that the box reaches to either side
NEAR: Final = 1e-3  #: of the reference's cost; the agreement that confirms an optimum
REFERENCE_BUDGET: Final = 50_000.0  #: trajectories of the search that finds what counts as solved
REFERENCE_SEEDS: Final = (0, 1, 2)
LEGS: Final = 2.0 * REACH  #: prior standard deviations from one end of the box to the other


class Joined(Derived):
    """A problem whose D parameters and E nuisances are searched alike, in the unit box."""

    extra = 0

    @property
    def dimension(self) -> int:
        """Number D + E of variables."""
        return self.problem.dimension + self.problem.extra

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the costs (B,) of X (B, D + E) in the unit box, priors of the nuisances included."""
        with np.errstate(invalid="ignore", over="ignore"):
            total = np.sum(self.residuals(X, rung) ** 2, axis=1)
        return np.where(np.isfinite(total), total, np.inf)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n_r) of Z (B, D + E) in the unit box."""
        return self.problem.residuals(self.split(Z), rung)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return d r / d z (n_r, D + E) and its price: initial states on their own piece, biases for nothing."""
        found, spent = self.problem.jacobian(self.split(z[None, :])[0], rung, r)
        J = dense(found)
        J[:, self.problem.dimension :] *= LEGS
        return J, spent

    def split(self, Z: FloatArray) -> FloatArray:
        """Return vectors (B, D + E) with the nuisances in prior standard deviations."""
        out = Z.copy()
        out[:, self.problem.dimension :] = LEGS * (Z[:, self.problem.dimension :] - 0.5)
        return out

    def join(self, z: FloatArray) -> FloatArray:
        """Return the point of the unit box (D + E,) of a vector with nuisances in prior standard deviations."""
        out = z.copy()
        out[self.problem.dimension :] = 0.5 + z[self.problem.dimension :] / LEGS
        return np.clip(out, 0.0, 1.0)


def pose(name: str, seed: int, **arguments: object) -> Posed:
    """Pose windows of flights; the seed is the search's alone, the problem is always the same.

    Arguments are ``flight``: path of a log, or a list of them; ``vehicle``: path, or the name of a built-in vehicle;
    ``maneuvers``: list of ``[FLIGHT@]START:STOP[#LOADING]``.

    Raises
    ------
    IdentificationError
        An argument is missing or unknown.
    StoopError
        What `stoop identify` would say to the same flight, vehicle and windows.
    """
    wrong = {"flight", "vehicle", "maneuvers"} ^ set(arguments)
    if wrong:
        said = "needs" if set(arguments) <= {"flight", "vehicle", "maneuvers"} else "knows no"
        raise IdentificationError(
            f"problem {name}: {said} {', '.join(sorted(wrong))}; give flight, vehicle and maneuvers"
        )
    return posed(_texts(arguments["flight"]), str(arguments["vehicle"]), _texts(arguments["maneuvers"]))


@functools.cache
def posed(flights: tuple[str, ...], vehicle: str, maneuvers: tuple[str, ...]) -> Posed:
    """Pose the problem; once in a process for the same words.

    What counts as solved is the least cost of searches with the nuisances apart, as `stoop identify`, which is the stronger
    treatment; only a point inside the box of the joined problem counts.

    Raises
    ------
    IdentificationError
        No search was confirmed.
    """
    loaded = load_several(flights)
    by_name = {flight.name: flight for flight in loaded}
    if len(by_name) < len(loaded):
        raise FlightError("flights: two of them have the same name; rename one of the files")
    windows = [Window.parse(text, by_name) for text in maneuvers]
    whole, _ = estimation_problem(load_vehicle(vehicle), by_name, windows, Options())
    settled = settle(whole, starts(whole))
    guesses = np.concatenate([settled.z[None, : whole.dimension], starts(whole)])
    apart, stop = settled.problem, optimize.Stop(budget=REFERENCE_BUDGET)
    ends = [
        optimize.minimize(optimize.create(), apart, seed=seed, starts=guesses, stop=stop)
        for seed in REFERENCE_SEEDS
    ]
    if not any(end.status == "converged" for end in ends):
        raise IdentificationError(
            "problem flight: no optimum was confirmed, so nothing says what counts as solved; "
            "choose other maneuvers, or free fewer numbers"
        )
    problem, layout, full = Joined(apart), apart.layout, len(apart.prices) - 1
    least = float(problem.costs(np.array([problem.join(end.z) for end in ends]), full).min())
    centers = np.array([n.center for n in layout.nuisances])
    scales = np.array([n.scale for n in layout.nuisances])

    def values(x: FloatArray) -> FloatArray:
        own = layout.physical(x[None, : layout.dimension])[0]
        return np.concatenate([own, centers + scales * LEGS * (x[layout.dimension :] - 0.5)])

    states = tuple(f"{n.name} of maneuver {n.maneuver + 1}" for n in layout.nuisances)
    return Posed(
        problem=problem,
        target=least * (1.0 + NEAR),
        reference=problem.reference(full),
        truth=None,
        parameters=(*(p.name for p in layout.parameters), *states),
        values=values,
    )


def _texts(value: object) -> tuple[str, ...]:
    return tuple(str(v) for v in value) if isinstance(value, list | tuple) else (str(value),)

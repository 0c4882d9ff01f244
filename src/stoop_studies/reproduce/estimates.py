"""Estimates of many runs, and the Cramer-Rao bound that they are compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np

from stoop import optimize
from stoop.assessment.covariance import invert, standard_errors
from stoop.base.arrays import FloatArray
from stoop.problem import Misfit
from stoop_studies.findings import number
from stoop_studies.problems import Posed

SUCCESS: Final = 1e-2  #: largest relative error of a successful identification
EXACT: Final = 1e-6  #: the same of an exact one


@dataclass(frozen=True, eq=False)
class Group:
    """The runs of one method up to one number of iterations.

    Attributes
    ----------
    method : str
    iterations : int or None
        None: to its own end.
    truth : (D,)
        Of a real flight the best values known.
    values : (n, D)
        Best of each run.
    costs : (n,)
        Fitness J of each.
    hits : (n,)
        Evaluations up to the target; inf where that was not reached.
    evaluations : (n,)
        Spent.
    """

    method: str
    iterations: int | None
    truth: FloatArray
    values: FloatArray
    costs: FloatArray
    hits: FloatArray
    evaluations: FloatArray

    @classmethod
    def of(
        cls,
        method: str,
        iterations: int | None,
        truth: FloatArray,
        results: Sequence[Mapping[str, Any]],
        order: Sequence[int] | None = None,
    ) -> Self:
        """Return results of `stoop_studies.search.search`; ``order`` picks among the values."""
        values = np.array([r["values"] for r in results], dtype=float)
        return cls(
            method,
            iterations,
            truth,
            values if order is None else values[:, list(order)],
            np.array([r["cost"] for r in results], dtype=float),
            hits_of(results),
            np.array([r["evaluations"] for r in results], dtype=float),
        )

    @property
    def errors(self) -> FloatArray:
        """Relative errors (n, D)."""
        return np.asarray(np.abs(self.values / self.truth - 1.0))

    @property
    def rms(self) -> FloatArray:
        """Root mean square (D,) of the relative errors over runs."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)))

    @property
    def mean_error(self) -> float:
        """Mean relative error over runs and parameters."""
        return float(self.errors.mean())

    @property
    def error_of_means(self) -> float:
        """Mean relative error of the mean values, as the paper's columns have it."""
        return float(np.abs(self.values.mean(axis=0) / self.truth - 1.0).mean())

    @property
    def spread(self) -> FloatArray:
        """Standard deviation (D,) of the values over runs."""
        return np.asarray(self.values.std(axis=0, ddof=min(1, len(self.values) - 1)))

    def within(self, limit: float) -> int:
        """Return how many runs have every value within a relative error."""
        return int((self.errors <= limit).all(axis=1).sum())

    @property
    def mean_of_successful(self) -> FloatArray:
        """Mean values (D,) of the successful runs; NaN where there is none."""
        successful = self.values[(self.errors <= SUCCESS).all(axis=1)]
        return successful.mean(axis=0) if len(successful) else np.full(len(self.truth), np.nan)

    @property
    def reached(self) -> int:
        """How many runs reached the target."""
        return int(np.isfinite(self.hits).sum())

    @property
    def median_hit(self) -> float:
        """Median evaluations of those; NaN where there is none."""
        reached = self.hits[np.isfinite(self.hits)]
        return float(np.median(reached)) if reached.size else np.nan

    @property
    def hits_text(self) -> str:
        """The median and how many runs reached the target; a dash where none did."""
        return "–" if not self.reached else f"{self.median_hit:.0f} ({self.reached})"


def hits_of(results: Sequence[Mapping[str, Any]]) -> FloatArray:
    """Return evaluations up to the target (n,); inf where a run did not reach it."""
    return np.array([np.inf if r.get("hit") is None else r["hit"] for r in results], dtype=float)


def percent(share: float) -> str:
    """Return a share in percent, three digits."""
    return f"{number(100.0 * share)} %"


def bound_deviations(posed: Posed, values: FloatArray | None = None) -> FloatArray:
    """Return the standard deviations (D,) of the Cramer-Rao bound in physical units.

    Residuals are in units of the noise, so their Jacobian J has the information J'J; nuisances are part of it.

    Parameters
    ----------
    posed : Posed
    values : (D,), optional
        Where the bound is taken; the problem's truth when absent.

    Raises
    ------
    ValueError
        Neither values nor truth are known: a mistake of the caller.
    """
    place = posed.truth if values is None else values
    if place is None:
        raise ValueError("the bound is taken at the truth, which this problem does not know")
    zero = posed.values(np.zeros(len(place)))
    width = posed.values(np.ones(len(place))) - zero
    return width * unit_deviations(posed.problem, np.clip((place - zero) / width, 0.0, 1.0))


def unit_deviations(problem: optimize.Problem, x: FloatArray) -> FloatArray:
    """Return the same (D,) at a point (D,) of the unit box, in its units."""
    z, full = np.concatenate([x, np.zeros(problem.extra)]), len(problem.prices) - 1
    J, _ = problem.jacobian(z, full, problem.residuals(z[None], full)[0])
    return standard_errors(invert(J.T @ J).matrix)[: problem.dimension]


def fitted(problem: Misfit, seed: int) -> dict[str, Any]:
    """Return estimates by name, cost and status of the default optimizer, run to its end."""
    outcome = optimize.minimize(optimize.create(), problem, seed=seed)
    layout, D = problem.layout, problem.dimension
    names = [p.name for p in layout.parameters]
    values = layout.physical(outcome.z[None, :D])[0].tolist()
    biases = {n.name: n.scale * float(z) for n, z in zip(layout.nuisances, outcome.z[D:], strict=True)}
    estimates = dict(zip(names, values, strict=True)) | biases
    return {"values": estimates, "cost": outcome.cost, "status": outcome.status}

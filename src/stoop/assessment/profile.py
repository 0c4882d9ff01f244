"""Profile likelihood: one parameter is held on a row of values, everything else is fitted anew.

Twice the logarithm of the likelihood ratio is the rise of the cost. Where residuals are colored it is divided by the square of
the factor by which the error bar is corrected: the profile of a linear model then gives the corrected interval.

References
----------
Y. Pawitan, *In All Likelihood*, Oxford, 2001, sections 2.6 and 3.4.
L. Pace, A. Salvan and N. Sartori, "Adjusting composite likelihood ratio statistics", *Statistica Sinica* 21, 2011,
pp. 129-148 (the ratio of a likelihood that takes correlated readings as independent).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.assessment.assessment import (
    Finding,
    Optimum,
    Watch,
    free_entries,
    likelihood_optimum,
    packed,
    refits,
    unpacked_optimum,
)
from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.base.text import nearest
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate
from stoop.estimate.refit_problem import Derived
from stoop.optimize import Settings, refine
from stoop.optimize.normal_equations import Jacobian, tall
from stoop.parallel import Json, LocalProcesses, Plan, Pool, Run
from stoop.results.uncertainty import Interval, MethodIntervals

CROSSING: Final = 0.01  #: of the threshold's root, by which a crossing may be missed
MAX_REFITS: Final = 12  #: on one side
MAX_GROWTH: Final = 3.0  #: of the step outward
FIRST_STEP: Final = 0.05  #: of the box, for a parameter that the data do not see
SETTINGS: Final = Settings(60, 1e-9, 1e-6, 0, np.inf)
WORK: Final = "stoop.assessment.profile:profile_one"
DOUBTFUL: Final = "doubtful"  #: stands for all parameters whose identifiability is in doubt
BETTER: Final = 0.1  #: statistic by which a refit must fall below the fit's optimum for it to be reported


@dataclass(frozen=True, eq=False)
class Pinned(Derived):
    """A problem with one of its parameters held."""

    entry: int
    value: float

    @property
    def dimension(self) -> int:
        """Number of variables left in the unit box."""
        return self.problem.dimension - 1

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n_r)."""
        return self.problem.residuals(np.insert(Z, self.entry, self.value, axis=1), rung)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[Jacobian, float]:
        """Return the derivative by what is left, and the trajectories it took."""
        jacobian, spent = self.problem.jacobian(np.insert(z, self.entry, self.value), rung, r)
        rest = np.delete(np.arange(self.dimension + 1 + self.extra), self.entry)
        return tall(jacobian).of_variables(rest), spent


class ProfileLikelihood:
    """The profile of the parameter at an entry of the problem's vector, in the unit box, by refits on both sides.

    `factor` is that by which its error bar is corrected for the color of the residuals, as the weights have it.

    Attributes
    ----------
    lower, upper : float
        Ends of the 95 % interval; NaN where the data leave it open up to the bound.
    points : list of tuple
        Values tried and signed root of the likelihood-ratio statistic, ascending.
    better : float
        By how much a refit fell below the optimum, statistic; 0 for an optimum that was one.
    """

    def __init__(self, optimum: Optimum, entry: int, factor: float = 1.0) -> None:
        self.optimum, self.entry, self.factor = optimum, entry, factor
        self.center = float(optimum.z[entry])
        self.points = [(self.center, 0.0)]
        # how the free entries follow the parameter (f,) in a linear model, and its variance; zeros if unseen
        self.follow, self.variance = np.zeros(len(optimum.free)), 0.0
        where = np.flatnonzero(optimum.free == entry)
        if where.size and optimum.inverse.determined[where[0]]:
            column = optimum.inverse.factor @ optimum.inverse.factor[where[0]]
            self.follow, self.variance = column / column[where[0]], float(column[where[0]])
        least = float(optimum.residual @ optimum.residual)
        pinned = Pinned(optimum.problem, entry, self.center)
        again = refine(pinned, np.delete(optimum.z, entry), optimum.rung, SETTINGS)
        self.better = max(0.0, least - again.cost) / factor**2
        self.least = min(least, again.cost)
        self.lower, self.upper = self._end(-1.0), self._end(1.0)
        self.points.sort()

    def _end(self, direction: float) -> float:
        """Return where the statistic's root passes 1.96 to one side; NaN where it does not before the bound."""
        bound, sigma = 1.0 if direction > 0.0 else 0.0, self.factor * float(np.sqrt(self.variance))
        reach = abs(bound - self.center)
        # where a linear model would pass
        distance = min(NORMAL_95 * sigma if sigma > 0.0 else FIRST_STEP, reach)
        known, starts = [(0.0, 0.0)], [self.optimum.z]  # distance and root of the statistic
        for _ in range(MAX_REFITS if reach > 0.0 else 0):
            value = bound if distance >= reach else self.center + direction * distance
            root = self._refitted(value, starts)
            self.points.append((value, direction * root))
            known = sorted([*known, (distance, root)])
            if abs(root - NORMAL_95) <= CROSSING * NORMAL_95:
                break
            if root < NORMAL_95 and distance >= reach:
                return np.nan
            below, above = _bracket(known)
            if above is not None:  # between the two around the crossing
                room = 0.1 * (above[0] - below[0])
                distance = float(np.clip(_cross(below, above), below[0] + room, above[0] - room))
            else:  # outward by the slope seen so far
                guess = 1.1 * (below[0] * NORMAL_95 / max(below[1], 1e-6))
                distance = min(float(np.clip(guess, 1.2 * below[0], MAX_GROWTH * below[0])), reach)
        below, above = _bracket(known)
        return np.nan if above is None else self.center + direction * _cross(below, above)

    def _refitted(self, value: float, starts: list[FloatArray]) -> float:
        """Refit from the nearest start, moved along the linear model's ridge; return the root of the statistic."""
        optimum, d = self.optimum, self.optimum.problem.dimension
        near = min(starts, key=lambda z: abs(float(z[self.entry]) - value))
        start = near.copy()
        start[optimum.free] += self.follow * (value - float(near[self.entry]))
        start[:d] = np.clip(start[:d], 0.0, 1.0)
        pinned = Pinned(optimum.problem, self.entry, value)
        best = refine(pinned, np.delete(start, self.entry), optimum.rung, SETTINGS)
        rise = best.cost - self.least
        self.better = max(self.better, -rise / self.factor**2)
        if np.isfinite(best.cost):
            starts.append(np.insert(best.z, self.entry, value))
        return float(np.sqrt(max(rise, 0.0)) / self.factor) if np.isfinite(rise) else np.inf


def _bracket(known: list[tuple[float, float]]) -> tuple[tuple[float, float], tuple[float, float] | None]:
    """Return the last point below the threshold before the first one above it, and that one."""
    above = next((point for point in known if point[1] > NORMAL_95 * (1.0 + CROSSING)), None)
    inside = [point for point in known if point[0] < (np.inf if above is None else above[0])]
    close = [point for point in inside if abs(point[1] - NORMAL_95) <= CROSSING * NORMAL_95]
    return inside[-1], close[0] if close else above


def _cross(below: tuple[float, float], above: tuple[float, float]) -> float:
    """Return the distance at which the straight line through two points passes the threshold."""
    (a, low), (b, high) = below, above
    if not np.isfinite(high):
        return 0.5 * (a + b)
    return b if high <= low else a + (b - a) * (NORMAL_95 - low) / (high - low)


@dataclass(frozen=True)
class Profile:
    """Hold one parameter after the other on a row of values and refit the others."""

    #: names; ``doubtful`` stands for all whose identifiability is in doubt, or that lie at a bound
    parameters: tuple[str, ...] = (DOUBTFUL,)
    pool: Pool = field(default_factory=LocalProcesses)
    #: what is done is kept there, and not done again; in a temporary folder when absent
    store: Path | None = None

    name: str = field(default="profile", init=False)

    def __call__(self, fit: Estimate, bars: ErrorBars, seed: int, watch: Watch) -> Finding:
        """Return likelihood-ratio intervals; NaN for an end that the data leave open."""
        plan = self._plan(fit, bars)
        found: Any = refits(plan, self.store, self.pool, "profile: {} of {} parameters", 1, watch)
        parameters, notices, layout, names = {}, list[Notice](), fit.problem.layout, list(fit.estimates)
        if len(found) < len(names):
            notices.append(notice("profile-of-some-parameters"))
        for name, one in found.items():
            entry = names.index(name)
            p, ends = layout.parameters[entry], np.array(one["ends"], dtype=np.float64)
            low, high = (layout.lower[entry] + layout.width[entry] * ends).tolist()
            parameters[name] = Interval((high - low) / (2.0 * NORMAL_95), low, high)
            sides = [side for side, end in (("-below", low), ("-above", high)) if not np.isfinite(end)]
            if sides:
                code = "profile-open" + (sides[0] if len(sides) == 1 else "")
                notices.append(notice(code, name, lower=p.lower, upper=p.upper))
            if one["better"] > BETTER:
                notices.append(notice("profile-better-optimum", name))
        count = float(sum(len(one["points"]) - 1 for one in found.values()))
        return Finding(MethodIntervals(parameters, {"refits": count}, tuple(notices)))

    def _plan(self, fit: Estimate, bars: ErrorBars) -> Plan:
        """Return the campaign, one run a parameter; refuses names as :func:`check_names`."""
        names, runs = list(fit.estimates), list[Run]()
        check_names(names, self.parameters)
        pairs = zip(names, bars.at_bound, strict=False)
        doubtful = [name for name, held in pairs if held or bars.identifiability[name].reason]
        wanted = (name for one in self.parameters for name in (doubtful if one == DOUBTFUL else [one]))
        problem, free = packed(fit, bars, {}), free_entries(fit, bars)
        with np.errstate(invalid="ignore"):
            ratios = bars.std[free] / np.sqrt(np.diag(bars.uncertainty.cramer_rao))[: len(free)]
        factors = dict(zip(free.tolist(), ratios.tolist(), strict=True))
        for name in dict.fromkeys(wanted):
            entry = names.index(name)
            factor = factors.get(entry, np.nan)
            given = {"problem": problem, "entry": entry, "factor": factor if np.isfinite(factor) else 1.0}
            runs.append(Run(name, WORK, given))
        digest = hashlib.sha256(problem.encode()).hexdigest()
        return Plan("profile likelihoods of a fit", {"problem": digest}, tuple(runs))


def check_names(free: Sequence[str], wanted: Sequence[str]) -> None:
    """Raise an IdentificationError for a name that is not among the free parameters."""
    for name in wanted:
        if name != DOUBTFUL and name not in free:
            raise IdentificationError(f"profile '{name}': no free parameter; {nearest(name, free)}")


@on_one_blas_thread
def profile_one(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Return the profile of one parameter, in the unit box: the work of a run."""
    given: Any = arguments
    found = ProfileLikelihood(_unpacked(given["problem"]), int(given["entry"]), float(given["factor"]))
    points: list[Json] = [list(point) for point in found.points]
    return [{"ends": [found.lower, found.upper], "points": points, "better": found.better} for _ in stops]


@lru_cache(maxsize=1)
def _unpacked(text: str) -> Optimum:
    problem, optimum, _ = unpacked_optimum(text)
    return likelihood_optimum(problem, optimum)

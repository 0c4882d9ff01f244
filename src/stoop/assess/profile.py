"""Profile likelihood: one parameter is held on a row of values, everything else is fitted anew.

Twice the logarithm of the likelihood ratio is the rise of the cost, in a problem whose weights are the inverse
noise covariance. Where residuals are colored it is divided by the square of the factor by which that parameter's
error bar is corrected: the profile of a linear model then gives the corrected interval, and one of a curved model keeps
its own shape.

References
----------
Y. Pawitan, *In All Likelihood*, Oxford, 2001, sections 2.6 and 3.4.
L. Pace, A. Salvan and N. Sartori, "Adjusting composite likelihood ratio statistics", *Statistica Sinica* 21, 2011,
pp. 129-148 (the ratio of a likelihood that takes correlated readings as independent).
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop.assess.assessment import AssessedFit, Finding, Watch, unpack
from stoop.assess.covariance import NORMAL_95
from stoop.assess.refit import Optimum, Pinned, linearize, stationary
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.text import nearest
from stoop.errors import IdentificationError
from stoop.optimize import Refinement, Settings, refine
from stoop.parallel import Json, LocalProcesses, Plan, Pool, Run, Tally, execute
from stoop.problem import Misfit
from stoop.results.uncertainty import Interval, MethodIntervals

CROSSING: Final = 0.01  #: of the threshold's root, by which a crossing may be missed
TRIES: Final = 12  #: refits at most on one side
GROWTH: Final = 3.0  #: of the step outward, at most
WIDE: Final = 0.05  #: of the box: first step of a parameter that the data do not see
SETTINGS: Final = Settings(60, 1e-9, 1e-6, 0, np.inf)
WORK: Final = "stoop.assess.profile:profile_one"
DOUBTFUL: Final = "doubtful"  #: stands for all parameters whose identifiability is in doubt
BETTER: Final = 0.1  #: statistic by which a refit must fall below the fit's optimum for it to be reported


@dataclass(frozen=True, eq=False)
class ProfileLikelihood:
    """The profile of one parameter, in the unit box.

    Attributes
    ----------
    lower, upper : float
        Ends of the 95 % interval; NaN where the cost has not risen enough up to the bound: the data leave it open.
    points : (m, 2)
        Values tried, ascending, and the signed root of the (corrected) likelihood-ratio statistic there.
    better : float
        By how much a refit fell below the optimum, statistic; 0 for an optimum that was one.
    """

    lower: float
    upper: float
    points: FloatArray
    better: float


def profile_likelihood(optimum: Optimum, entry: int, factor: float = 1.0) -> ProfileLikelihood:
    """Return the profile of one parameter.

    Parameters
    ----------
    optimum : Optimum
    entry : int
        Of the parameter in the problem's vector.
    factor : float
        By which its error bar is corrected for the color of the residuals, as the weights see it.
    """
    least = float(optimum.residual @ optimum.residual)
    again = _refitted(optimum, entry, float(optimum.z[entry]), optimum.z)
    better = max(0.0, least - again.cost) / factor**2
    sides = [_Side(optimum, entry, factor, d, min(least, again.cost)) for d in (-1.0, 1.0)]
    ends = [side.end() for side in sides]
    tried = sorted([(float(optimum.z[entry]), 0.0), *(point for side in sides for point in side.points)])
    better = max([better, *(side.better for side in sides)])
    return ProfileLikelihood(ends[0], ends[1], np.array(tried), better)


def _refitted(optimum: Optimum, entry: int, value: float, start: FloatArray) -> Refinement:
    """Return the refit of all else with one parameter held."""
    return refine(Pinned(optimum.problem, entry, value), np.delete(start, entry), optimum.rung, SETTINGS)


class _Side:
    """The walk away from the optimum to one side."""

    def __init__(self, optimum: Optimum, entry: int, factor: float, direction: float, least: float) -> None:
        self.optimum, self.entry, self.factor, self.direction = optimum, entry, factor, direction
        self.center = float(optimum.z[entry])
        self.bound = 1.0 if direction > 0.0 else 0.0
        self.least = least
        self.better = 0.0
        self.points: list[tuple[float, float]] = []
        self.known = [(0.0, 0.0)]  # distance and root of the statistic
        self.starts = [optimum.z]

    def end(self) -> float:
        """Return where the statistic's root passes 1.96; NaN where it does not before the bound."""
        reach = abs(self.bound - self.center)
        distance = min(self._first(), reach)
        for _ in range(TRIES if reach > 0.0 else 0):
            root = self._try(distance)
            if abs(root - NORMAL_95) <= CROSSING * NORMAL_95:
                break
            if root < NORMAL_95 and distance >= reach:
                return np.nan
            distance = self._next(reach)
        below, above = self._bracket()
        return np.nan if above is None else self.center + self.direction * _cross(below, above)

    def _first(self) -> float:
        """Return the distance at which a linear model would pass."""
        sigma = self.factor * float(np.sqrt(self._slope()[1]))
        return NORMAL_95 * sigma if sigma > 0.0 else WIDE

    def _slope(self) -> tuple[FloatArray, float]:
        """Return how the free entries follow the parameter (f,) in a linear model, and its variance; zeros if unseen."""
        where = np.flatnonzero(self.optimum.free == self.entry)
        if not where.size or not self.optimum.inverse.determined[where[0]]:
            return np.zeros(len(self.optimum.free)), 0.0
        factor = self.optimum.inverse.factor
        column = factor @ factor[where[0]]
        return column / column[where[0]], float(column[where[0]])

    def _try(self, distance: float) -> float:
        """Refit at a distance; return the root of the statistic."""
        outside = distance >= abs(self.bound - self.center)
        value = self.bound if outside else self.center + self.direction * distance
        best = _refitted(self.optimum, self.entry, value, self._start(value))
        rise = best.cost - self.least
        self.better = max(self.better, -rise / self.factor**2)
        root = np.sqrt(max(rise, 0.0)) / self.factor if np.isfinite(rise) else np.inf
        self.points.append((value, self.direction * float(root)))
        self.known = sorted([*self.known, (distance, float(root))])
        if np.isfinite(best.cost):
            self.starts.append(np.insert(best.z, self.entry, value))
        return float(root)

    def _start(self, value: float) -> FloatArray:
        """Return the nearest refit, moved along the linear model's ridge."""
        near = min(self.starts, key=lambda z: abs(float(z[self.entry]) - value))
        follow, _ = self._slope()
        moved = near.copy()
        moved[self.optimum.free] += follow * (value - float(near[self.entry]))
        d = self.optimum.problem.dimension
        moved[:d] = np.clip(moved[:d], 0.0, 1.0)
        return moved

    def _bracket(self) -> tuple[tuple[float, float], tuple[float, float] | None]:
        """Return the last point below the threshold before the first one above it, and that one."""
        above = next((point for point in self.known if point[1] > NORMAL_95 * (1.0 + CROSSING)), None)
        limit = np.inf if above is None else above[0]
        inside = [point for point in self.known if point[0] < limit]
        close = [point for point in inside if abs(point[1] - NORMAL_95) <= CROSSING * NORMAL_95]
        return (inside[-1], close[0]) if close else (inside[-1], above)

    def _next(self, reach: float) -> float:
        """Return the next distance: outward by the slope seen so far, or between the two around the crossing."""
        below, above = self._bracket()
        if above is not None:
            inner = _cross(below, above)
            room = 0.1 * (above[0] - below[0])
            return float(np.clip(inner, below[0] + room, above[0] - room))
        guess = below[0] * NORMAL_95 / max(below[1], 1e-6)
        return min(float(np.clip(1.1 * guess, 1.2 * below[0], GROWTH * below[0])), reach)


def _cross(below: tuple[float, float], above: tuple[float, float]) -> float:
    """Return the distance at which the straight line through two points passes the threshold."""
    (a, low), (b, high) = below, above
    if not np.isfinite(high):
        return 0.5 * (a + b)
    return b if high <= low else a + (b - a) * (NORMAL_95 - low) / (high - low)


@dataclass(frozen=True)
class Profile:
    """Hold one parameter after the other on a row of values and refit the others.

    Attributes
    ----------
    parameters : tuple of str
        Names; ``doubtful`` stands for all whose identifiability is in doubt, or that lie at a bound.
    pool : Pool
    store : Path, optional
        What is done is kept there, and not done again; in a temporary folder when absent.
    """

    parameters: tuple[str, ...] = (DOUBTFUL,)
    pool: Pool = field(default_factory=LocalProcesses)
    store: Path | None = None

    name: str = field(default="profile", init=False)

    def __call__(self, fit: AssessedFit, watch: Watch) -> Finding:
        """Return likelihood-ratio intervals; NaN for an end that the data leave open."""
        plan = profile_plan(fit, selected(fit, self.parameters))

        def report(done: Tally) -> None:
            watch(f"profile: {done.done} of {done.total} parameters {done.note}".rstrip())

        with tempfile.TemporaryDirectory(prefix="stoop-") as folder:
            store = self.store or Path(folder) / "profile.sqlite"
            return Finding(_intervals(fit, execute(plan, store, self.pool, report)))


def selected(fit: AssessedFit, wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters that are profiled.

    Raises
    ------
    IdentificationError
        A name that is not free.
    """
    check_names(fit.names, wanted)
    doubtful = [
        name
        for name, held in zip(fit.names, fit.bars.at_bound, strict=False)
        if held or fit.bars.identifiability[name].reason
    ]
    return tuple(dict.fromkeys(name for one in wanted for name in (doubtful if one == DOUBTFUL else [one])))


def check_names(free: Sequence[str], wanted: Sequence[str]) -> None:
    """Refuse a name that is not among the free parameters.

    Raises
    ------
    IdentificationError
    """
    for name in wanted:
        if name != DOUBTFUL and name not in free:
            raise IdentificationError(f"profile '{name}': no free parameter; {nearest(name, free)}")


def profile_plan(fit: AssessedFit, names: Sequence[str]) -> Plan:
    """Return the campaign: one run a parameter."""
    problem = fit.packed({})
    digest = hashlib.sha256(problem.encode()).hexdigest()
    free, plain = fit.free, np.sqrt(np.diag(fit.uncertainty.cramer_rao))
    with np.errstate(invalid="ignore"):
        factors = dict(zip(free.tolist(), (fit.bars.std[free] / plain[: len(free)]).tolist(), strict=True))
    runs = []
    for name in names:
        entry = fit.names.index(name)
        factor = factors.get(entry, np.nan)
        given = {"problem": problem, "entry": entry, "factor": factor if np.isfinite(factor) else 1.0}
        runs.append(Run(name, WORK, given))
    return Plan("profile likelihoods of a fit", {"problem": digest}, tuple(runs))


def profile_one(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Return the profile of one parameter, in the unit box: the work of a run."""
    given: Any = arguments
    with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
        optimum = _unpacked(str(given["problem"]))
        found = profile_likelihood(optimum, int(given["entry"]), float(given["factor"]))
    done: dict[str, Json] = {
        "ends": [found.lower, found.upper],
        "points": found.points.tolist(),
        "better": found.better,
    }
    return [done for _ in stops]


@lru_cache(maxsize=1)
def _unpacked(text: str) -> Optimum:
    problem, arrays = unpack(text)
    optimum = linearize(problem, arrays["z"], arrays["free"].astype(np.intp))
    return optimum if isinstance(problem, Misfit) else stationary(optimum)


def _intervals(fit: AssessedFit, results: Mapping[str, Any]) -> MethodIntervals:
    layout, parameters, notices = fit.fit.problem.layout, {}, list[Notice]()
    if len(results) < len(fit.names):
        notices.append(notice("profile-of-some-parameters"))
    for name, found in results.items():
        entry = fit.names.index(name)
        p = layout.parameters[entry]
        low, high = (layout.lower[entry] + layout.width[entry] * float(end) for end in found["ends"])
        parameters[name] = Interval(float(high - low) / (2.0 * NORMAL_95), float(low), float(high))
        below, above = not np.isfinite(low), not np.isfinite(high)
        if below or above:
            code = (
                "profile-open" if below and above else "profile-open-below" if below else "profile-open-above"
            )
            notices.append(notice(code, name, lower=p.lower, upper=p.upper))
        if found["better"] > BETTER:
            notices.append(notice("profile-better-optimum", name))
    refits = sum(len(found["points"]) - 1 for found in results.values())
    return MethodIntervals(parameters, {"refits": float(refits)}, tuple(map(str, notices)))

"""The methods ``filter-error`` and ``filter-error-ekf``: maximum likelihood of the innovations by Fisher's scoring.

Scoring is damped as Levenberg and Marquardt do, within bounds; it starts from the file's values and from the regression,
and the gains are linearized anew along the states that the filter finds.

References
----------
M. R. Osborne, "Fisher's method of scoring", *International Statistical Review* 60(1), 1992, pp. 99-117.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.errors import IdentificationError
from stoop.estimate.filter_error.frozen import FrozenFilter
from stoop.estimate.filter_error.gains import Gain, Steady, Varying
from stoop.estimate.filter_error.likelihood import Innovations, Likelihood
from stoop.estimate.filter_error.linearization import refuse_free_delays
from stoop.estimate.filter_error.noise import Noise, first_guess
from stoop.estimate.fit import Fit, Options, estimation_problem, starts
from stoop.flight import Flight
from stoop.optimize.minimize import Status
from stoop.problem import Layout, Misfit, Nuisance
from stoop.problem.evidence import Evidence, PieceEvidence, Unknown, unknowns_of
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import GUST_STATES

DEFAULTS: Final = Options()
MAX_ITERATIONS: Final = 60
TOLERANCE: Final = 1e-4  #: of -ln L that is left to gain where scoring ends: a seventieth of a standard error
FIRST_TOLERANCE: Final = 1e-2  #: likewise of the first ascents, before the gains are linearized anew
SAME_LIKELIHOOD: Final = 0.1  #: of -ln L: two ascents that end so near each other found the same
MAX_LINEARIZATIONS: Final = 3  #: along the states that the filter finds
LINEARIZED: Final = 0.05  #: change of -ln L by another linearization that needs no further one
MAX_DAMPING: Final = 1e8
GUST_SHARES: Final = {
    "u": (1.0,),
    "v": (0.5**0.5, 0.5),
    "w": (0.5**0.5, 0.5),
}  #: of the intensity in each gust state
ADVICE: Final[dict[Status, str]] = {
    "converged": "",
    "generations": f"no maximum of the likelihood after {MAX_ITERATIONS} steps; begin nearer, fix what the data cannot tell",
    "interrupted": "stopped by the user",
}


@dataclass(frozen=True, eq=False)
class Ascent:
    """Where scoring ended.

    Attributes
    ----------
    likelihood : Likelihood
        With the gains of this ascent.
    z : (k,)
    cost : float
        Twice the negative logarithm of the posterior.
    status : str
    history : (i, 2)
        Iterations and cost.
    """

    likelihood: Likelihood
    z: FloatArray
    cost: float
    status: Status
    history: FloatArray


@dataclass(frozen=True, eq=False)
class Score:
    """Gradient (k,) and Fisher's information (k, k) of the negative logarithm of the posterior."""

    gradient: FloatArray
    information: FloatArray
    pieces: tuple[Innovations, ...]


def score(likelihood: Likelihood, z: FloatArray) -> Score:
    """Return gradient and information at a point."""
    gradient, information = likelihood.prior(z)
    pieces = tuple(likelihood.innovations(z))
    for piece in pieces:
        gradient[piece.entries] += piece.gradient
        information[np.ix_(piece.entries, piece.entries)] += piece.information
    return Score(gradient, information, pieces)


def ascend(likelihood: Likelihood, z: FloatArray, tolerance: float = TOLERANCE) -> Ascent:
    """Ascend from z until so much of -ln L is left to gain; Ctrl-C keeps the best so far."""
    lower, upper = likelihood.bounds
    z = np.clip(z, lower, upper)
    cost = likelihood.cost(z)
    damping, growth = 1e-3, 4.0
    status: Status = "generations"
    history = [(0.0, cost)]
    try:
        while len(history) <= MAX_ITERATIONS and np.isfinite(cost):
            at = score(likelihood, z)
            g = at.gradient
            free = np.flatnonzero(~(((z <= lower) & (g > 0.0)) | ((z >= upper) & (g < 0.0))))
            information = at.information[np.ix_(free, free)]
            if 0.5 * float(g[free] @ _solve(information, g[free], 0.0)) < tolerance:
                status = "converged"
                break
            trial = np.inf
            while not trial < cost and damping < MAX_DAMPING:
                step = np.zeros_like(z)
                step[free] = _solve(information, -g[free], damping)
                there = np.clip(z + step, lower, upper)
                trial = likelihood.cost(there)
                if trial < cost:
                    damping, growth = max(damping / 10.0, 1e-9), 4.0
                else:
                    damping, growth = damping * growth, 2.0 * growth
            if not trial < cost:
                break
            z, cost = there, trial
            history.append((float(len(history)), cost))
    except KeyboardInterrupt:
        status = "interrupted"
    return Ascent(likelihood, z, cost, status, np.array(history))


def _solve(information: FloatArray, right: FloatArray, damping: float) -> FloatArray:
    """Solve with the diagonal scaled to one, so that units do not matter."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    matrix = information * np.outer(scale, scale)
    matrix[np.diag_indices_from(matrix)] += max(damping, 1e-12)
    return np.asarray(scale * np.linalg.solve(matrix, scale * right))


@dataclass(frozen=True)
class FilterError:
    """Filter error with one kind of gain."""

    gain: Gain

    def __call__(
        self,
        vehicle: Vehicle,
        flights: Mapping[str, Flight],
        windows: Sequence[Window],
        options: Options = DEFAULTS,
        callback: Callable[[Any], None] | None = None,
        state: Any = None,
    ) -> Fit:
        """Maximize the likelihood of the innovations, see :mod:`stoop.estimate.methods`."""
        problem, prepared = estimation_problem(vehicle, flights, windows, options)
        refuse_free_delays(problem)
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            problem = with_gusts(problem)
            given = options.covariance
            variances = np.diag(given) if given is not None and given.ndim == 2 else given
            noise = Noise(vehicle, first_guess(vehicle, problem.pieces), variances)
            ascents = [self._from(problem, noise, x) for x in starts(problem)]
            best = _linearized_anew(min(ascents, key=lambda a: a.cost))
            if not np.isfinite(best.cost):
                raise IdentificationError(
                    f"{vehicle.where}: the filter diverges from every start; check values, bounds and units, or shorten "
                    "the maneuver"
                )
            return _fit(problem, prepared, best, sorted(a.cost for a in ascents))

    def _from(self, problem: Misfit, noise: Noise, x: FloatArray) -> Ascent:
        """Ascend from parameters (D,), then once more with gains that suit where that led."""
        z = np.concatenate([x, np.zeros(problem.extra), noise.start])
        first = ascend(Likelihood.of(problem, noise, self.gain, z), z, FIRST_TOLERANCE)
        if first.status == "interrupted" or not np.isfinite(first.cost):
            return first
        return ascend(first.likelihood.along(first.z), first.z, FIRST_TOLERANCE)


def with_gusts(problem: Misfit) -> Misfit:
    """Return the problem with the gusts at the beginning of each piece among the nuisances."""
    vehicle = problem.layout.vehicle
    gusts = [
        Nuisance(name, piece.maneuver, i, 0.0, share * vehicle.value(f"turbulence.{axis}.intensity"))
        for i, piece in enumerate(problem.pieces)
        for axis in vehicle.gusts
        for name, share in zip(GUST_STATES[axis], GUST_SHARES[axis], strict=True)
    ]
    own = problem.layout.nuisances
    states, biases = [n for n in own if not n.is_bias], [n for n in own if n.is_bias]
    return replace(problem, layout=Layout(vehicle, problem.layout.parameters, (*states, *gusts, *biases)))


def _linearized_anew(best: Ascent) -> Ascent:
    """Ascend further with gains along the states that the filter finds, until these change no more."""
    for _ in range(MAX_LINEARIZATIONS):
        if best.status == "interrupted" or not np.isfinite(best.cost):
            break
        before, best = best.cost, ascend(best.likelihood.along(best.z), best.z)
        if 0.5 * abs(before - best.cost) < LINEARIZED:
            break
    return best


def _fit(problem: Misfit, prepared: Prepared, best: Ascent, costs: Sequence[float]) -> Fit:
    """Return the fit of the best ascent; `costs` are those of the ascents from each start, ascending."""
    likelihood, status = best.likelihood, best.status
    z, tail = best.z[: likelihood.known], best.z[likelihood.known :]
    iterations = len(best.history) - 1
    runs = float(iterations * (likelihood.size + 2) * len(costs))
    at = score(likelihood, best.z)
    outcome = optimize.Outcome(
        z, best.cost, runs, iterations, status, ADVICE[status], best.history, None, "scoring"
    )
    variances = likelihood.noise.variances(tail[None, :])[0]
    return Fit(
        problem,
        prepared,
        z,
        outcome,
        best.cost,
        runs,
        _notices(likelihood, tail, at, costs),
        noise=np.diag(np.where(np.isfinite(variances), variances, np.nan)),
        own_evidence=_evidence(likelihood, best.z, at),
        local_problem=partial(FrozenFilter.of, likelihood, best.z),
    )


def _evidence(likelihood: Likelihood, z: FloatArray, at: Score) -> Evidence:
    """Return innovations and sensitivities per SI unit (of logarithms, for the noise)."""
    noise, layout, known = likelihood.noise, likelihood.problem.layout, likelihood.known
    scales = np.concatenate([layout.scales, np.ones(noise.size)])
    pieces, prior = [], likelihood.prior(z)[1]
    for piece, found in zip(likelihood.problem.pieces, at.pieces, strict=True):
        jacobian = np.zeros((*found.white.shape, likelihood.size))
        jacobian[:, :, found.entries] = -found.slopes
        residual = np.where(np.isfinite(piece.measured), found.white, np.nan)
        pieces.append(PieceEvidence(residual, jacobian / scales))
        prior[np.ix_(found.entries, found.entries)] += found.spread_information
    intensities = [Unknown(f"noise {i}", "noise", float(x), 1.0) for i, x in enumerate(z[known:])]
    unknowns = (*unknowns_of(layout, z[:known]), *intensities)
    return Evidence(unknowns, tuple(pieces), prior / np.outer(scales, scales))


def _notices(
    likelihood: Likelihood, tail: FloatArray, at: Score, costs: Sequence[float]
) -> tuple[Notice, ...]:
    """Return how to read the estimates, what noise was found, and whether starts led to different maxima."""
    correlations = [float(np.mean(p.white[1:] * p.white[:-1]) / np.mean(p.white**2)) for p in at.pieces]
    found = [
        notice("filter-error"),
        notice("innovation-correlation", correlation=float(np.mean(correlations))),
    ]
    process = likelihood.noise.describe(tail)
    if process:
        found.append(notice("process-noise", states=tuple(process), intensities=tuple(process.values())))
    if len(costs) > 1 and not 0.5 * (costs[1] - costs[0]) < SAME_LIKELIHOOD:
        found.append(notice("starts-disagree"))
    return tuple(found)


steady = FilterError(Steady())
varying = FilterError(Varying())

"""Filter error: a Kalman filter corrects the states with each measurement, which separates gusts from errors of the model.

The methods ``filter-error`` and ``filter-error-ekf`` estimate the process noise; ``stabilized-output-error`` states a small one,
which keeps an unstable model near the record. All maximize the likelihood of the innovations within bounds by Fisher's scoring
with the damping of Levenberg and Marquardt. The search starts from the values of the file and from equation error. The gains are
linearized again along the filtered states.

References
----------
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, chapters 5 (filter error)
and 9 (stabilized output error).
M. R. Osborne, "Fisher's method of scoring", *International Statistical Review* 60(1), 1992, pp. 99-117.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import notice
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate, simulated
from stoop.estimate.filter_gains import GAINS, STATED, Gain, Noise, Steady, Varying, first_guess
from stoop.estimate.filter_likelihood import SCORING, FrozenFilter, Likelihood, Score
from stoop.estimate.fit import Callback, Fitter, Options, State, starts
from stoop.estimate.fitted_filter import FittedFilter, with_gusts
from stoop.estimate.gusts import Limits, UnexplainedError
from stoop.estimate.instability import largest_growth
from stoop.estimate.linearization import Points, undelayed
from stoop.estimate.noise_model import OUTLIERS_WEIGHTED, outlying_innovations
from stoop.estimate.scoring import ScoringModel, maximize
from stoop.optimize.levenberg_marquardt import ADVICE, Stages
from stoop.problem import Misfit
from stoop.problem.evidence import Evidence, PieceEvidence, Unknown, unknowns_of
from stoop.problem.prepare import Prepared
from stoop.results.decisions import applied
from stoop.results.result import ProcessNoise
from stoop.vehicle.delays import output_delays

#: at most, of the first searches, of which the best goes on
FIRST_STEPS: Final = 20
#: likewise, of a filter that may give up; correlations after these: at most 0.06 in eight flights in gusts that a filter explains
#: (`stoop verify feedback`), 0.35 and 0.42 in two of JSBSim that it does not; after 20 steps 0.00, 0.47 and 0.42
JUDGED_STEPS: Final = 5
#: along the states that the filter finds
MAX_LINEARIZATIONS: Final = 3
#: of the filter over the record, for outliers behind outliers
MAX_SWEEPS: Final = 20
MAX_RAISES: Final = 10  #: of the first noise
RAISED: Final = 1.5  #: mean square of innovations over their variance, from which on it is


class Tolerances:
    """Differences of -ln L; a seventieth of a standard error is 1e-4."""

    #: left to gain at the end of the first searches, before the gains are linearized anew
    first: Final = 1e-2
    #: left to gain at the end of scoring
    last: Final = 1e-4
    #: change by another linearization that needs no further one
    linearization: Final = 0.05
    #: of two searches that found the same maximum
    agreement: Final = 0.1


@dataclass(frozen=True, eq=False)
class FilterEstimate(Estimate):
    """Estimate by the innovations of a Kalman filter."""

    refits: ClassVar = FrozenFilter
    likelihood: Likelihood
    #: (k,), parameters and nuisances, then the logarithms of noise intensities
    optimum: FloatArray
    #: whether readings are predicted from sample to sample, as the simulation diverges
    predicts: bool
    #: gradient and information at the optimum
    score: Score

    def own_state(self) -> dict[str, Any]:
        """Return the unknowns, the noise, and where the gains are linearized."""
        likelihood, noise = self.likelihood, self.likelihood.noise
        points = {f"states.{i}": p.states for i, p in enumerate(likelihood.points)}
        points |= {f"inputs_at.{i}": p.inputs for i, p in enumerate(likelihood.points)}
        given = {} if noise.given is None else {"given_variances": noise.given}
        return {
            **points,
            **given,
            "optimum": self.optimum,
            "anchor": likelihood.anchor,
            "first_noise": noise.first,
            "stated": np.array(np.nan if noise.stated is None else noise.stated),
            "gain": np.array(likelihood.gain.name),
            "predicts": np.array(self.predicts),
        }

    @classmethod
    @on_one_blas_thread
    def own_fields(cls, problem: Misfit, z: FloatArray, arrays: Mapping[str, Any]) -> dict[str, Any]:
        """Return the likelihood and its gradient at the unknowns."""
        stated, optimum = float(arrays["stated"]), arrays["optimum"]
        first, given = arrays["first_noise"], arrays.get("given_variances")
        noise = Noise(problem.layout.vehicle, first, given, None if np.isnan(stated) else stated)
        each = range(len(problem.pieces))
        points = tuple(Points(arrays[f"states.{i}"], arrays[f"inputs_at.{i}"]) for i in each)
        gain = GAINS[str(arrays["gain"])]
        likelihood = Likelihood(undelayed(problem), noise, gain, points, arrays["anchor"])
        found = {"likelihood": likelihood, "optimum": optimum, "predicts": bool(arrays["predicts"])}
        return {**found, "score": likelihood.score(optimum)}

    @property
    def _tail(self) -> FloatArray:
        return self.optimum[self.likelihood.known :]

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Parameters and nuisances, then noise intensities."""
        intensities = [Unknown(f"noise {i}", "noise", float(x), 1.0) for i, x in enumerate(self._tail)]
        return (*unknowns_of(self.likelihood.problem.layout, self.z), *intensities)

    @cached_property
    def evidence(self) -> Evidence:
        """Innovations and sensitivities per SI unit (of logarithms, for the noise)."""
        likelihood = self.likelihood
        scales = np.concatenate([likelihood.problem.layout.scales, np.ones(likelihood.noise.size)])
        pieces, prior = [], likelihood.prior(self.optimum)[1]
        for piece, found in zip(likelihood.problem.pieces, self.score.pieces, strict=True):
            jacobian = np.zeros((*found.white.shape, likelihood.size))
            jacobian[:, :, found.entries] = -found.slopes
            residual = np.where(np.isfinite(piece.measured), found.white, np.nan)
            pieces.append(PieceEvidence(residual, jacobian / scales, piece.maneuver))
            prior[np.ix_(found.entries, found.entries)] += found.spread_information
        return Evidence(self.unknowns, tuple(pieces), prior / np.outer(scales, scales))

    @cached_property
    def refit_problem(self) -> FrozenFilter:
        """The innovations with the gains at the estimate."""
        return FrozenFilter.of(self.likelihood, self.optimum)

    @cached_property
    def readings(self) -> tuple[FloatArray, ...]:
        """Readings (n, n_y) of each piece: of a simulation, or predicted from sample to sample where that diverges."""
        if self.predicts:
            return self.likelihood.predictions(self.optimum)
        return simulated(self.problem, self.z)

    @cached_property
    def measurement_noise(self) -> FloatArray:
        """Covariance (n_y, n_y) of the measurement noise; NaN for a channel that was never measured."""
        variances = self.likelihood.noise.variances(self._tail[None, :])[0]
        return np.diag(np.where(np.isfinite(variances), variances, np.nan))

    @property
    def process_noise(self) -> ProcessNoise:
        """Process noise and gain of the filter."""
        noise = self.likelihood.noise
        intensities = tuple(float(np.exp(x)) for x in self._tail[: len(noise.disturbed)])
        return ProcessNoise(self.likelihood.gain.name, noise.disturbed, intensities, noise.stated or 0.0)

    @property
    def innovation_correlation(self) -> float:
        """Correlation of the innovations of neighboring readings, the mean of all pieces."""
        return innovation_correlation(self.problem, self.score)

    @cached_property
    def predictor(self) -> FittedFilter:
        """The filter with gain and noise of the estimate."""
        return FittedFilter(self.likelihood.gain, self.likelihood.noise, self._tail)

    def deviations(self, covariance: FloatArray) -> tuple[FloatArray, ...]:
        """Return standard deviations (n, n_y) of the innovations of each piece."""
        return self.refit_problem.deviations


@dataclass(frozen=True)
class FilterError(Fitter[FilterEstimate]):
    """Filter error with one kind of gain."""

    gain: Gain
    #: process noise that is not estimated, see :class:`Noise`
    stated: float | None = None

    def search(
        self, problem: Misfit, prepared: Prepared, options: Options, callback: Callback, state: State
    ) -> FilterEstimate:
        """Maximize the likelihood of the innovations."""
        recorded = problem = with_gusts(problem)
        vehicle, given = problem.layout.vehicle, options.covariance
        variances = np.diag(given) if given is not None and given.ndim == 2 else given
        noise = Noise(vehicle, first_guess(vehicle, problem.pieces), variances, self.stated)
        price = float(problem.dimension + problem.extra + noise.size + 2)
        stages = Stages(SCORING, price, options.generations, options.budget, callback, state)
        best, costs = self._from_starts(stages, undelayed(problem), noise, options)
        for _ in range(MAX_LINEARIZATIONS):
            if not best.usable:
                break
            left_out = options.treatment.noise_shape
            cleaned = without_outliers(best.likelihood, best.z, problem) if left_out else problem
            if cleaned is not problem:
                problem, likelihood = cleaned, replace(best.likelihood, problem=undelayed(cleaned))
                best = maximize(stages, likelihood, best.z, Tolerances.first, FIRST_STEPS)
                if not best.usable:
                    break
            held = best
            best = maximize(stages, best.likelihood.along(best.z), best.z, Tolerances.last)
            # It diverges with gains of its own states: the maximum before stays.
            if not np.isfinite(best.cost):
                best, best.status = held, "stalled"
                break
            if 0.5 * abs(held.cost - best.cost) < Tolerances.linearization:
                break
        if not np.isfinite(best.cost):
            raise IdentificationError(
                f"{vehicle.where}: the filter diverges from every start; check values, bounds and units, or shorten "
                "the maneuver"
            )
        return _estimate(recorded, problem, prepared, best, costs, stages)

    def _from_starts(
        self, stages: Stages, problem: Misfit, noise: Noise, options: Options
    ) -> tuple[ScoringModel, list[float]]:
        """Return the best of the first searches, and the costs of all, ascending; Ctrl-C ends them.

        From known estimates there is one. A filter that may give up leaves a start from which innovations are not white after a
        few steps, and gives up where it leaves all.
        """
        searches: list[ScoringModel] = []
        unexplained: UnexplainedError | None = None
        for x in starts(problem, options.start)[1 if options.start else 0 :]:
            z = np.concatenate([x, np.zeros(problem.extra), noise.start])
            likelihood = Likelihood.of(problem, noise, self.gain, z)
            steps = JUDGED_STEPS if options.treatment.gives_up else FIRST_STEPS
            best = maximize(stages, likelihood, raised(likelihood, z), Tolerances.first, steps)
            if best.usable and options.treatment.gives_up:
                correlation = innovation_correlation(problem, best.likelihood.score(best.z))
                if abs(correlation) >= Limits.correlation:
                    unexplained = UnexplainedError(correlation)
                    continue
            if best.usable:  # once more with gains that suit where that led
                likelihood = best.likelihood.along(best.z)
                best = maximize(stages, likelihood, best.z, Tolerances.first, FIRST_STEPS)
            searches.append(best)
            if best.status == "interrupted":
                break
        if unexplained is not None and not any(np.isfinite(a.cost) for a in searches):
            raise unexplained
        best = min(searches, key=lambda a: a.cost)
        if searches[-1].status == "interrupted":
            best.status = "interrupted"
        return best, sorted(a.cost for a in searches)


def innovation_correlation(problem: Misfit, score: Score) -> float:
    """Return the correlation of the innovations of neighboring readings, the mean of all pieces."""
    found = []
    for own, piece in zip(score.pieces, problem.pieces, strict=True):
        read = zip(own.white.T, np.isfinite(piece.measured).T, strict=True)
        columns = [column[there] for column, there in read]
        together = np.concatenate([v[1:] * v[:-1] for v in columns])
        found.append(float(np.mean(together) / np.mean(np.concatenate(columns) ** 2)))
    return float(np.mean(found))


def raised(likelihood: Likelihood, z: FloatArray) -> FloatArray:
    """Return the unknowns with measurement noise raised to what the innovations show, where that is more.

    Second differences hide slow noise, and scoring raises a variance by a factor of e a step.
    """
    tail = likelihood.known + len(likelihood.noise.disturbed)
    for _ in range(MAX_RAISES):
        pieces = FrozenFilter.of(likelihood, z).standardized(z[: likelihood.known])
        shown = np.concatenate([v for v, _ in pieces])[:, likelihood.noise.channels]
        with np.errstate(over="ignore", invalid="ignore"):
            ratio = np.nansum(shown**2, axis=0) / np.maximum(np.isfinite(shown).sum(axis=0), 1)
        ratio = np.maximum(np.where(np.isfinite(ratio), ratio, 1.0), 1.0)  # what diverges shows nothing
        if not np.any(ratio > RAISED):
            break
        low, high = (bound[tail:] for bound in likelihood.bounds)
        z = np.append(z[:tail], np.clip(z[tail:] + 0.5 * np.log(ratio), low, high))
    return z


def without_outliers(likelihood: Likelihood, z: FloatArray, problem: Misfit) -> Misfit:
    """Return the problem, the readings as recorded, with outliers of the innovations as not measured; itself without any.

    An outlier masks later ones until it is removed, so the search repeats until it finds no further one.
    """
    vehicle, dt = problem.layout.vehicle, problem.pieces[0].dt
    for _ in range(MAX_SWEEPS):
        found = FrozenFilter.of(likelihood, z).standardized(z[: likelihood.known])
        masks = outlying_innovations([v for v, _ in found], dt)
        if not any(mask.any() for mask in masks):
            break
        pieces = []
        for piece, mask in zip(problem.pieces, masks, strict=True):
            measured, rows = piece.measured.copy(), vehicle.parameter_rows(piece.changes)
            late = {column: round(float(rows[row, 0]) / dt) for column, row in output_delays(vehicle)}
            for column in range(measured.shape[1]):
                at = np.flatnonzero(mask[:, column]) + late.get(column, 0)
                measured[at[(at >= 0) & (at < len(measured))], column] = np.nan
            pieces.append(replace(piece, measured=measured))
        problem = replace(problem, pieces=tuple(pieces))
        likelihood = replace(likelihood, problem=undelayed(problem))
    return problem


def _estimate(
    recorded: Misfit,
    problem: Misfit,
    prepared: Prepared,
    best: ScoringModel,
    costs: Sequence[float],
    stages: Stages,
) -> FilterEstimate:
    """Return the estimate of the best search; `costs` are those of the searches from each start, ascending.

    Its notices report the method, the estimated noise, starts that led to different maxima, and the readings, as
    `recorded`, that were taken as not measured.
    """
    likelihood, status = best.likelihood, best.status
    z, (iterations, runs) = best.z[: likelihood.known], stages.spent
    growth, score = largest_growth(problem, z), likelihood.score(best.z)
    unstable = notice("filter-predicts", factor=growth.factor, seconds=growth.seconds, rate=growth.rate)
    outcome = optimize.Outcome(
        z, best.cost, runs, iterations, status, ADVICE[status], best.history, stages.state, SCORING
    )
    found = FilterEstimate(
        problem, prepared, z, outcome, best.cost, runs, (), likelihood, best.z, growth.excessive, score
    )
    process = found.process_noise
    correlated = notice("innovation-correlation", correlation=found.innovation_correlation)
    notices = [unstable if growth.excessive else notice("filter-error"), correlated]
    if process.states:
        notices.append(notice("process-noise", states=process.states, intensities=process.intensities))
    if len(costs) > 1 and not 0.5 * (costs[1] - costs[0]) < Tolerances.agreement:
        notices.append(notice("starts-disagree"))
    before, after = (np.concatenate([np.isfinite(p.measured) for p in m.pieces]) for m in (recorded, problem))
    if (lost := (before & ~after).sum(axis=0)).any():
        channels = tuple(c for c, n in zip(problem.layout.vehicle.outputs, lost, strict=True) if n)
        share, counts = float(lost.sum() / before[:, lost > 0].sum()), tuple(map(float, lost[lost > 0]))
        count = int(lost.sum())
        missing = notice("outliers-missing", channels=channels, counts=counts, count=count, share=share)
        notices.append(missing)
        found = replace(found, decisions=applied("noise-shape", [missing], OUTLIERS_WEIGHTED))
    return replace(found, notices=tuple(notices))


steady = FilterError(Steady())
varying = FilterError(Varying())
stabilized = FilterError(Steady(), STATED)

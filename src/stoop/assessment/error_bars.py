"""Error bars and identifiability of a fit by any method, from its evidence.

The path is the same for every estimator: whitened residuals, sensitivities and prior information
(`stoop.problem.evidence`) give the information matrix, the color of the residuals, the covariance, and what the data
determine of each parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.assessment.clusters import Scatter, cluster_scatter
from stoop.assessment.coloring import ColoredNoise, Coloring, autocorrelation
from stoop.assessment.contributions import LIMITS as EXCITATION
from stoop.assessment.contributions import Contribution, contributions
from stoop.assessment.covariance import (
    data_information,
    inverse_information,
    marked,
    standard_errors,
    widened,
    windowed_covariance,
)
from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.estimate.estimate import Estimate
from stoop.estimate.response import Responses
from stoop.problem.evidence import PieceEvidence, Unknown, invert
from stoop.results.uncertainty import CorrelatedPair, NearNullDirection

CORRELATION_LAGS: Final = 200  #: samples over which the residual autocorrelation is shown


@dataclass(frozen=True)
class IdentifiabilityLimits:
    """Thresholds of identifiability."""

    conditional_ratio: float = 2.0  #: of error bars, from which one is conditional on parameters at a bound
    #: of the prior's standard deviation left by the fit: the data added next to nothing
    prior_share: float = 0.95
    box_share: float = 0.25  #: of the box's width; a value thrown into the box blindly would have 0.29
    size_share: float = 3.0  #: of the size of the parameter, where there is neither prior nor box
    collinear: float = 30.0  #: marginal over conditional standard error; multiple correlation above 0.999
    strong_correlation: float = 0.9  #: from which a pair is named
    partner_correlation: float = 0.7  #: from which another parameter counts as able to stand in
    max_directions: int = 6
    #: of its standard error, by which a parameter must move along a direction to be named
    min_component: float = 0.3


LIMITS: Final = IdentifiabilityLimits()


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariances of the k unknowns that were estimated."""

    information: FloatArray  #: (k, k); Fisher's, for white residuals, priors included
    cramer_rao: FloatArray  #: (k, k); its inverse: right if the residuals are white, else too small
    corrected: FloatArray  #: (k, k); after Morelli and Klein: right for colored residuals, given the model
    noise: ColoredNoise  #: the color found, of the weighted residuals
    autocorrelation: FloatArray  #: (ny, lags + 1); of the residuals
    coloring: Coloring  #: residuals and sensitivities that these come from


def estimate_uncertainty(
    pieces: Sequence[PieceEvidence],
    prior: FloatArray,
    white: bool = False,
    observed: Callable[[FloatArray], FloatArray | None] = lambda factor: None,
) -> Uncertainty:
    """Return the uncertainty of a fit from its residuals and sensitivities, and the information (k, k) of the priors.

    Initial states and biases are among the unknowns, those at a bound are not. Without a prior an unknown that the data
    do not determine gets infinite variance. Residuals that are `white` by construction are not corrected. `observed` returns
    the Hessian of half the cost along columns (k, r), where it is known.
    """
    information = data_information(pieces) + prior
    inverse = inverse_information(pieces, prior)
    coloring = Coloring(tuple(pieces), inverse, prior, white, observed(inverse.factor))
    noise = coloring.noise
    lags = min(CORRELATION_LAGS, max(len(piece.residual) for piece in pieces) - 1)
    corrected = inverse.matrix if white else coloring.covariance(noise)
    return Uncertainty(
        information=information,
        cramer_rao=marked(inverse.matrix, inverse.determined),
        corrected=marked(corrected, inverse.determined),
        noise=noise,
        autocorrelation=autocorrelation([piece.residual for piece in pieces], lags),
        coloring=coloring,
    )


@dataclass(frozen=True, eq=False)
class ErrorBars:
    """Uncertainty of the parameters and nuisances of a fit, in SI; k = parameters, then nuisances."""

    #: (k, k), corrected for color, weighting and the scatter of maneuvers; zero for what is at a bound or not estimated
    covariance: FloatArray
    #: (k,), standard errors of that covariance, what weightings disagree about no more than the priors allow, and of what the
    #: model lacks where that was looked for
    std: FloatArray
    conditional_std: FloatArray  #: (k,), corrected for color alone: right as far as the model is
    #: (k,), as if residuals were white; NaN where a method does not use their color
    cramer_rao_std: FloatArray
    at_bound: BoolArray  #: (k,) bool; whether the estimate lies at a bound
    identifiability: dict[str, Identifiability]  #: by parameter; those at a bound have none
    conditional: tuple[str, ...]  #: more than twice as uncertain if the parameters at a bound were free
    uncertainty: Uncertainty  #: of the `free` unknowns
    free: IntArray  #: (f,); the unknowns that are estimated and not at a bound; noise intensities come last
    priors: FloatArray  #: (f,), root-mean-square errors of their estimates by their priors alone; infinite without one
    contributions: tuple[Contribution, ...] = ()  #: of controls and motions
    #: of maneuvers or flights, whichever is larger; None where there is one maneuver
    scatter: Scatter | None = None

    def with_model_error(self, variance: FloatArray) -> ErrorBars:
        """Return error bars with a further variance (f,) of the `free` unknowns; none becomes wider than its prior allows.

        The covariance stays that of the model as it is, which behaves as the flight did: what it lacks moves the numbers, and the
        two together hardly move what they describe.
        """
        own = self.free < len(self.std)
        std, free = self.std.copy(), self.free[own]
        std[free] = _as_known(std[free], variance[own], self.priors[own])
        return replace(self, std=std)

    def rejected(self, reason: Notice) -> ErrorBars:
        """Return error bars of which none is a confident statement, for one reason; earlier doubts stay."""
        doubted = {
            name: replace(one, identifiable=False, reason=reason) if one.identifiable else one
            for name, one in self.identifiability.items()
        }
        return replace(self, identifiability=doubted)


def _as_known(std: FloatArray, variance: FloatArray, priors: FloatArray) -> FloatArray:
    """Return standard errors (k,) with a further variance (k,), none by that wider than its prior allows."""
    return np.maximum(std, np.minimum(np.sqrt(std**2 + variance), priors))


@on_one_blas_thread
def error_bars(fit: Estimate) -> ErrorBars:
    """Return the error bars of a fit, whatever its method.

    Noise intensities take part and are not returned.
    """
    evidence = fit.evidence
    unknowns, free = evidence.unknowns, evidence.free
    pieces, prior = [piece.of(free) for piece in evidence.pieces], evidence.prior[np.ix_(free, free)]
    found = estimate_uncertainty(pieces, prior, evidence.white, fit.observed_information)
    corrected, cramer_rao = found.corrected, found.cramer_rao
    gaps = [(p.gaps, p.gap_jacobian) for p in pieces if p.gaps is not None and p.gap_jacobian is not None]
    if gaps:
        windowed = windowed_covariance(pieces, [p.edges for p in pieces], gaps, prior)
        corrected = corrected if windowed is None else widened(windowed, corrected)
    if evidence.inflation != 1.0:
        independent = inverse_information(pieces, prior, evidence.inflation)
        cramer_rao = marked(independent.matrix, independent.determined)
    at_bound, conditional = np.array([u.fixed == "bound" for u in unknowns]), tuple[str, ...]()
    if at_bound.any():  # what is known only as long as the parameters at a bound are right there
        every = np.flatnonzero([u.fixed != "method" for u in unknowns])
        whole = inverse_information(
            [p.of(every) for p in evidence.pieces], evidence.prior[np.ix_(every, every)]
        )
        wide = standard_errors(marked(whole.matrix, whole.determined))[np.isin(every, free)]
        leaning = free[wide > LIMITS.conditional_ratio * standard_errors(found.cramer_rao)]
        conditional = tuple(unknowns[i].name for i in leaning if unknowns[i].kind == "parameter")
    known, k = [unknowns[i] for i in free], sum(u.kind != "noise" for u in unknowns)
    conditional_std = np.zeros(len(unknowns))
    conditional_std[free] = standard_errors(corrected)
    # what is not known, however alike maneuvers are
    each_known = identifiability(known, found.information, corrected)
    judged, plain = fit.white_evidence, found
    if judged is not evidence:
        plain = estimate_uncertainty([piece.of(free) for piece in judged.pieces], prior)
    each = contributions(fit.problem.layout.vehicle, judged, plain.information, plain.noise)
    doubtful = {n: c.variable for c in each if c.systematic > EXCITATION.refused for n in c.parameters}
    scatter = _scatter(fit, found, sum(u.kind == "parameter" for u in known))
    if scatter is not None:
        stretch = np.ones(len(free))
        stretch[: len(scatter.stretch)] = scatter.stretch
        corrected = corrected * np.outer(stretch, stretch)
    corrected = corrected + _of_held_inertia(fit, found.coloring)
    # of two weightings, both right where the model is
    apart, priors = fit.disagreement[free], np.array([u.prior_error for u in known])
    std = np.zeros(len(unknowns))
    std[free] = _as_known(standard_errors(corrected), apart**2, priors)
    corrected = corrected + np.outer(apart, apart)
    own = {u.name: j for u, j in zip(known, each_known, strict=True) if u.kind == "parameter"}
    for name in (n for n in doubtful if own[n].identifiable):
        reason = notice("systematic-residuals", doubtful[name])
        own[name] = replace(own[name], identifiable=False, reason=reason)
    idle_reason = notice("not-estimated")
    idle = [u.name for u in unknowns if u.kind == "parameter" and u.fixed == "method"]
    covariance = np.zeros((len(unknowns),) * 2)
    covariance[np.ix_(free, free)] = corrected
    white = np.full(len(unknowns), np.nan if evidence.white else 0.0)  # what is assumed is no finding
    white[free] = np.nan if evidence.white else standard_errors(cramer_rao)
    return ErrorBars(
        covariance=covariance[:k, :k],
        std=std[:k],
        conditional_std=conditional_std[:k],
        cramer_rao_std=white[:k],
        at_bound=at_bound[:k],
        identifiability=own | {n: Identifiability(n, False, idle_reason, np.inf, np.inf, 0.0) for n in idle},
        conditional=conditional,
        uncertainty=found,
        free=free,
        priors=priors,
        contributions=each,
        scatter=scatter,
    )


def held_inertia(fit: Estimate) -> dict[str, float]:
    """Return the priors of the moments of inertia that are held, by name."""
    return {
        p.name: p.prior
        for p in fit.problem.layout.vehicle.parameters
        if p.name.startswith("mass.inertia.") and not p.free and p.prior is not None
    }


def _of_held_inertia(fit: Estimate, coloring: Coloring) -> FloatArray:
    """Return the covariance (f, f) that moments of inertia add which are held (consider covariance).

    The estimates move with a held number c by dx/dc = -D^-1 S' s, with the sensitivities S and s of the readings
    (Tapley, Schutz and Born, *Statistical Orbit Determination*, 2004, section 6.2). How wrong c may be is what the flight leaves
    of its prior, and how far the flight would move it, if no further than the prior.
    """
    held = held_inertia(fit)
    responses = fit.responses() if held else Responses()
    own = [(j, held[e.name]) for j, e in enumerate(responses.extensions) if e.name in held]
    if not own:
        return np.zeros_like(coloring.prior)
    columns, priors = np.array([j for j, _ in own]), np.array([prior for _, prior in own])
    total, information = np.zeros((len(coloring.prior), len(own))), np.diag(priors**-2.0)
    slope = np.zeros(len(own))
    gaps = responses.gaps or [None] * len(coloring.segments)
    for segment, readings, gap in zip(coloring.segments, responses.pieces, gaps, strict=True):
        residual, S = segment.rows()
        _, s = replace(segment, jacobian=readings, gap_jacobian=gap).of(columns).rows()
        total += S.T @ s
        information += s.T @ s
        slope += s.T @ residual
    moved = coloring.inverse.matrix @ total
    left = np.linalg.inv(information - total.T @ moved)
    far = np.clip(left @ slope, -priors, priors)
    return np.asarray(moved @ (left + np.outer(far, far)) @ moved.T)


def _scatter(fit: Estimate, found: Uncertainty, count: int) -> Scatter | None:
    """Return the scatter of the first `count` unknowns between maneuvers, or flights where these disagree more."""
    maneuvers = [segment.maneuver for segment in found.coloring.segments]
    if len(set(maneuvers)) < 2:
        return None
    flights = [fit.prepared.windows[m].flight if m >= 0 else "" for m in maneuvers]
    levels: list[list[Hashable]] = [[*maneuvers], [*flights]]
    levels = levels[: 1 if len(set(flights)) == len(set(maneuvers)) else 2]
    scatters = [cluster_scatter(found.coloring, found.noise, labels, count) for labels in levels]
    return max((s for s in scatters if s is not None), key=lambda s: float(s.stretch.mean()), default=None)


@dataclass(frozen=True)
class Identifiability:
    """What the data say about one parameter."""

    name: str
    identifiable: bool  #: false when the number is not the data's
    reason: Notice | None  #: why; none without a doubt
    conditional_std: float  #: standard error if everything else were known
    marginal_std: float  #: standard error as it is; infinite when the data leave it free
    multiple_correlation: float  #: with all other unknowns together; 1 means that they can take its place


def identifiability(
    unknowns: Sequence[Unknown], information: FloatArray, covariance: FloatArray
) -> tuple[Identifiability, ...]:
    """Return the identifiability of k unknowns from their information, priors included, and published covariance.

    Standard errors are compared with the unknowns' priors, widths and sizes.
    """
    inverse = invert(information)
    sigma = standard_errors(covariance)
    alone = 1.0 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    marginal = standard_errors(inverse.matrix)
    # 1 - R^2 = (conditional / marginal)^2
    multiple = np.sqrt(np.clip(1.0 - (alone / np.maximum(marginal, alone)) ** 2, 0.0, 1.0))
    out = []
    for i, one in enumerate(unknowns):
        std = float(sigma[i])
        reason = None
        if not (inverse.determined[i] and np.isfinite(std)):
            reason, std = notice("not-seen"), np.inf
        elif std > LIMITS.prior_share * one.prior:
            reason = notice("prior-only")
        elif std > LIMITS.box_share * one.width:
            reason = notice("error-as-box")
        elif not np.isfinite(min(one.prior, one.width)) and std > LIMITS.size_share * one.size:
            reason = notice("error-beyond-size", times=LIMITS.size_share)
        identifiable = reason is None
        if identifiable and multiple[i] > np.sqrt(1.0 - LIMITS.collinear**-2):
            reason = notice("known-in-combination")
        out.append(Identifiability(one.name, identifiable, reason, float(alone[i]), std, float(multiple[i])))
    return tuple(out)


def scaled_singular_values(information: FloatArray) -> FloatArray:
    """Return the singular values (k,), descending, of the sensitivities with columns scaled to length 1.

    First over last is the condition of the problem; a value near 0 is a direction that the data cannot see.
    """
    return np.sqrt(np.maximum(invert(information).eigenvalues[::-1], 0.0))


def worst_pairs(names: Sequence[str], correlation: FloatArray) -> tuple[CorrelatedPair, ...]:
    """Return the twenty most correlated pairs of a matrix (k, k) at most, the worst first."""
    found = [
        CorrelatedPair(names[j], names[i], float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i)
        if np.isfinite(correlation[i, j]) and abs(correlation[i, j]) >= LIMITS.strong_correlation
    ]
    return tuple(sorted(found, key=lambda pair: -abs(pair.correlation))[:20])


def partners(names: Sequence[str], correlation: FloatArray, index: int) -> tuple[str, ...]:
    """Return up to four parameters that are strongly correlated with one of them, the strongest first."""
    strength = np.abs(np.nan_to_num(correlation[index]))
    strength[index] = 0.0
    order = np.argsort(-strength, kind="stable")[:4]
    return tuple(names[i] for i in order if strength[i] >= LIMITS.partner_correlation)


def marginal_information(information: FloatArray, count: int) -> FloatArray:
    """Return the information of the first `count` unknowns when the others are unknown, too."""
    inner, cross = information[:count, :count], information[:count, count:]
    if not cross.shape[1]:
        return inner
    across = cross @ invert(information[count:, count:]).factor
    return np.asarray(inner - across @ across.T)


def near_null_directions(
    names: Sequence[str], information: FloatArray, sizes: FloatArray
) -> tuple[NearNullDirection, ...]:
    """Return the directions in which the data hardly change, the least singular value first.

    `information` (k, k) is that of the data alone, initial states and biases unknown; a step for which the cost rises by 1
    is cut to one that doubles no parameter of `sizes` (k,).
    """
    diagonal = np.sqrt(np.maximum(np.diag(information), 0.0))
    seen = np.flatnonzero(diagonal > 0.0)
    out = [
        NearNullDirection(0.0, {name: 1.0}, notice("direction-not-seen", name))
        for name, d in zip(names, diagonal, strict=True)
        if not d > 0.0
    ]
    if seen.size > 1:
        scale, size = diagonal[seen], np.where(sizes[seen] > 0.0, sizes[seen], np.inf)
        values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)] / np.outer(scale, scale))
        singular = np.sqrt(np.maximum(values, np.finfo(np.float64).eps * values[-1]))
        sigma = np.sqrt(np.sum((vectors / singular) ** 2, axis=1))
        for i in np.flatnonzero(singular < 1.0 / LIMITS.collinear)[: LIMITS.max_directions]:
            step = vectors[:, i] / singular[i]
            share, step = step / sigma, step / scale
            step = step / max(1.0, float(np.max(np.abs(step) / size)))
            # the parameters that matter, the most moved first and upward
            order = [
                j for j in np.argsort(-np.abs(share), kind="stable") if abs(share[j]) >= LIMITS.min_component
            ]
            sign = np.sign(step[order[0]]) if order else 1.0
            parts = {names[int(seen[j])]: float(sign * step[j]) for j in order[:6]}
            moves = ", ".join(f"{name} by {value:+.3g}" for name, value in parts.items())
            code = {0: "direction-of-many", 1: "direction-of-one"}.get(len(parts), "direction-together")
            out.append(NearNullDirection(float(singular[i]), parts, notice(code, moves=moves)))
    return tuple(out[: LIMITS.max_directions])

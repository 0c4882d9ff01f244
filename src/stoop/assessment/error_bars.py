"""Error bars and identifiability of a fit by any method, from its evidence.

The path is the same for every estimator: whitened residuals, sensitivities and prior information
(`stoop.problem.evidence`) give the information matrix, the color of the residuals, the covariance, and what the data
determine of each parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from stoop.assessment.clusters import Scatter, cluster_scatter
from stoop.assessment.coloring import ColoredNoise, Coloring, autocorrelation
from stoop.assessment.components import (
    Component,
    beyond_chance,
    excess,
    nonzero,
    of_held_mass_properties,
    of_scatter,
    within_priors,
)
from stoop.assessment.contributions import Contribution, contributions
from stoop.assessment.contributions import Limits as ExcitationLimits
from stoop.assessment.covariance import (
    data_information,
    inverse_information,
    marked,
    standard_errors,
    windowed_covariance,
)
from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.estimate.estimate import Estimate
from stoop.problem.evidence import Evidence, PieceEvidence, Unknown, invert
from stoop.results.uncertainty import COMPONENTS, CorrelatedPair, NearNullDirection

GIVEN_MODEL: Final = ("noise", "color", "windows")  #: components that hold if the model is right
CORRELATION_LAGS: Final = 200  #: samples over which the residual autocorrelation is shown


class Limits:
    """Thresholds of identifiability."""

    conditional_ratio: Final = 2.0  #: of error bars, from which one is conditional on parameters at a bound
    #: of the prior's standard deviation left by the fit: the data added next to nothing
    prior_share: Final = 0.95
    box_share: Final = 0.25  #: of the box's width; a value thrown into the box blindly would have 0.29
    size_share: Final = 3.0  #: of the size of the parameter, where there is neither prior nor box
    collinear: Final = 30.0  #: marginal over conditional standard error; multiple correlation above 0.999
    strong_correlation: Final = 0.9  #: from which a pair is named
    partner_correlation: Final = 0.7  #: from which another parameter counts as able to stand in
    max_directions: Final = 6
    #: of its standard error, by which a parameter must move along a direction to be named
    min_component: Final = 0.3


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariances of the k unknowns that were estimated."""

    information: FloatArray  #: (k, k); Fisher's, for white residuals, priors included
    cramer_rao: FloatArray  #: (k, k); its inverse: right if the residuals are white, else too small
    colored: FloatArray  #: (k, k); after Morelli and Klein, for colored residuals; finite in all directions
    noise: ColoredNoise  #: the color found, of the weighted residuals
    autocorrelation: FloatArray  #: (ny, lags + 1); of the residuals
    coloring: Coloring  #: residuals and sensitivities that these come from

    @property
    def corrected(self) -> FloatArray:
        """Covariance (k, k) for colored residuals, given the model; infinite where nothing is known."""
        return marked(self.colored, self.coloring.inverse.determined)


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
    return Uncertainty(
        information=information,
        cramer_rao=marked(inverse.matrix, inverse.determined),
        colored=inverse.matrix if white else coloring.covariance(noise),
        noise=noise,
        autocorrelation=autocorrelation([piece.residual for piece in pieces], lags),
        coloring=coloring,
    )


@dataclass(frozen=True, eq=False)
class ErrorBars:
    """Uncertainty of the parameters and nuisances of a fit, in SI; k = parameters, then nuisances.

    The covariance is the sum of the components, and standard errors are the square roots of its diagonal.
    """

    components: tuple[Component, ...]  #: of the `free` unknowns, in the order of `COMPONENTS`
    determined: BoolArray  #: (f,); the others have infinite variance
    count: int  #: k
    at_bound: BoolArray  #: (k,) bool; whether the estimate lies at a bound
    unknowns: tuple[Unknown, ...]  #: every unknown of the fit; `free` counts these
    conditional: tuple[str, ...]  #: more than twice as uncertain if the parameters at a bound were free
    uncertainty: Uncertainty  #: of the `free` unknowns
    free: IntArray  #: (f,); the unknowns that are estimated and not at a bound; noise intensities come last
    priors: FloatArray  #: (f,), root-mean-square errors of their estimates by their priors alone; infinite without one
    apart: FloatArray  #: (f,), difference of the estimates by two weightings that chance does not explain
    contributions: tuple[Contribution, ...] = ()  #: of controls and motions
    #: of maneuvers or flights, whichever is larger; None where there is one maneuver
    scatter: Scatter | None = None
    left_out: frozenset[str] = frozenset()  #: components that are not in the sum
    refused: Notice | None = None  #: why no estimate is identifiable

    @cached_property
    def identifiability(self) -> dict[str, Identifiability]:
        """Identifiability of each parameter that is not at a bound, by its standard error."""
        free, total = [self.unknowns[i] for i in self.free], self.of_free(*COMPONENTS)
        own = identifiability(free, self.uncertainty.information, total)
        refused = [c for c in self.contributions if c.systematic > ExcitationLimits.refused]
        doubts = {n: notice("systematic-residuals", c.variable) for c in refused for n in c.parameters}
        pairs = [(u.name, one) for u, one in zip(free, own, strict=True) if u.kind == "parameter"]
        known = {name: one.doubted(doubts.get(name) or self.refused) for name, one in pairs}
        idle = [u.name for u in self.unknowns if u.kind == "parameter" and u.fixed == "method"]
        reason = notice("not-estimated")
        return known | {n: Identifiability(n, False, reason, np.inf, np.inf, 0.0) for n in idle}

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance (k, k); zero for what is at a bound or not estimated."""
        return self.part(*COMPONENTS)

    @cached_property
    def std(self) -> FloatArray:
        """Standard errors (k,)."""
        return standard_errors(self.covariance)

    @cached_property
    def conditional_std(self) -> FloatArray:
        """Standard errors (k,) given the model."""
        return standard_errors(self.part(*GIVEN_MODEL))

    @cached_property
    def cramer_rao_std(self) -> FloatArray:
        """Standard errors (k,) as if residuals were white; NaN where a method does not use their color."""
        white = self.uncertainty.coloring.white
        return np.full(self.count, np.nan) if white else standard_errors(self.part("noise"))

    def of_free(self, *names: str) -> FloatArray:
        """Return the sum (f, f) of some components."""
        parts = (c.covariance for c in self.components if c.name in names)
        return marked(sum(parts, np.zeros((len(self.free),) * 2)), self.determined)

    def part(self, *names: str) -> FloatArray:
        """Return the sum (k, k) of some components."""
        own = self.free < self.count
        out = np.zeros((self.count,) * 2)
        out[np.ix_(self.free[own], self.free[own])] = self.of_free(*names)[np.ix_(own, own)]
        return out

    def with_model_error(self, shifts: FloatArray) -> ErrorBars:
        """Return error bars with the covariance (f, f) of shifts of the `free` unknowns by what the model lacks."""
        joint = np.array([self.unknowns[i].kind == "parameter" for i in self.free], dtype=np.bool_)
        lacking = within_priors(np.outer(self.apart, self.apart) + shifts, self.priors, joint)
        kept = tuple(c for c in self.components if c.name != "model")
        return replace(self, components=(*kept, *nonzero(Component("model", lacking))))

    def without(self, names: Collection[str]) -> ErrorBars:
        """Return error bars without some components."""
        kept = tuple(c for c in self.components if c.name not in names)
        return replace(self, components=kept, left_out=self.left_out | set(names))

    @staticmethod
    @on_one_blas_thread
    def of(fit: Estimate) -> ErrorBars:
        """Return the error bars of a fit, whatever its method; what its model lacks is added by `ErrorBars.with_model_error`.

        Noise intensities take part and are not returned.
        """
        evidence = fit.evidence
        unknowns, free = evidence.unknowns, evidence.free
        pieces, prior = [piece.of(free) for piece in evidence.pieces], evidence.prior[np.ix_(free, free)]
        uncertainty = estimate_uncertainty(pieces, prior, evidence.white, fit.observed_information)
        determined, estimated = uncertainty.coloring.inverse.determined, [unknowns[i] for i in free]
        given = _given_model(pieces, prior, uncertainty, evidence.inflation)
        covariance = np.sum([c.covariance for c in given], axis=0)
        scatter = _scatter(fit, uncertainty, sum(u.kind == "parameter" for u in estimated))
        held = nonzero(Component("held", of_held_mass_properties(fit, uncertainty.coloring)))
        maneuvers: tuple[Component, ...] = ()
        if scatter is not None:
            maneuvers = nonzero(Component("maneuvers", of_scatter(scatter, covariance)))
        at_bound = np.array([u.fixed == "bound" for u in unknowns])
        plain, apart = uncertainty, fit.disagreement[free]
        if fit.white_evidence is not evidence:
            plain = estimate_uncertainty([piece.of(free) for piece in fit.white_evidence.pieces], prior)
            apart = beyond_chance(apart, plain.colored, uncertainty.colored)
        white, vehicle = fit.white_evidence, fit.problem.layout.vehicle
        k = sum(u.kind != "noise" for u in unknowns)
        bars = ErrorBars(
            components=(*given, *maneuvers, *held),
            determined=determined,
            count=k,
            at_bound=at_bound[:k],
            unknowns=tuple(unknowns),
            conditional=_conditional(evidence, uncertainty) if at_bound.any() else (),
            uncertainty=uncertainty,
            free=free,
            priors=np.array([u.prior_error for u in estimated]),
            apart=apart,
            contributions=contributions(vehicle, white, plain.information, plain.noise),
            scatter=scatter,
        )
        return bars.with_model_error(np.zeros_like(prior))


def _given_model(
    pieces: Sequence[PieceEvidence], prior: FloatArray, found: Uncertainty, inflation: float
) -> list[Component]:
    """Return the components that hold if the model is right: noise, its color, and windows."""
    inverse = found.coloring.inverse
    white = inverse.matrix if inflation == 1.0 else inverse_information(pieces, prior, inflation).matrix
    out = [Component("noise", white), Component("color", found.colored - white)]
    gaps = [(p.gaps, p.gap_jacobian) for p in pieces if p.gaps is not None and p.gap_jacobian is not None]
    if gaps:
        windowed = windowed_covariance(pieces, [p.edges for p in pieces], gaps, prior)
        if windowed is not None:
            out.append(Component("windows", excess(windowed, found.colored)))
    return out


def _conditional(evidence: Evidence, found: Uncertainty) -> tuple[str, ...]:
    """Return the parameters that are known only as long as those at a bound are right there."""
    free, unknowns = evidence.free, evidence.unknowns
    every = np.flatnonzero([u.fixed != "method" for u in unknowns])
    whole = inverse_information([p.of(every) for p in evidence.pieces], evidence.prior[np.ix_(every, every)])
    wide = standard_errors(marked(whole.matrix, whole.determined))[np.isin(every, free)]
    leaning = free[wide > Limits.conditional_ratio * standard_errors(found.cramer_rao)]
    return tuple(unknowns[i].name for i in leaning if unknowns[i].kind == "parameter")


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

    def doubted(self, reason: Notice | None) -> Identifiability:
        """Return it as not identifiable for a reason, if there is one; an earlier reason stays."""
        return replace(self, identifiable=False, reason=reason) if reason and self.identifiable else self


@on_one_blas_thread
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
        elif std > Limits.prior_share * one.prior:
            reason = notice("prior-only")
        elif std > Limits.box_share * one.width:
            reason = notice("error-as-box")
        elif not np.isfinite(min(one.prior, one.width)) and std > Limits.size_share * one.size:
            reason = notice("error-beyond-size", times=Limits.size_share)
        identifiable = reason is None
        if identifiable and multiple[i] > np.sqrt(1.0 - Limits.collinear**-2):
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
    strong = np.tril(np.abs(correlation) >= Limits.strong_correlation, -1)  # not where it is unknown
    found = [CorrelatedPair(names[j], names[i], float(correlation[i, j])) for i, j in np.argwhere(strong)]
    return tuple(sorted(found, key=lambda pair: -abs(pair.correlation))[:20])


def partners(names: Sequence[str], correlation: FloatArray, index: int) -> tuple[str, ...]:
    """Return up to four parameters that are strongly correlated with one of them, the strongest first."""
    strength = np.abs(np.nan_to_num(correlation[index]))
    strength[index] = 0.0
    order = np.argsort(-strength, kind="stable")[:4]
    return tuple(names[i] for i in order if strength[i] >= Limits.partner_correlation)


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
    unseen = [name for name, d in zip(names, diagonal, strict=True) if not d > 0.0]
    out = [NearNullDirection(0.0, {n: 1.0}, notice("direction-not-seen", n)) for n in unseen]
    if seen.size > 1:
        scale, size = diagonal[seen], np.where(sizes[seen] > 0.0, sizes[seen], np.inf)
        values, vectors = np.linalg.eigh(information[np.ix_(seen, seen)] / np.outer(scale, scale))
        singular = np.sqrt(np.maximum(values, np.finfo(np.float64).eps * values[-1]))
        sigma = np.sqrt(np.sum((vectors / singular) ** 2, axis=1))
        for i in np.flatnonzero(singular < 1.0 / Limits.collinear)[: Limits.max_directions]:
            step = vectors[:, i] / singular[i]
            share, step = step / sigma, step / scale
            step = step / max(1.0, float(np.max(np.abs(step) / size)))
            # the parameters that matter, the most moved first and upward
            moved = np.abs(share)
            order = [j for j in np.argsort(-moved, kind="stable") if moved[j] >= Limits.min_component]
            sign = np.sign(step[order[0]]) if order else 1.0
            parts = {names[int(seen[j])]: float(sign * step[j]) for j in order[:6]}
            moves = ", ".join(f"{name} by {value:+.3g}" for name, value in parts.items())
            code = {0: "direction-of-many", 1: "direction-of-one"}.get(len(parts), "direction-together")
            out.append(NearNullDirection(float(singular[i]), parts, notice(code, moves=moves)))
    return tuple(out[: Limits.max_directions])

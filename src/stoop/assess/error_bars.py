"""Error bars of a fit by any method: the Cramer-Rao bound, and the covariance corrected for colored residuals.

The path is the same for every estimator: its evidence (whitened residuals, sensitivities and prior information,
`stoop.problem.evidence`) gives the information matrix, the color of the residuals, the covariance, and what the data
determine of each parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop.assess.colored_residuals import ColoredNoise, Coloring, autocorrelation
from stoop.assess.covariance import data_information, invert, marked, standard_errors
from stoop.assess.identifiability import ComparisonScale, Identifiability, identifiability
from stoop.assess.windowed_covariance import widened, windowed_covariance
from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.estimate.fit import Fit
from stoop.problem.evidence import Evidence, PieceEvidence

CORRELATION_LAGS: Final = 200  #: samples over which the residual autocorrelation is shown
CONDITIONAL_RATIO: Final = (
    2.0  #: of error bars, from which one counts as conditional on parameters at a bound
)
NOT_ESTIMATED: Final = "the method does not estimate it"
NOT_DETERMINED: Final = "the data do not see it, alone or apart from others"


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariances of the k unknowns that were estimated.

    Attributes
    ----------
    information : (k, k)
        Fisher's, for white residuals, priors included.
    cramer_rao : (k, k)
        Its inverse: right if the residuals are white, else too small.
    corrected : (k, k)
        After Morelli and Klein: right for colored residuals.
    noise : ColoredNoise
        The color found, of the weighted residuals.
    autocorrelation : (ny, lags + 1)
        Of the residuals.
    """

    information: FloatArray
    cramer_rao: FloatArray
    corrected: FloatArray
    noise: ColoredNoise
    autocorrelation: FloatArray

    @property
    def coloring_factor(self) -> FloatArray:
        """By how much the correction widens each standard error, (k,); 1 for white, unit residuals."""
        with np.errstate(invalid="ignore"):
            return standard_errors(self.corrected) / standard_errors(self.cramer_rao)


def estimate_uncertainty(
    pieces: Sequence[PieceEvidence], prior: FloatArray, white: bool = False
) -> Uncertainty:
    """Return the uncertainty of a fit from its residuals and sensitivities.

    Parameters
    ----------
    pieces : sequence of PieceEvidence
        All pieces of all fit maneuvers, with initial states and biases among the unknowns. Unknowns at a bound should
        be left out: they are not estimated.
    prior : (k, k)
        Information of the priors, see `stoop.problem.evidence.prior_information`; zeros without any.
    white : bool
        Whether the residuals are uncorrelated by construction: then nothing is corrected.

    Notes
    -----
    The covariance of the parameters alone is the block of the parameters: initial states and biases are then
    unknown, not fixed. Without a prior an unknown that the data do not determine gets infinite variance.
    """
    information = data_information(pieces) + prior
    inverse = invert(information)
    coloring = Coloring(tuple(pieces), inverse, prior)
    noise = coloring.noise()
    lags = min(CORRELATION_LAGS, max(len(piece.residual) for piece in pieces) - 1)
    corrected = inverse.matrix if white else coloring.covariance(noise)
    return Uncertainty(
        information=information,
        cramer_rao=marked(inverse.matrix, inverse.determined),
        corrected=marked(corrected, inverse.determined),
        noise=noise,
        autocorrelation=autocorrelation([piece.residual for piece in pieces], lags),
    )


@dataclass(frozen=True, eq=False)
class ErrorBars:
    """Uncertainty of the parameters and nuisances of a fit, in SI; k = parameters, then nuisances.

    Attributes
    ----------
    covariance : (k, k)
        Corrected for the color of the residuals; zero rows for what is at a bound or not estimated.
    cramer_rao_std : (k,)
        Standard errors as if residuals were white; NaN where a method does not use their color.
    at_bound : (k,) bool
        Whether the estimate lies at a bound.
    identifiability : dict
        By parameter; those at a bound have none.
    conditional : tuple of str
        Parameters whose error bar would be more than twice as wide if those at a bound were free.
    uncertainty : Uncertainty, optional
        Of the `free` unknowns; absent for a regression that gives a covariance alone.
    free : (f,)
        The unknowns that are estimated and not at a bound; noise intensities come last.
    """

    covariance: FloatArray
    cramer_rao_std: FloatArray
    at_bound: BoolArray
    identifiability: dict[str, Identifiability]
    conditional: tuple[str, ...]
    uncertainty: Uncertainty | None
    free: IntArray

    @property
    def std(self) -> FloatArray:
        """Standard errors (k,)."""
        return standard_errors(self.covariance)

    def rejected(self, reason: str) -> ErrorBars:
        """Return error bars of which none is a confident statement, for one reason; earlier doubts stay."""
        judged = {
            name: replace(one, identifiable=False, reason=reason) if one.identifiable else one
            for name, one in self.identifiability.items()
        }
        return replace(self, identifiability=judged)


def error_bars(fit: Fit) -> ErrorBars:
    """Return the error bars of a fit, whatever its method; on one BLAS thread, as more would round differently."""
    with threadpool_limits(limits=1, user_api="blas"):
        if fit.own_evidence is None and fit.covariance is not None:
            return _of_covariance(fit, fit.covariance)
        return evidence_error_bars(fit.evidence)


def evidence_error_bars(evidence: Evidence) -> ErrorBars:
    """Return the error bars that evidence gives.

    Noise intensities take part and are not returned.
    """
    unknowns, free = evidence.unknowns, evidence.free
    pieces, prior = [piece.of(free) for piece in evidence.pieces], evidence.prior[np.ix_(free, free)]
    found = estimate_uncertainty(pieces, prior, evidence.white)
    corrected, cramer_rao = found.corrected, found.cramer_rao
    gaps = [(p.gaps, p.gap_jacobian) for p in pieces if p.gaps is not None and p.gap_jacobian is not None]
    if gaps:
        windowed = windowed_covariance(pieces, [p.edges for p in pieces], gaps, prior)
        corrected = corrected if windowed is None else widened(windowed, corrected)
    if evidence.inflation != 1.0:
        plain = invert((found.information - prior) * evidence.inflation + prior)
        cramer_rao = marked(plain.matrix, plain.determined)
    known, k = [unknowns[i] for i in free], sum(u.kind != "noise" for u in unknowns)
    scale = ComparisonScale(*(np.array([getattr(u, n) for u in known]) for n in ("prior", "width", "size")))
    judged = identifiability([u.name for u in known], found.information, corrected, scale)
    own = {u.name: j for u, j in zip(known, judged, strict=True) if u.kind == "parameter"}
    idle = [u.name for u in unknowns if u.kind == "parameter" and u.fixed == "method"]
    covariance, white = np.zeros((len(unknowns),) * 2), np.zeros(len(unknowns))
    covariance[np.ix_(free, free)] = corrected
    white[free] = np.nan if evidence.white else standard_errors(cramer_rao)
    return ErrorBars(
        covariance=covariance[:k, :k],
        cramer_rao_std=white[:k],
        at_bound=np.array([u.fixed == "bound" for u in unknowns[:k]], dtype=np.bool_),
        identifiability=own | {n: Identifiability.none(n, NOT_ESTIMATED) for n in idle},
        conditional=_conditional(evidence, found),
        uncertainty=found,
        free=free,
    )


def _conditional(evidence: Evidence, found: Uncertainty) -> tuple[str, ...]:
    """Name the parameters that are known only as long as those at a bound are right there."""
    if not any(u.fixed == "bound" for u in evidence.unknowns):
        return ()
    every = np.flatnonzero([u.fixed != "method" for u in evidence.unknowns])
    information = (
        data_information([p.of(every) for p in evidence.pieces]) + evidence.prior[np.ix_(every, every)]
    )
    whole = invert(information)
    wide = standard_errors(marked(whole.matrix, whole.determined))[np.isin(every, evidence.free)]
    narrow = standard_errors(found.cramer_rao)
    return tuple(
        evidence.unknowns[i].name
        for i, w, n in zip(evidence.free, wide, narrow, strict=True)
        if evidence.unknowns[i].kind == "parameter" and w > CONDITIONAL_RATIO * n
    )


def _of_covariance(fit: Fit, covariance: FloatArray) -> ErrorBars:
    """Return the error bars of a regression that gives the covariance of its estimates.

    It has no bounds. What it did not estimate has zero variance; what the data do not determine has an infinite one.
    """
    layout = fit.problem.layout
    d, names = layout.dimension, [p.name for p in layout.parameters]
    own = covariance[:d, :d]
    seen = np.isfinite(np.diag(own))
    known = np.flatnonzero(seen & (np.diag(own) > 0.0))
    start = np.array([p.value for p in layout.parameters])
    estimate = np.array([fit.estimates[n] for n in names])
    size = np.maximum(abs(start), abs(estimate))
    scale = ComparisonScale(np.full(len(known), np.inf), layout.width[known], size[known])
    block = own[np.ix_(known, known)]
    found = identifiability([names[i] for i in known], invert(block).matrix, block, scale)
    reasons = {name: NOT_ESTIMATED if s else NOT_DETERMINED for name, s in zip(names, seen, strict=True)}
    judged = {name: Identifiability.none(name, why) for name, why in reasons.items()}
    return ErrorBars(
        covariance=covariance,
        cramer_rao_std=np.full(len(fit.z), np.nan) if fit.white is None else standard_errors(fit.white),
        at_bound=np.zeros(len(fit.z), dtype=np.bool_),
        identifiability=judged | {j.name: j for j in found},
        conditional=(),
        uncertainty=None,
        free=np.arange(len(fit.z)),
    )

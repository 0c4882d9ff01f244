"""Error bars of the filter-error method: of what the innovations tell, their size included."""

from __future__ import annotations

import numpy as np

from stoop.assess.covariance import standard_errors
from stoop.assess.estimate import estimate_uncertainty
from stoop.assess.identifiability import Yardstick, identifiability
from stoop.assess.sensitivity import Sensitivity
from stoop.assess.windowed import widened, windowed_covariance
from stoop.estimate.fit import Evidence, Fit
from stoop.workflow.errorbars import AT_BOUND, ErrorBars, scattered, spread


def error_bars(fit: Fit, _color: float) -> ErrorBars:
    """Return the error bars of a fit that comes with its evidence.

    The unknowns beyond parameters and nuisances (intensities of noise) take part and are not returned.
    """
    evidence = fit.evidence
    if evidence is None:
        raise ValueError("the method gave no evidence")
    many, d = len(fit.z), fit.problem.dimension
    held = np.zeros(len(evidence.information), dtype=np.bool_)
    held[:d] = (fit.z[:d] < AT_BOUND) | (fit.z[:d] > 1.0 - AT_BOUND)
    free = np.flatnonzero(~held)
    segments, prior = _segments(evidence, free), evidence.information[np.ix_(free, free)]
    found = estimate_uncertainty(segments, prior)
    corrected = found.corrected
    if evidence.edges:
        gaps = [(gap, slopes[:, :, free]) for gap, slopes in evidence.gaps]
        windowed = windowed_covariance(segments, evidence.edges, gaps, prior)
        corrected = corrected if windowed is None else widened(windowed, corrected)
    own = free[free < d]
    names = [p.name for p in fit.problem.layout.parameters]
    every = [names[e] if e < d else f"unknown {e}" for e in free]
    judged = identifiability(every, found.information, corrected, _yardstick(fit, free))
    return ErrorBars(
        covariance=spread(corrected, free, len(held))[:many, :many],
        white=scattered(standard_errors(found.cramer_rao), free, len(held))[:many],
        held=held[:many],
        judged={j.name: j for j in judged[: len(own)]},
        leaning=(),
    )


def _segments(evidence: Evidence, free: np.ndarray) -> list[Sensitivity]:
    pairs = zip(evidence.residuals, evidence.jacobians, strict=True)
    return [Sensitivity(r, J[:, :, free]) for r, J in pairs]


def _yardstick(fit: Fit, free: np.ndarray) -> Yardstick:
    """Return what the standard errors are held against."""
    layout = fit.problem.layout
    rest = len(fit.evidence.information) - len(fit.z) if fit.evidence is not None else 0
    box = np.concatenate([layout.width, np.full(layout.extra + rest, np.inf)])
    prior = [p.prior or np.inf for p in layout.parameters]
    priors = np.concatenate([prior, [n.scale for n in layout.nuisances], np.full(rest, np.inf)])
    sizes = [max(abs(p.value), abs(fit.estimates[p.name])) for p in layout.parameters]
    size = np.concatenate([sizes, [n.scale for n in layout.nuisances], np.ones(rest)])
    return Yardstick(priors[free], box[free], size[free])

"""Error bars of the filter-error method: of what the innovations tell, their size included."""

from __future__ import annotations

import numpy as np

from stoop.assess.covariance import standard_errors
from stoop.assess.estimate import estimate_uncertainty
from stoop.assess.identifiability import Yardstick, identifiability
from stoop.assess.sensitivity import Sensitivity
from stoop.assess.windowed import widened, windowed_covariance
from stoop.estimate.fit import Fit
from stoop.problem.evidence import Evidence
from stoop.workflow.errorbars import ErrorBars, scattered, spread


def error_bars(fit: Fit, _color: float) -> ErrorBars:
    """Return the error bars of a fit that comes with its evidence.

    The unknowns beyond parameters and nuisances (intensities of noise) take part and are not returned.
    """
    evidence = fit.evidence
    many, d = len(fit.z), fit.problem.dimension
    held = np.array([bool(u.fixed) for u in evidence.unknowns])
    free = evidence.free
    segments, prior = _segments(evidence, free), evidence.prior[np.ix_(free, free)]
    found = estimate_uncertainty(segments, prior)
    corrected = found.corrected
    own_pieces = [piece.of(free) for piece in evidence.pieces]
    gaps = [(p.gaps, p.gap_jacobian) for p in own_pieces if p.gaps is not None and p.gap_jacobian is not None]
    if gaps:
        windowed = windowed_covariance(segments, [p.edges for p in own_pieces], gaps, prior)
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
    return [Sensitivity(p.residual, p.jacobian[:, :, free]) for p in evidence.pieces]


def _yardstick(fit: Fit, free: np.ndarray) -> Yardstick:
    """Return what the standard errors are held against."""
    unknowns = [fit.evidence.unknowns[i] for i in free]
    prior, width, size = (np.array([getattr(u, n) for u in unknowns]) for n in ("prior", "width", "size"))
    return Yardstick(prior, width, size)

"""Error bars of a fit: what the data can tell of each parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stoop.assess.covariance import invert, marked, standard_errors
from stoop.assess.estimate import Uncertainty, estimate_uncertainty
from stoop.assess.identifiability import Identifiability, Yardstick, identifiability
from stoop.assess.sensitivity import Sensitivity, data_information, prior_information
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Fit

AT_BOUND = 1e-6  #: of the box


@dataclass(frozen=True, eq=False)
class ErrorBars:
    """Uncertainty of everything estimated, in SI; k = parameters, then nuisances.

    Attributes
    ----------
    covariance : (k, k)
        Corrected for the residuals' color; zero rows for what a bound holds.
    white : (k,)
        Standard errors as if residuals were white (plain Cramer-Rao); NaN where a method did not look at their color.
    held : (k,) bool
        Whether a bound holds the entry.
    judged : dict
        Identifiability by parameter.
    leaning : tuple of str
        Parameters whose error bar would be more than twice as wide if those at a bound were free.
    found : Uncertainty, optional
        Of the entries that no bound holds, where the sensitivities of a simulation gave it.
    """

    covariance: FloatArray
    white: FloatArray
    held: NDArray[np.bool_]
    judged: dict[str, Identifiability]
    leaning: tuple[str, ...]
    found: Uncertainty | None = None

    @property
    def std(self) -> FloatArray:
        """Standard errors (k,)."""
        return standard_errors(self.covariance)


def error_bars(fit: Fit, color: float) -> ErrorBars:
    """Return the error bars of a fit.

    Parameters
    ----------
    fit : Fit
    color : float
        By how much the weights were reduced for the correlation of the residuals.
    """
    layout = fit.problem.layout
    held = _held(fit)
    free = np.flatnonzero(~held)
    prior = prior_information(_prior_std(fit)[free])
    every = _sensitivities(fit)
    found = estimate_uncertainty([_only(s, free) for s in every], prior)
    plain = invert((found.information - prior) * color + prior)
    white = standard_errors(marked(plain.matrix, plain.determined))
    return ErrorBars(
        covariance=spread(found.corrected, free, len(held)),
        white=scattered(white, free, len(held)),
        held=held,
        judged=_judged(fit, found, free, [p.name for p in layout.parameters]),
        leaning=_leaning(fit, every, found, free) if held.any() else (),
        found=found,
    )


def _only(segment: Sensitivity, free: NDArray[np.intp]) -> Sensitivity:
    return Sensitivity(segment.residual, segment.jacobian[:, :, free])


def _leaning(
    fit: Fit, every: list[Sensitivity], found: Uncertainty, free: NDArray[np.intp]
) -> tuple[str, ...]:
    """Name the parameters that are known only as long as those at a bound are right there."""
    whole = invert(data_information(every) + prior_information(_prior_std(fit)))
    wide = standard_errors(marked(whole.matrix, whole.determined))[free]
    narrow = standard_errors(found.cramer_rao)
    names = [p.name for p in fit.problem.layout.parameters]
    return tuple(
        names[e] for e, w, n in zip(free, wide, narrow, strict=True) if e < len(names) and w > 2.0 * n
    )


def _held(fit: Fit) -> NDArray[np.bool_]:
    x = fit.z[: fit.problem.dimension]
    held = np.zeros(len(fit.z), dtype=np.bool_)
    held[: len(x)] = (x < AT_BOUND) | (x > 1.0 - AT_BOUND)
    return held


def _prior_std(fit: Fit) -> FloatArray:
    parameters = [np.nan if p.prior is None else p.prior for p in fit.problem.layout.parameters]
    return np.array([*parameters, *(n.scale for n in fit.problem.layout.nuisances)])


def _sensitivities(fit: Fit) -> list[Sensitivity]:
    """Return whitened residuals and sensitivities of each piece, per SI unit."""
    return [Sensitivity(piece.residual, piece.jacobian) for piece in fit.evidence.pieces]


def spread(matrix: FloatArray, free: NDArray[np.intp], size: int) -> FloatArray:
    """Return a matrix over the free entries as one (size, size) over all, zeros for those that are held."""
    out = np.zeros((size, size))
    out[np.ix_(free, free)] = matrix
    return out


def scattered(values: FloatArray, free: NDArray[np.intp], size: int) -> FloatArray:
    """Return values of the free entries as (size,) of all, zeros for those that are held."""
    out = np.zeros(size)
    out[free] = values
    return out


def _judged(
    fit: Fit, found: Uncertainty, free: NDArray[np.intp], names: list[str]
) -> dict[str, Identifiability]:
    layout = fit.problem.layout
    mine = [i for i, entry in enumerate(free) if entry < layout.dimension]
    every = [names[i] if i < layout.dimension else f"nuisance {i}" for i in free]
    prior = _prior_std(fit)[free]
    box = np.concatenate([layout.width, np.full(layout.extra, np.inf)])[free]
    start = np.array([p.value for p in layout.parameters])
    estimate = np.array([fit.estimates[n] for n in names])
    size = np.concatenate([np.maximum(abs(start), abs(estimate)), [n.scale for n in layout.nuisances]])[free]
    yardstick = Yardstick(np.where(np.isfinite(prior), prior, np.inf), box, size)
    judged = identifiability(every, found.information, found.corrected, yardstick)
    return {every[i]: judged[i] for i in mine}

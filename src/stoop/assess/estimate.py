"""The uncertainty of a fit, both ways: the Cramer-Rao bound, and corrected for colored residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stoop.assess.colored import Coloring
from stoop.assess.covariance import invert, marked, standard_errors
from stoop.assess.noise import ColoredNoise, autocorrelation
from stoop.assess.sensitivity import Sensitivity, data_information
from stoop.base.arrays import FloatArray

CORRELATION_TIME = 200  #: samples over which the residual autocorrelation is shown


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariances of everything that was estimated; ``k`` as in `Sensitivity`.

    Attributes
    ----------
    information : (k, k)
        Fisher's, for white noise, priors included.
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


def estimate_uncertainty(segments: Sequence[Sensitivity], prior: FloatArray) -> Uncertainty:
    """Return the uncertainty of a fit from its residuals and sensitivities.

    Parameters
    ----------
    segments : sequence of Sensitivity
        All segments of all fit maneuvers, with initial states and biases among the unknowns. Unknowns that
        the bounds hold fast should be left out: they are not estimated.
    prior : (k, k)
        Information of the priors, see `prior_information`; zeros without any.

    Notes
    -----
    The covariance of the parameters alone is the block of the parameters: initial states and biases are then
    unknown, not fixed. Without a prior an unknown that the data do not see gets infinite variance.
    """
    information = data_information(segments) + prior
    inverse = invert(information)
    coloring = Coloring(tuple(segments), inverse, prior)
    noise = coloring.noise()
    lags = min(CORRELATION_TIME, max(len(segment.residual) for segment in segments) - 1)
    return Uncertainty(
        information=information,
        cramer_rao=marked(inverse.matrix, inverse.determined),
        corrected=marked(coloring.covariance(noise), inverse.determined),
        noise=noise,
        autocorrelation=autocorrelation([segment.residual for segment in segments], lags),
    )

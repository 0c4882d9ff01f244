"""Which parameters the data can tell, and which number is only the prior's or the box's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.assess.covariance import Inverse, invert, standard_errors
from stoop.base.arrays import FloatArray

PRIOR_SHARE: Final = (
    0.95  #: of the prior's standard deviation left after the fit: the data added next to nothing
)
BOX_SHARE: Final = 0.25  #: of the box's width; a value thrown into the box blindly would have 0.29
RELATIVE: Final = (
    3.0  #: times the size of the parameter, where there is neither prior nor box to compare with
)
COLLINEAR: Final = 30.0  #: marginal over conditional standard error; correlated above 0.999 with the others

COMBINED: Final = "known only in combination with others: they can almost take its place"


@dataclass(frozen=True)
class Identifiability:
    """What the data say about one parameter.

    Attributes
    ----------
    name : str
    identifiable : bool
        False when the number is not the data's.
    reason : str
        Why, in plain words; empty when nothing is amiss.
    conditional_std : float
        Standard error if everything else were known.
    marginal_std : float
        Standard error as it is; infinite when the data leave it free.
    multiple_correlation : float
        With all other unknowns together; 1 means that they can take its place.
    """

    name: str
    identifiable: bool
    reason: str
    conditional_std: float
    marginal_std: float
    multiple_correlation: float


@dataclass(frozen=True, eq=False)
class Yardstick:
    """What the standard errors (k,) are held against; infinite where there is none.

    Attributes
    ----------
    prior_std : (k,)
        Standard deviation of the prior.
    box : (k,)
        Width between the bounds.
    size : (k,)
        Magnitude of the parameter: the greater of estimate and starting value.
    """

    prior_std: FloatArray
    box: FloatArray
    size: FloatArray


def identifiability(
    names: Sequence[str], information: FloatArray, covariance: FloatArray, yardstick: Yardstick
) -> tuple[Identifiability, ...]:
    """Judge every unknown.

    Parameters
    ----------
    names : sequence of str
        Of the k unknowns.
    information : (k, k)
        Priors included.
    covariance : (k, k)
        The covariance that will be published; infinite variance where nothing is known.
    yardstick : Yardstick
        Of the same unknowns.
    """
    inverse = invert(information)
    sigma = standard_errors(covariance)
    alone = 1.0 / np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    marginal = standard_errors(inverse.matrix)
    # 1 - R^2 = (conditional / marginal)^2
    multiple = np.sqrt(np.clip(1.0 - (alone / np.maximum(marginal, alone)) ** 2, 0.0, 1.0))
    return tuple(
        _judge(name, i, inverse, yardstick, (float(alone[i]), float(sigma[i]), float(multiple[i])))
        for i, name in enumerate(names)
    )


def scaled_singular_values(information: FloatArray) -> FloatArray:
    """Return the singular values (k,), descending, of the sensitivities with columns scaled to length 1.

    First over last is the condition of the problem; a value near 0 is a direction that the data cannot see.
    """
    values = np.sqrt(np.maximum(invert(information).eigenvalues[::-1], 0.0))
    return np.asarray(values, dtype=np.float64)


def _judge(
    name: str, i: int, inverse: Inverse, yardstick: Yardstick, figures: tuple[float, float, float]
) -> Identifiability:
    alone, sigma, multiple = figures
    if not inverse.determined[i]:
        return Identifiability(name, False, "the data do not see it", alone, float("inf"), multiple)
    reason = _doubt(sigma, float(yardstick.prior_std[i]), float(yardstick.box[i]), float(yardstick.size[i]))
    identifiable = not reason
    if identifiable and multiple > np.sqrt(1.0 - COLLINEAR**-2):
        reason = COMBINED
    return Identifiability(name, identifiable, reason, alone, sigma, multiple)


def _doubt(sigma: float, prior_std: float, box: float, size: float) -> str:
    """Return why a standard error says nothing, or an empty text."""
    if sigma > PRIOR_SHARE * prior_std:
        return "the data add next to nothing to the prior"
    if sigma > BOX_SHARE * box:
        return "its error is as wide as its box: the box decides, not the data"
    if not np.isfinite(min(prior_std, box)) and sigma > RELATIVE * size:
        return f"its error is more than {RELATIVE:g} times its size"
    return ""

"""The bootstrap of a fit: refits to the model's own curves with noise like that of the residuals.

References
----------
B. Efron and R. J. Tibshirani, *An Introduction to the Bootstrap*, Chapman and Hall, 1993, chapters 9 (residuals)
and 14 (bias-corrected percentiles).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, ndtri

from stoop.assess.blocks import Blocks
from stoop.assess.covariance import NORMAL_95
from stoop.assess.optimum import Optimum
from stoop.assess.refit import Refits, refit
from stoop.base.arrays import FloatArray

BoolArray = npt.NDArray[np.bool_]

FEWEST: Final = 40  #: replicates; with fewer there is no 2.5 % to either side


def shifts(
    optimum: Optimum, noise: Blocks, present: Sequence[BoolArray], numbers: Sequence[int], seed: int
) -> FloatArray:
    """Return what replicates add to the residuals, (B, n_r).

    A replicate's measurements are the fitted curves plus new noise; its priors are read anew, too: a prior is a
    measurement with an error of its own.

    Parameters
    ----------
    optimum : Optimum
    noise : Blocks
    present : sequence of (n_i, ny) bool
        Where something was measured.
    numbers : sequence of int
        Of the replicates: the noise of each depends on its number and `seed` alone.
    seed : int
    """
    samples = sum(mask.size for mask in present)
    out = np.empty((len(numbers), len(optimum.residual)))
    for row, number in zip(out, numbers, strict=True):
        random = np.random.default_rng([seed, number])
        drawn = [np.where(mask, v, 0.0) for v, mask in zip(noise.draw(random), present, strict=True)]
        row[:samples] = np.concatenate([v.ravel() for v in drawn])
        row[samples:] = random.standard_normal(len(row) - samples)
    return np.asarray(-optimum.residual - out)


def replicates(
    optimum: Optimum, noise: Blocks, present: Sequence[BoolArray], numbers: Sequence[int], seed: int
) -> Refits:
    """Return the refits of some replicates; see :func:`shifts`."""
    return refit(optimum, shifts(optimum, noise, present, numbers, seed))


@dataclass(frozen=True, eq=False)
class Percentiles:
    """What the scatter of replicates says; (k,) each.

    Attributes
    ----------
    std : standard deviation of the replicates
    bias : their mean less the estimate
    lower, upper : ends of the 95 % interval
    """

    std: FloatArray
    bias: FloatArray
    lower: FloatArray
    upper: FloatArray


def percentiles(estimate: FloatArray, values: FloatArray) -> Percentiles:
    """Return bias-corrected percentile intervals.

    Parameters
    ----------
    estimate : (k,)
    values : (B, k)
        Of the replicates that arrived.
    """
    nothing = np.full(len(estimate), np.nan)
    if len(values) < FEWEST:
        return Percentiles(nothing, nothing, nothing, nothing)
    below = np.mean(values < estimate, axis=0) + 0.5 * np.mean(values == estimate, axis=0)
    reach = 1.0 / len(values)
    shift = 2.0 * ndtri(np.clip(below, reach, 1.0 - reach))
    columns = range(len(estimate))
    lower = np.array([np.quantile(values[:, i], ndtr(shift[i] - NORMAL_95)) for i in columns])
    upper = np.array([np.quantile(values[:, i], ndtr(shift[i] + NORMAL_95)) for i in columns])
    return Percentiles(values.std(axis=0, ddof=1), values.mean(axis=0) - estimate, lower, upper)


def tally(endings: Sequence[str]) -> dict[str, float]:
    """Return how many replicates there were, and how they ended."""
    count = Counter(endings)
    return {"replicates": float(len(endings)), "dived": float(count["dived"]), "lost": float(count["lost"])}

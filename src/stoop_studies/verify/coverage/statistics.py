"""Coverage, scatter and sharpness of a sample of estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stoop.assess.covariance import NORMAL_95
from stoop.base.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Sample:
    """Estimates of n flights of one case.

    Attributes
    ----------
    names : tuple of str, k
    errors : (n, k)
        Estimate less truth.
    sigma, cramer_rao : (n, k)
        Standard errors corrected for color, and those of white residuals; NaN where there is none.
    unfinished : int
        Searches that did not end with a confirmed optimum.
    """

    names: tuple[str, ...]
    errors: FloatArray
    sigma: FloatArray
    cramer_rao: FloatArray
    unfinished: int

    @property
    def scatter(self) -> FloatArray:
        """Root-mean-square error (k,)."""
        return np.asarray(np.sqrt(np.mean(self.errors**2, axis=0)))

    @property
    def bias(self) -> FloatArray:
        """Mean error in its own standard errors (k,)."""
        return np.asarray(self.errors.mean(axis=0) / (self.errors.std(axis=0) / np.sqrt(len(self.errors))))


def sample(results: Sequence[Mapping[str, Any]]) -> Sample:
    """Return what runs found as arrays."""
    return Sample(
        tuple(results[0]["names"]),
        _array(results, "errors"),
        _array(results, "sigma"),
        _array(results, "cramer_rao"),
        sum(r["status"] not in ("converged", "target") for r in results),
    )


def _array(results: Sequence[Mapping[str, Any]], name: str) -> FloatArray:
    return np.array([[np.nan if v is None else v for v in r[name]] for r in results], dtype=np.float64)


def covered(errors: FloatArray, sigma: FloatArray) -> NDArray[np.bool_]:
    """Return which 95 % intervals (n, k) hold the truth; one that is not given holds nothing."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(errors) <= NORMAL_95 * sigma)


def mean_sigma(sigma: FloatArray) -> FloatArray:
    """Return the mean (k,) of those standard errors (n, k) that are given; NaN where none is."""
    given = np.isfinite(sigma)
    counts = given.sum(axis=0)
    total = np.where(given, sigma, 0.0).sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)


def sharpness(found: Sample, sigma: FloatArray) -> FloatArray:
    """Return mean standard errors over the true scatter (k,): 1 is as it should be, more is wider than needed."""
    return np.asarray(mean_sigma(sigma) / found.scatter)

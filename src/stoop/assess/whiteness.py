"""Are residuals white? The portmanteau test of Ljung and Box, over segments with holes.

    Q = n (n + 2) sum_k r_k^2 / (n - k),  k = 1 ... m

is chi-square with m degrees of freedom for white residuals. Where the record has holes, n - k is the number of
pairs that are there; a lag without any, as between the samples of a slow sensor, is no degree of freedom. The mean is
not taken off: an offset that is left over is not white. A model that leaves colored residuals has not explained
everything, and its plain Cramer-Rao bound is too small.

References
----------
G. M. Ljung and G. E. P. Box, "On a measure of lack of fit in time series models", *Biometrika* 65(2), 1978,
pp. 297-303, eq. (1.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.stats import chi2

from stoop.assess.runs import runs
from stoop.base.arrays import FloatArray
from stoop.estimate.noise import lagged_products
from stoop.results.goodness_of_fit import Whiteness

LAGS: Final = (
    20  #: autocorrelations that are summed: 0.2 s at 100 Hz, the fastest motion that a model explains
)
SHARE: Final = 5  #: samples for each of them at least
LEVEL: Final = 0.05  #: chance of calling white residuals colored


def whiteness(residual: FloatArray) -> Whiteness:
    """Test the residuals (n,) of one channel; NaN where missing and between segments."""
    pieces = [residual[run] for run in runs(np.isfinite(residual))]
    lags = min(LAGS, sum(map(len, pieces)) // SHARE)
    if lags < 1:
        return Whiteness()
    r, pairs = _autocorrelation(residual, lags)
    if not np.isfinite(r).all():
        return Whiteness()
    degrees = int(np.count_nonzero(pairs[1:]))
    if not degrees:
        return Whiteness()
    statistic = ljung_box(r, pairs)
    p_value = float(chi2.sf(statistic, degrees))
    neighbors = float(r[1]) if pairs[1] > 0.0 else float("nan")
    return Whiteness(neighbors, statistic, degrees, p_value, "white" if p_value >= LEVEL else "colored")


def ljung_box(r: FloatArray, pairs: FloatArray) -> float:
    """Return Q of autocorrelations (m + 1,), the first at lag 0, and the numbers of their pairs (m + 1,)."""
    n = float(pairs[0])
    there = pairs[1:] > 0.0
    return n * (n + 2.0) * float(np.sum(r[1:][there] ** 2 / pairs[1:][there]))


def _autocorrelation(residual: FloatArray, lags: int) -> tuple[FloatArray, FloatArray]:
    """Return r_k and the number of its pairs, (lags + 1,) each; segments that a NaN parts still have their time."""
    filled: Sequence[FloatArray] = [np.nan_to_num(_scaled(residual))[:, None]]
    present: Sequence[FloatArray] = [np.isfinite(residual).astype(np.float64)[:, None]]
    sums, pairs = lagged_products(filled, present, lags)
    power = float(sums[0, 0])
    return (sums[0] / power if power > 0.0 else np.full(lags + 1, np.nan)), pairs[0]


def _scaled(residual: FloatArray) -> FloatArray:
    # In parts of the greatest: a simulation that left for infinity may not overflow its square.
    peak = float(np.nanmax(np.abs(residual)))
    return residual / peak if 0.0 < peak < np.inf else residual

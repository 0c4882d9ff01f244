"""Success-history adaptation of the mutation scale and the crossover rate.

References
----------
Tanabe and Fukunaga (2013), Success-history based parameter adaptation for differential evolution, IEEE CEC.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.optimize.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Memory:
    """Scales and rates that worked lately.

    Attributes
    ----------
    scales, rates : (H,)
    slot : which entry is renewed next
    """

    scales: FloatArray
    rates: FloatArray
    slot: int

    def sample(self, number: int, generator: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return a scale (Cauchy, in (0, 1]) and a rate (normal, in [0, 1]) for each parent, (n,) each."""
        entry = (generator.random(number) * len(self.scales)).astype(np.intp)
        rates = np.clip(generator.normal(self.rates[entry], 0.1), 0.0, 1.0)
        scales = self.scales[entry] + 0.1 * generator.standard_cauchy(number)
        while (low := scales <= 0.0).any():
            scales[low] = self.scales[entry][low] + 0.1 * generator.standard_cauchy(int(low.sum()))
        return np.minimum(scales, 1.0), rates

    def learn(self, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray) -> Memory:
        """Return the memory after a generation: Lehmer means of what won, weighted by the gain."""
        if not won.any():
            return self
        weights = _weights(gains[won])
        new_scales, new_rates = self.scales.copy(), self.rates.copy()
        new_scales[self.slot] = _lehmer(scales[won], weights)
        new_rates[self.slot] = _lehmer(rates[won], weights)
        return Memory(new_scales, new_rates, (self.slot + 1) % len(new_scales))


def fresh_memory(entries: int = 6, scale: float = 0.5, rate: float = 0.8) -> Memory:
    """Return a memory that has seen nothing yet."""
    return Memory(np.full(entries, scale), np.full(entries, rate), 0)


def _weights(gains: FloatArray) -> FloatArray:
    """Return shares of the gains; equal shares where a parent was infinite."""
    total = float(gains.sum())
    if np.isfinite(total) and total > 0.0:
        shares: FloatArray = gains / total
        return shares
    return np.full(len(gains), 1.0 / len(gains))


def _lehmer(values: FloatArray, weights: FloatArray) -> float:
    """Return the weighted Lehmer mean of order 2."""
    return float((weights * values**2).sum() / max(float((weights * values).sum()), 1e-12))

"""Success-history adaptation of the mutation scale and the crossover rate.

A memory holds scales and rates that succeeded lately; each parent draws its own near one of them. Between SHADE and
L-SHADE: Lehmer means of scales and rates as in L-SHADE (SHADE averages the rates arithmetically), but no terminal
rate; and rates begin at 0.8 (SHADE and L-SHADE: 0.5), as parameters that act together are better crossed over
together.

References
----------
Tanabe and Fukunaga (2013), Success-history based parameter adaptation for differential evolution, IEEE CEC,
71-78 (SHADE).
Tanabe and Fukunaga (2014), IEEE CEC, 1658-1665 (L-SHADE: the terminal rate, and the Lehmer mean of the rates).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class ParameterMemory:
    """Scales and rates that succeeded lately.

    Attributes
    ----------
    scales, rates : (H,)
        A rate below zero stands for "crossover rate 0 only" (L-SHADE's terminal value).
    slot : which entry is renewed next
    """

    scales: FloatArray
    rates: FloatArray
    slot: int

    @classmethod
    def fresh(cls, entries: int = 6, scale: float = 0.5, rate: float = 0.8) -> ParameterMemory:
        """Return the memory of a population that has not moved yet."""
        return cls(np.full(entries, scale), np.full(entries, rate), 0)

    def sample(self, number: int, generator: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Return a scale (Cauchy, in (0, 1]) and a rate (normal, in [0, 1]) for each parent, (n,) each."""
        entry = (generator.random(number) * len(self.scales)).astype(np.intp)
        means = self.rates[entry]
        rates = np.clip(generator.normal(means, 0.1), 0.0, 1.0)
        rates[means < 0.0] = 0.0
        scales = self.scales[entry] + 0.1 * generator.standard_cauchy(number)
        while (low := scales <= 0.0).any():
            scales[low] = self.scales[entry][low] + 0.1 * generator.standard_cauchy(int(low.sum()))
        return np.minimum(scales, 1.0), rates

    def learn(
        self, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
    ) -> ParameterMemory:
        """Return the memory after a generation: Lehmer means of what won, weighted by the gain; all (n,)."""
        return self.renewed(*success_means(scales, rates, gains, won)) if won.any() else self

    def renewed(self, scale: float, rate: float) -> ParameterMemory:
        """Return the memory with the next entry replaced."""
        scales, rates = self.scales.copy(), self.rates.copy()
        scales[self.slot], rates[self.slot] = scale, rate
        return ParameterMemory(scales, rates, (self.slot + 1) % len(scales))


def success_means(
    scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
) -> tuple[float, float]:
    """Return the Lehmer means of order 2 of the scales and rates that won, weighted by the gains; all (n,).

    Shares are equal where a parent's cost was infinite.
    """
    gained = gains[won]
    total = float(gained.sum())
    weights = (
        gained / total if np.isfinite(total) and total > 0.0 else np.full(len(gained), 1.0 / len(gained))
    )

    def lehmer(values: FloatArray) -> float:
        return float((weights * values**2).sum() / max(float((weights * values).sum()), 1e-12))

    return lehmer(scales[won]), lehmer(rates[won])

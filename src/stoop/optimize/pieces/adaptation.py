"""Success-history adaptation of the mutation scale and the crossover rate.

A memory holds scales and rates that worked lately; each parent draws its own near one of them. SHADE, L-SHADE
and jSO differ in how an entry is renewed only. Ours is between them: Lehmer means of scales and rates as in
L-SHADE (SHADE averages the rates arithmetically), but no terminal rate; and rates begin at 0.8 (SHADE and L-SHADE:
0.5), which is our choice, as parameters that act together want to be crossed over together.

References
----------
Tanabe and Fukunaga (2013), Success-history based parameter adaptation for differential evolution, IEEE CEC,
71-78 (SHADE).
Tanabe and Fukunaga (2014), IEEE CEC, 1658-1665 (L-SHADE: the terminal rate, and the Lehmer mean of the rates).
Brest, Maucec and Boskovic (2017), Single objective real-parameter optimization: algorithm jSO, IEEE CEC,
1311-1318.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray

TERMINAL: Final = -1.0  #: a rate of the memory below zero: only crossover rate 0 works, and stays
FIXED: Final = 0.9  #: scale and rate of the entry that jSO never learns


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
        means = self.rates[entry]
        rates = np.clip(generator.normal(means, 0.1), 0.0, 1.0)
        rates[means < 0.0] = 0.0
        scales = self.scales[entry] + 0.1 * generator.standard_cauchy(number)
        while (low := scales <= 0.0).any():
            scales[low] = self.scales[entry][low] + 0.1 * generator.standard_cauchy(int(low.sum()))
        return np.minimum(scales, 1.0), rates

    def learn(self, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray) -> Memory:
        """Return the memory after a generation: Lehmer means of what won, weighted by the gain."""
        if not won.any():
            return self
        return self.renewed(*successful(scales, rates, gains, won))

    def renewed(self, scale: float, rate: float) -> Memory:
        """Return the memory with the next entry replaced."""
        scales, rates = self.scales.copy(), self.rates.copy()
        scales[self.slot], rates[self.slot] = scale, rate
        return Memory(scales, rates, (self.slot + 1) % len(scales))


def fresh_memory(entries: int = 6, scale: float = 0.5, rate: float = 0.8) -> Memory:
    """Return a memory that has seen nothing yet; beginning at a rate of 0.8 is ours."""
    return Memory(np.full(entries, scale), np.full(entries, rate), 0)


def learn_terminal(
    memory: Memory, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
) -> Memory:
    """Return the memory after a generation of L-SHADE: a rate that has come down to zero stays there."""
    if not won.any():
        return memory
    scale, rate = successful(scales, rates, gains, won)
    ended = memory.rates[memory.slot] < 0.0 or rates[won].max() <= 0.0
    return memory.renewed(scale, TERMINAL if ended else rate)


def learn_halfway(
    memory: Memory, scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
) -> Memory:
    """Return the memory after a generation of jSO: halfway from the old entry to what won.

    The turn of the last entry comes round as any other's, but it stays at 0.9.
    """
    if not won.any():
        return memory
    scale, rate = successful(scales, rates, gains, won)
    rate = rate if rates[won].max() > 0.0 else TERMINAL
    if memory.slot == len(memory.scales) - 1:
        return memory.renewed(FIXED, FIXED)
    old_scale, old_rate = float(memory.scales[memory.slot]), float(memory.rates[memory.slot])
    return memory.renewed(0.5 * (scale + old_scale), 0.5 * (rate + old_rate))


def successful(
    scales: FloatArray, rates: FloatArray, gains: FloatArray, won: BoolArray
) -> tuple[float, float]:
    """Return the Lehmer means of the scales and rates that won, weighted by the gains; all (n,)."""
    weights = _weights(gains[won])
    return _lehmer(scales[won], weights), _lehmer(rates[won], weights)


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

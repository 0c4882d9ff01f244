"""Whether a designed maneuver still does what it should when the model is wrong by as much as it may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stoop.assess.covariance import invert
from stoop.base.arrays import FloatArray
from stoop.design.setup import Setup
from stoop.errors import SimulationError
from stoop.simulate import Maneuver


@dataclass(frozen=True)
class Robustness:
    """What became of a maneuver under models drawn from what is known.

    Attributes
    ----------
    draws : int
    untrimmed : int
        Models that do not fly straight at this speed.
    outside : int
        Flights that left the envelope, those that diverged among them.
    largest_excess : float
        Of those that did not diverge, in widths of the envelope.
    ratios : tuple of float
        Mean standard error over that of the reference maneuver, for each model that stayed inside.
    """

    draws: int
    untrimmed: int
    outside: int
    largest_excess: float
    ratios: tuple[float, ...]


def robustness(setup: Setup, maneuver: Maneuver, reference: Maneuver, draws: int, seed: int) -> Robustness:
    """Fly a maneuver with models drawn from what is known.

    Parameters
    ----------
    setup : Setup
    maneuver, reference : Maneuver
        What was designed, and what it is compared with.
    draws : int
    seed : int

    Notes
    -----
    A direction of which nothing is known is not drawn: the model believes what its file says.
    """
    believed = setup.values
    factor = invert(setup.known).factor * setup.width[:, None]
    noise = np.random.default_rng(seed).standard_normal((draws, factor.shape[1]))
    untrimmed, excesses, ratios = 0, [], []
    for values in believed + noise @ factor.T:
        try:
            other = setup.believing(np.clip(values, setup.lower, setup.lower + setup.width))
        except SimulationError:
            untrimmed += 1
            continue
        told = other.forecast(maneuver, only_inside=True)
        excesses.append(told.excess)
        if told.excess == 0.0:
            ratios.append(mean_ratio(other.std(told), other.std(other.forecast(reference))))
    finite = [e for e in excesses if np.isfinite(e)]
    outside = sum(e > 0.0 for e in excesses)
    return Robustness(draws, untrimmed, outside, max(finite, default=0.0), tuple(ratios))


def mean_ratio(std: FloatArray, reference: FloatArray) -> float:
    """Return the mean of the ratios of two sets of standard errors, over the parameters that both determine."""
    both = np.isfinite(std) & np.isfinite(reference) & (reference > 0.0)
    return float(np.mean(std[both] / reference[both])) if both.any() else float("nan")

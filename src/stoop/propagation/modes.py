"""The modes of many linear models at once, each in the place of the nearest mode of the first."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from stoop.base.arrays import BoolArray, ComplexArray, FloatArray
from stoop.propagation.quantities import Samples
from stoop.simulation.linearize import modes_of

INTEGRATORS: Final = ("psi", "h")  #: states that nothing depends on, or next to nothing
REAL: Final = 1e-9  #: 1/s; a smaller imaginary part is rounding


def mode_samples(A: FloatArray, names: tuple[str, ...]) -> tuple[list[Samples], dict[str, float]]:
    """Return frequency and damping of oscillations, and time constants of the others, and shares of another character.

    `A` (1 + D, n, n) are those of the estimate and of the draws. A draw whose pair has become two real modes has the frequency
    and damping of their product; one whose real mode has joined another is counted.
    """
    keep = [i for i, n in enumerate(names) if n not in INTEGRATORS]
    matrices = A[:, keep][:, :, keep]
    good = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    if not good[0]:
        return [], {}
    values = np.full(matrices.shape[:2], np.nan, dtype=complex)
    values[good] = np.linalg.eigvals(matrices[good])
    base, kept = values[0], np.flatnonzero(good)
    for i in kept:  # each in the place of its nearest
        distance = np.abs(base[:, None] - values[i])
        values[i] = values[i][linear_sum_assignment(distance)[1]]
    out, other = [], {}
    for mode in modes_of(A[0], names):
        if mode.name.endswith(".lag"):
            continue
        s = mode.eigenvalue
        oscillates = abs(s.imag) > REAL
        ends = [s, s.conjugate()] if oscillates else [s]
        drawn = values[:, [int(np.argmin(np.abs(base - one))) for one in ends]]
        changed = oscillation(drawn) != oscillates
        share = float(np.mean(changed[kept]))
        if share > 0.0:
            other[mode.name] = share
        out += _samples(mode.name, drawn, oscillates)
    return out, other


def oscillation(drawn: ComplexArray) -> BoolArray:
    """Tell of which lanes (B, 1 or 2) the eigenvalue is not real."""
    return np.asarray(np.abs(drawn[:, 0].imag) > REAL)


def _samples(name: str, drawn: ComplexArray, oscillates: bool) -> list[Samples]:
    middle = drawn.mean(axis=1).real
    with np.errstate(divide="ignore", invalid="ignore"):
        if oscillates:
            frequency = np.sqrt(np.maximum(np.prod(drawn, axis=1).real, 0.0))
            found = {
                f"{name}, frequency": (frequency, "rad/s"),
                f"{name}, damping": (-middle / frequency, "1"),
            }
        else:  # its inverse passes through infinity where the mode becomes unstable
            found = {f"{name}, eigenvalue": (middle, "1/s")}
            if (middle[np.isfinite(middle)] < 0.0).all():
                found[f"{name}, time constant"] = (-1.0 / middle, "s")
    return [Samples(n, unit, float(v[0]), v[1:]) for n, (v, unit) in found.items()]

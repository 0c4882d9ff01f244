"""The modes of many linear models at once, each in the place of the nearest mode of the first."""

from __future__ import annotations

import numpy as np

from stoop.base.arrays import BoolArray, ComplexArray, FloatArray
from stoop.propagation.quantities import Samples
from stoop.simulation.linearize import INTEGRATORS, REAL, modes_of, tracked_eigenvalues


def mode_samples(A: FloatArray, names: tuple[str, ...]) -> tuple[list[Samples], dict[str, float]]:
    """Return frequency and damping of oscillations, and time constants of the others, and shares of another character.

    `A` (1 + D, n, n) are those of the estimate and of the draws. A draw whose pair has become two real modes has the frequency
    and damping of their product; one whose real mode has joined another is counted.
    """
    keep = [i for i, n in enumerate(names) if n not in INTEGRATORS]
    values, out, other = tracked_eigenvalues(A[:, keep][:, :, keep]), list[Samples](), dict[str, float]()
    kept = np.asarray(np.isfinite(values).all(axis=1))
    if not kept[0]:
        return [], {}
    for mode in modes_of(A[0], names):
        if mode.name.endswith(".lag"):
            continue
        s = mode.eigenvalue
        oscillates = abs(s.imag) > REAL
        ends = [s, s.conjugate()] if oscillates else [s]
        drawn = values[:, [int(np.argmin(np.abs(values[0] - one))) for one in ends]]
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

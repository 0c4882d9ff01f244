"""Which pulses drive rotors: those that turn the vehicle against one another, as motors do and surfaces do not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.variables import OUTPUT_PINS
from stoop.flight.flight import Flight

BLOCK: Final = 0.1  #: s that are taken together; motors follow within that
LEAST: Final = 70  #: blocks that say anything
RUNS: Final = (1050.0, 2500.0)  #: us, in the median; less is idle
FASTEST: Final = 100.0  #: rad/s
ALIKE: Final = 0.25  #: of the usual level over idle, by which motors of one vehicle differ
FOURTH: Final = 4  #: motors, at least, on which nothing but pulses is known
WEAK: Final = 0.04  #: of the strongest direction; weaker ones are drift and whole microseconds
TOLD: Final = 0.03  #: share of what is explained; directions that tell less are left out
EXPLAINS: Final = (
    0.03  #: share of an angular acceleration that motors explain; gusts and vibration are most of it
)
PART: Final = 0.15  #: of the strongest output; less takes no part in turning
BALANCED: Final = 0.15  #: of the sum of sizes: motors that turn a vehicle lift it no more


def rotor_pulses(flight: Flight) -> list[str]:
    """Return the outputs that drive rotors by all that can be seen; none where nothing shows it.

    Four motors or more run at about one level, and turn the vehicle about its roll and its pitch axis by running apart:
    four or more take part in each, and what they add and take away is equal. No set of surfaces does that.
    """
    names = _alike(flight)
    if len(names) < FOURTH or not {"p", "q"} <= {str(name) for name in flight.data.data_vars}:
        return []
    x = _blocks(flight, names, RUNS[1])
    p, q = _blocks(flight, ["p", "q"], FASTEST).T
    return names if _turns(x, p, q) and _turns(x, q, p) else []


def _alike(flight: Flight) -> list[str]:
    """Return the pulses that move at about the level of most of them."""
    columns = {
        f"pwm_{n}": flight.column(f"pwm_{n}") for n in range(1, OUTPUT_PINS + 1) if f"pwm_{n}" in flight.data
    }
    seen = {name: x[np.isfinite(x)] for name, x in columns.items()}
    levels = {name: float(np.median(x)) for name, x in seen.items() if x.size and np.ptp(x) > 0.0}
    running = {name: level for name, level in levels.items() if RUNS[0] < level < RUNS[1]}
    if not running:
        return []
    usual = float(np.median([*running.values()]))
    return [name for name, level in running.items() if abs(level - usual) < ALIKE * (usual - 1000.0)]


def _blocks(flight: Flight, names: Sequence[str], most: float) -> FloatArray:
    """Return means (b, m) of blocks of samples, none beyond what can be."""
    x = np.column_stack([np.clip(flight.column(name), -most, most) for name in names])
    size = max(1, round(BLOCK * flight.rate))
    count = len(x) // size
    return np.asarray(x[: count * size].reshape(count, size, len(names)).mean(axis=1))


def _turns(x: FloatArray, rate: FloatArray, other: FloatArray) -> bool:
    """Tell whether outputs (b, m), running apart, explain how a rate (b,) changes."""
    change = rate[2:] - rate[:-2]
    fixed = np.column_stack([rate[1:-1], other[1:-1], np.ones(len(change))])
    good = np.isfinite(np.column_stack([x[1:-1], fixed, change])).all(axis=1)
    if good.sum() < LEAST:
        return False
    y, moved = (_without(a[good], fixed[good]) for a in (change[:, None], x[1:-1]))
    left, sizes, right = np.linalg.svd(moved, full_matrices=False)
    along = left.T @ y[:, 0]
    kept = (along**2 > TOLD * float(along @ along)) & (sizes > WEAK * sizes[0])
    along, weights = along[kept], (along[kept] / sizes[kept]) @ right[kept]
    size = np.abs(weights)
    return bool(
        kept.any()
        and along @ along > EXPLAINS * float(y[:, 0] @ y[:, 0])
        and (size > PART * size.max()).sum() >= FOURTH
        and abs(weights.sum()) < BALANCED * size.sum()
    )


def _without(x: FloatArray, fixed: FloatArray) -> FloatArray:
    """Take out of columns (b, m) what others (b, k) explain."""
    return np.asarray(x - fixed @ np.linalg.lstsq(fixed, x, rcond=None)[0])

"""Windows of a simulated flight, from the inputs of its maneuver file.

An aircraft is fitted from one start through all its inputs, with its phugoid for a while after the last. A vehicle on
rotors is fitted by short windows that restart, so one input less costs little where others move the same controls: one
is left for validation. Stretches near each other are one window, with one wind and one set of biases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import run_slices
from stoop.simulation.maneuver import Maneuver

BEFORE: Final = 1.0  #: s of the steady flight before an input
AFTER_ON_ROTORS: Final = 1.0  #: s after an input
AFTER_ON_WINGS: Final = 20.0  #: s; a phugoid
MIN_STRETCHES: Final = 3  #: of which one can be left for validation
MAX_GAP: Final = 5.0  #: s of rest between two stretches that are fitted as one window


@dataclass(frozen=True)
class ManeuverWindows:
    """Windows of a flight, as the command line takes them; empty where nothing moves."""

    fit: tuple[str, ...] = ()
    validate: tuple[str, ...] = ()


def maneuver_windows(maneuver: Maneuver, on_rotors: bool) -> ManeuverWindows:
    """Return the stretches in which controls move; the shortest whose controls move elsewhere too is for validation."""
    moves = np.array([signal != 0.0 for signal in maneuver.deflections().values()])
    if not moves.any():
        return ManeuverWindows()
    found = _stretches(maneuver, np.any(moves, axis=0), AFTER_ON_ROTORS if on_rotors else AFTER_ON_WINGS)
    held_out = _held_out(moves, found)
    kept = _joined(found, held_out, round(MAX_GAP * maneuver.rate))
    validate = () if held_out is None else (_text(maneuver, found[held_out]),)
    return ManeuverWindows(tuple(_text(maneuver, one) for one in kept), validate)


def _stretches(maneuver: Maneuver, moving: NDArray[np.bool_], after: float) -> list[slice]:
    """Return where something moves, with what goes before and after; stretches that meet are one."""
    inside = np.zeros(moving.size, dtype=bool)
    for run in run_slices(moving):
        begin = max(run.start - round(BEFORE * maneuver.rate), 0)
        inside[begin : run.stop + round(after * maneuver.rate)] = True
    return run_slices(inside)


def _held_out(moves: NDArray[np.bool_], found: Sequence[slice]) -> int | None:
    """Return the shortest stretch that moves nothing (controls, n) that the others do not."""
    if len(found) < MIN_STRETCHES:
        return None
    moved = np.array([moves[:, one].any(axis=1) for one in found])
    spare = [i for i in range(len(found)) if (moved[i] <= np.delete(moved, i, axis=0).any(axis=0)).all()]
    return min(spare, key=lambda i: found[i].stop - found[i].start, default=None)


def _joined(found: Sequence[slice], held_out: int | None, near: int) -> list[slice]:
    """Return the stretches that are fitted, those near each other as one."""
    out: list[slice] = []
    before = -1
    for i, one in enumerate(found):
        if i == held_out:
            continue
        if out and before == i - 1 and one.start - out[-1].stop <= near:
            out[-1] = slice(out[-1].start, one.stop)
        else:
            out.append(one)
        before = i
    return out


def _text(maneuver: Maneuver, one: slice) -> str:
    time = maneuver.time
    start, stop = time[one.start], time[min(one.stop, time.size - 1)]
    return f"{round(float(start), 2):g}:{round(float(stop), 2):g}"

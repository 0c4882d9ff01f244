"""Controls against angular accelerations: each surface, or command, turns the vehicle about its axis the right way."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray, runs
from stoop.base.variables import RATES
from stoop.checks.engine import Evidence, Key, Residual, Residuals
from stoop.checks.kinematics import Columns
from stoop.checks.lines import Assignment, reading

#: axis -> rate that a control changes, and the controls with the sign of that by `base.variables`; 0: either
EFFECTS: Final = {
    "roll": ("p", (("aileron", 0.0), ("control_roll", 1.0))),
    "pitch": ("q", (("elevator", -1.0), ("control_pitch", 1.0))),
    "yaw": ("r", (("rudder", -1.0), ("control_yaw", 1.0))),
}
BESIDE: Final = (*RATES, "ay", "az")  #: what turns the vehicle as well, by damping and by stability


@dataclass(frozen=True)
class ControlLimits:
    """How controls and angular accelerations are compared."""

    rate: float = 25.0  #: Hz
    band: tuple[float, float] = (0.3, 5.0)  #: Hz: slower is the air's doing, quicker is noise
    order: int = 2  #: of the Butterworth filter, which runs forward and backward
    stretch: float = 3.0  #: s without a hole, at least
    motion: float = 0.05  #: rad/s2 rms; less is no motion
    delay: float = 0.06  #: s, usual lag of a servo: that of the angular acceleration behind the command


LIMITS: Final = ControlLimits()


class Controls:
    """The residuals of angular accelerations of columns at one rate [Hz]."""

    def __init__(self, data: Columns, rate: float) -> None:
        there = data.keys()
        self.axes = {
            axis: names
            for axis, (turn, controls) in EFFECTS.items()
            if turn in there and (names := tuple((n, s) for n, s in controls if n in there))
        }
        moved = {name for known in self.axes.values() for name, _ in known}
        self.beside = [name for name in BESIDE if name in there] if moved else []
        self.columns: dict[str, FloatArray] = {}
        self.slopes: dict[str, FloatArray] = {}
        self.rate = rate
        if moved:
            self._filter(data, rate, sorted(moved))

    def __call__(self, state: Assignment, changed: Collection[str] | None) -> Residuals:
        """Return what controls leave of the acceleration about each axis, where some of those that changed take part."""
        out: dict[Key, Evidence] = {}
        for axis, controls in self.axes.items() if self.columns else ():
            turn = EFFECTS[axis][0]
            if changed is not None and not {turn, *(name for name, _ in controls)} & set(changed):
                continue
            beside = np.column_stack([self._column(state, name) for name in self.beside])
            column, factor = reading(state, turn)
            left = _apart(factor * self.slopes[column], beside)
            size = left
            for name, sign in controls:
                x = _apart(self._column(state, name), beside)
                power = float(x @ x)
                gain = float(x @ left) / power if power > 1e-12 else 0.0
                left = left - (gain if gain * sign >= 0.0 else 0.0) * x
            low, high = LIMITS.band
            out["moment", axis] = Residual(left, size, self.rate / (2.0 * (high - low)), LIMITS.motion**2)
        return out

    def scales(self, state: Assignment) -> dict[str, float]:
        """Return nothing: no effect of a control is known beforehand."""
        return {}

    def _column(self, state: Assignment, name: str) -> FloatArray:
        column, factor = reading(state, name)
        return factor * self.columns[column]

    def _filter(self, data: Columns, rate: float, names: list[str]) -> None:
        """Band-pass controls, rates and forces alike, stretch by stretch; the controls late as servos are."""
        from scipy.signal import butter, sosfiltfilt

        if rate <= 2.0 * LIMITS.band[1]:
            return
        every = [*self.beside, *names]
        table = np.column_stack([data[name] for name in every])
        sos = butter(LIMITS.order, LIMITS.band, "bandpass", fs=rate, output="sos")
        step, late = max(1, int(rate / LIMITS.rate)), round(LIMITS.delay * rate)
        parts, slopes = [], []
        for start, stop in runs(np.asarray(np.isfinite(table).all(axis=1))):
            if stop - start < LIMITS.stretch * rate:
                continue
            slow = sosfiltfilt(sos, table[start:stop], axis=0)
            turn = slow[:, [every.index(name) for name in RATES if name in every]]
            slow[late:, len(self.beside) :] = slow[: slow.shape[0] - late, len(self.beside) :]
            parts.append(slow[late::step])
            slopes.append(np.gradient(turn, 1.0 / rate, axis=0)[late::step])
        if parts:
            self.columns = dict(zip(every, np.concatenate(parts).T, strict=True))
            rates = [name for name in RATES if name in every]
            self.slopes = dict(zip(rates, np.concatenate(slopes).T, strict=True))
        self.rate = rate / step


def _apart(y: FloatArray, beside: FloatArray) -> FloatArray:
    """Return what is left of a column (n,) beside others (n, k)."""
    return np.asarray(y - beside @ np.linalg.lstsq(beside, y, rcond=None)[0])

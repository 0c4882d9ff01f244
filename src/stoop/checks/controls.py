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


@dataclass(frozen=True)
class ControlLimits:
    """How controls and angular accelerations are compared."""

    rate: float = 25.0  #: Hz
    band: tuple[float, float] = (1.0, 5.0)  #: Hz: slower the vehicle has answered already, quicker is noise
    order: int = 2  #: of the Butterworth filter, which runs forward and backward
    stretch: float = 3.0  #: s without a hole, at least
    motion: float = 0.05  #: rad/s2 rms; less is no motion
    #: of the largest rms of a control over a second; where all move less, nothing is compared
    active: float = 0.3
    still: float = 1e-12  #: sum of squares of a column, any unit, that does not move
    delays: tuple[float, ...] = (0.0, 0.04, 0.08)  #: s, of servos; the one that fits best is taken


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
        self.beside = [name for name in RATES if name in there] if moved else []
        self.columns: dict[str, FloatArray] = {}
        self.slopes: dict[str, FloatArray] = {}
        self.turned = np.empty((0, 0))  #: (n, k), the rates that move
        self.late: list[dict[str, FloatArray]] = []
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
            column, factor = reading(state, turn)
            moved = {reading(state, name)[0] for name, _ in controls}
            if column not in self.slopes or not moved <= self.columns.keys():
                continue  # an edit took a column that no axis answers
            turning = self._apart(factor * self.slopes[column])
            tried = (self._left(state, turning, controls, late) for late in range(len(LIMITS.delays)))
            left = min(tried, key=lambda x: float(x @ x))
            low, high = LIMITS.band
            out["moment", axis] = Residual(left, turning, self.rate / (2.0 * (high - low)), LIMITS.motion**2)
        return out

    def _left(
        self, state: Assignment, left: FloatArray, controls: tuple[tuple[str, float], ...], late: int
    ) -> FloatArray:
        """Return what controls, each with an effect of its sign, leave of an acceleration (n,)."""
        for name, sign in controls:
            column, factor = reading(state, name)
            x = self._apart(factor * self.late[late][column])
            power = float(x @ x)
            gain = float(x @ left) / power if power > LIMITS.still else 0.0
            left = left - (gain if gain * sign >= 0.0 else 0.0) * x
        return left

    def scales(self, state: Assignment) -> dict[tuple[str, ...], float]:
        """Return nothing: no effect of a control is known beforehand."""
        return {}

    def _filter(self, data: Columns, rate: float, names: list[str]) -> None:
        """Band-pass controls, rates and forces alike, stretch by stretch, and keep the time in which controls move."""
        from scipy.signal import butter, sosfiltfilt

        if rate <= 2.0 * LIMITS.band[1]:
            return
        every = [*self.beside, *names]
        table = np.column_stack([data[name] for name in every])
        sos = butter(LIMITS.order, LIMITS.band, "bandpass", fs=rate, output="sos")
        step, delays = max(1, int(rate / LIMITS.rate)), [round(x * rate) for x in LIMITS.delays]
        parts: list[list[FloatArray]] = []
        for start, stop in runs(np.asarray(np.isfinite(table).all(axis=1))):
            if stop - start < LIMITS.stretch * rate:
                continue
            slow = sosfiltfilt(sos, table[start:stop], axis=0)
            turn = np.gradient(slow[:, : len(self.beside)], 1.0 / rate, axis=0)
            late = [np.roll(slow[:, len(self.beside) :], delay, axis=0) for delay in delays]
            parts.append([x[max(delays) :: step] for x in (slow, turn, *late)])
        self.rate = rate / step
        if parts:
            slow, turn, *late = (np.concatenate(own) for own in zip(*parts, strict=True))
            second = np.ones(round(self.rate))
            power = np.apply_along_axis(np.convolve, 0, late[0] ** 2, second, "same")
            busy = (power > LIMITS.active**2 * np.maximum(power.max(axis=0), LIMITS.still)).any(axis=1)
            self.columns = dict(zip(every, slow[busy].T, strict=True))
            self.slopes = dict(zip(self.beside, turn[busy].T, strict=True))
            turned = np.column_stack([self.columns[name] for name in self.beside])
            self.turned = turned[:, np.sum(turned**2, axis=0) > LIMITS.still]
            self.late = [dict(zip(names, x[busy].T, strict=True)) for x in late]

    def _apart(self, y: FloatArray) -> FloatArray:
        """Return what is left of a column (n,) beside the rates."""
        return np.asarray(y - self.turned @ np.linalg.lstsq(self.turned, y, rcond=None)[0])

"""Controls against angular accelerations: each surface, or command, turns the vehicle about its axis the right way.

Rates, flow angles and specific forces are regressors beside the controls; no effect of theirs is prescribed.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray, run_slices
from stoop.extend.variables import EFFECTS
from stoop_draft.checks.engine import Evidence, Key, Residual, Residuals
from stoop_draft.checks.kinematics import Columns
from stoop_draft.checks.lines import RATES, Assignment, reading

#: of what moments depend on besides rates and controls, or readings that follow it (Klein and Morelli, section 5.1)
FLOW: Final = ("alpha", "beta", "ay", "az")


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
    #: s, of servos and radio links, and before zero of loggers that write late; the one that fits best is taken, as a delay of
    #: half a swing turns the sign of an effect
    delays: tuple[float, ...] = tuple(0.04 * k for k in range(-5, 13))
    present: float = 0.9  #: share of the samples in which a reading of the air must be there to be taken off


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
        self.air = [
            name for name in FLOW if name in there and np.isfinite(data[name]).mean() > LIMITS.present
        ]
        self.columns: dict[str, FloatArray] = {}
        #: what rates and flow leave of angular accelerations, and of controls by each delay
        self.slopes: dict[str, FloatArray] = {}
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
            turning = factor * self.slopes[column]
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
            x = factor * self.late[late][column]
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
        every = [*self.beside, *names, *self.air]
        table = np.column_stack([data[name] for name in every])
        sos = butter(LIMITS.order, LIMITS.band, "bandpass", fs=rate, output="sos")
        step, delays = max(1, int(rate / LIMITS.rate)), [round(x * rate) for x in LIMITS.delays]
        parts: list[list[FloatArray]] = []
        for run in run_slices(np.asarray(np.isfinite(table).all(axis=1))):
            if run.stop - run.start < LIMITS.stretch * rate:
                continue
            slow = sosfiltfilt(sos, table[run], axis=0)
            turn = np.gradient(slow[:, : len(self.beside)], 1.0 / rate, axis=0)
            own = slow[:, len(self.beside) : len(self.beside) + len(names)]
            late = [np.roll(own, delay, axis=0) for delay in delays]
            edge = max(map(abs, delays))
            parts.append([x[edge : len(x) - edge : step] for x in (slow, turn, *late)])
        self.rate = rate / step
        if parts:
            slow, turn, *late = (np.concatenate(own) for own in zip(*parts, strict=True))
            second = np.ones(round(self.rate))
            now = late[delays.index(0)]
            power = np.apply_along_axis(np.convolve, 0, now**2, second, "same")
            busy = (power > LIMITS.active**2 * np.maximum(power.max(axis=0), LIMITS.still)).any(axis=1)
            self.columns = dict(zip(every, slow[busy].T, strict=True))
            known = np.column_stack([self.columns[name] for name in (*self.beside, *self.air)])
            motion = np.linalg.qr(known[:, np.sum(known**2, axis=0) > LIMITS.still])[0]
            turn, *late = (x[busy] - motion @ (motion.T @ x[busy]) for x in (turn, *late))
            self.slopes = dict(zip(self.beside, turn.T, strict=True))
            self.late = [dict(zip(names, x.T, strict=True)) for x in late]

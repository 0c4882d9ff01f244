"""Families of inputs, from points of a unit box to the tables of a maneuver file.

Amplitude and slew hold by construction; the envelope is for the search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.optimize import brentq

from stoop.base.arrays import FloatArray, IntArray
from stoop.errors import SimulationError
from stoop.simulation.maneuver import PATTERNS, Harmonics, Input, Levels, Steps

LEAD: Final = 0.5  #: s of steady flight before and after the inputs
SLEW_SHARE: Final = 0.999  #: of the slew that is used, against rounding
MIN_AMPLITUDE: Final = 0.2  #: of the allowed amplitude


@dataclass(frozen=True)
class Frame:
    """Limits and times that all families of inputs share.

    Amplitude by control, rad; slew rate, rad/s; duration of the whole maneuver, s; highest frequency of a multisine, Hz;
    shortest step, s.
    """

    amplitude: dict[str, float]
    slew: float
    duration: float
    band: float
    shortest: float

    @property
    def active(self) -> float:
        """Seconds in which there are inputs."""
        return self.duration - 2.0 * LEAD

    def reached(self, amplitude: float, longest: float) -> float:
        """Return the amplitude, or what a slow surface can turn round within the longest step, s."""
        return min(amplitude, SLEW_SHARE * 0.5 * self.slew * longest)

    def least(self, amplitude: float) -> float:
        """Return the shortest step, s, in which a surface gets from one side to the other."""
        return max(self.shortest, 2.0 * abs(amplitude) / self.slew)


@dataclass(frozen=True)
class StepInputs:
    """One row of steps on every control: when it begins, how long its shortest step is, how large it is."""

    frame: Frame
    pattern: str

    @property
    def dimension(self) -> int:
        """Three for each control: begin, step, amplitude with its sign."""
        return 3 * len(self.frame.amplitude)

    @property
    def starts(self) -> FloatArray:
        """One control after the other, in the time that there is, with long and with short steps."""
        frame, count, units, longest = self.frame, len(self.frame.amplitude), self._units, self._longest
        least = frame.least(frame.reached(max(frame.amplitude.values()), longest))
        rows = []
        for share in (1.0, 0.5):
            step = share * frame.active / count / units
            room = frame.active - units * step
            for i in range(count):
                begin = i * frame.active / count / room if room > 0.0 else 0.0
                rows.append(np.clip([begin, (step - least) / (longest - least), 1.0], 0.0, 1.0))
        return np.array(rows).reshape(2, -1)

    def inputs(self, x: FloatArray) -> tuple[Input, ...]:
        """Return one table per control."""
        frame, units, longest, out = self.frame, self._units, self._longest, []
        for (control, most), point in zip(frame.amplitude.items(), x.reshape(-1, 3), strict=True):
            signed = 2.0 * float(point[2]) - 1.0
            size = frame.reached(most * max(MIN_AMPLITUDE, abs(signed)), longest)
            least = frame.least(size)
            step = least + float(point[1]) * (longest - least)
            begin = LEAD + float(point[0]) * (frame.active - units * step)
            table = {
                "control": control, "shape": self.pattern, "start": begin, "step": step,
                "amplitude": float(np.copysign(size, signed)), "slew": frame.slew,
            }  # fmt: skip
            out.append(Steps.model_validate(table))
        return tuple(out)

    @property
    def _units(self) -> int:
        return sum(PATTERNS[self.pattern])

    @property
    def _longest(self) -> float:
        """Longest step, s: the row then fills the whole time."""
        return self.frame.active / self._units


@dataclass(frozen=True)
class SquareWaves:
    """Square waves on all controls at once: levels of alternating sign whose lengths are free.

    Where amplitude is what is limited, optimal inputs go from one limit to the other (V. Klein, E. A. Morelli,
    *Aircraft System Identification*, 2nd ed., section 9.5); the length of each level is what there is to choose.
    """

    frame: Frame
    levels: int = 10

    @property
    def dimension(self) -> int:
        """Amplitude with its sign, and the length of each level, for every control."""
        return (1 + self.levels) * len(self.frame.amplitude)

    @property
    def starts(self) -> FloatArray:
        """Equal lengths; lengths that fall as those of a 3-2-1-1, ever and again."""
        even = [1.0, *([0.5] * self.levels)]
        falling = [1.0, *((3.0, 2.0, 1.0, 1.0)[i % 4] / 3.0 for i in range(self.levels))]
        return np.array([row * len(self.frame.amplitude) for row in (even, falling)])

    def inputs(self, x: FloatArray) -> tuple[Input, ...]:
        """Return one table per control."""
        frame, out = self.frame, []
        signs = (-1.0) ** np.arange(self.levels)
        rows = x.reshape(-1, 1 + self.levels)
        for (control, most), point in zip(frame.amplitude.items(), rows, strict=True):
            signed = 2.0 * float(point[0]) - 1.0
            size = frame.reached(most * max(MIN_AMPLITUDE, abs(signed)), frame.active / self.levels)
            amplitude, least = float(np.copysign(size, signed)), frame.least(size)
            shares = (0.01 + point[1:]) / np.sum(0.01 + point[1:])
            lengths = least + shares * (frame.active - self.levels * least)
            table = {
                "control": control, "shape": "levels", "start": LEAD, "slew": frame.slew,
                "levels": (amplitude * signs).tolist(), "lengths": lengths.tolist(),
            }  # fmt: skip
            out.append(Levels.model_validate(table))
        return tuple(out)


@dataclass(frozen=True)
class Multisines:
    """Multisines on all controls at once, orthogonal: control i of n has the harmonics i, i + n, ...

    Amplitude and phase of each harmonic are free. The sum is brought to the amplitude that is allowed, less where
    it would be faster than the surfaces are.
    """

    frame: Frame

    @property
    def dimension(self) -> int:
        """Share of the amplitude for each control, amplitude and phase for each harmonic."""
        return sum(1 + 2 * len(k) for k in self._harmonics)

    @property
    def starts(self) -> FloatArray:
        """Equal power with Schroeder's phases, at full and half amplitude; power falling with frequency.

        M. R. Schroeder, "Synthesis of low-peak-factor signals", IEEE Trans. Inf. Theory 16(1), 1970, eq. (11).
        """
        rows = []
        for share, fall in ((1.0, 0.0), (0.5, 0.0), (1.0, 1.0)):
            row: list[float] = []
            for harmonics in self._harmonics:
                k, count = np.arange(len(harmonics)), len(harmonics)
                phases = np.mod(-k * (k + 1) / (2.0 * count), 1.0)
                weights = (harmonics / harmonics[0]) ** -fall
                row += [(share - MIN_AMPLITUDE) / (1.0 - MIN_AMPLITUDE), *weights, *phases]
            rows.append(row)
        return np.array(rows)

    def inputs(self, x: FloatArray) -> tuple[Input, ...]:
        """Return one table per control."""
        out, first = [], 0
        for (control, most), harmonics in zip(self.frame.amplitude.items(), self._harmonics, strict=True):
            count = len(harmonics)
            point = x[first : first + 1 + 2 * count]
            first += len(point)
            weights, phases = point[1 : 1 + count], 2.0 * np.pi * point[1 + count :]
            phases = _from_zero(harmonics, weights, phases)
            tau = np.arange(16 * int(harmonics[-1])) / (16 * int(harmonics[-1]))  # one period
            angles = 2.0 * np.pi * np.outer(tau, harmonics) + phases
            rates = 2.0 * np.pi / self.frame.active * harmonics * weights
            peak = float(np.abs(np.sin(angles) @ weights).max())
            speed = max(float(np.abs(np.cos(angles) @ rates).max()), 1e-12)
            share = MIN_AMPLITUDE + (1.0 - MIN_AMPLITUDE) * float(point[0])
            scale = min(share * most / peak, self.frame.slew / speed) if peak > 0.0 else 0.0
            table = {
                "control": control, "shape": "harmonics", "start": LEAD, "duration": self.frame.active,
                "harmonics": harmonics.tolist(), "amplitudes": (scale * weights).tolist(), "phases": phases.tolist(),
            }  # fmt: skip
            out.append(Harmonics.model_validate(table))
        return tuple(out)

    @cached_property
    def _harmonics(self) -> list[IntArray]:
        count, most = len(self.frame.amplitude), int(self.frame.band * self.frame.active)
        if most < count:
            raise SimulationError(
                f"design: {self.frame.active:g} s and {self.frame.band:g} Hz leave no harmonic for every control; "
                "design for longer, or with a higher band"
            )
        return [np.arange(i + 1, most + 1, count) for i in range(count)]


def _from_zero(harmonics: IntArray, weights: FloatArray, phases: FloatArray) -> FloatArray:
    """Return the phases of the same sum begun where it is zero: nothing jumps when it begins or ends."""

    def at(angle: float) -> float:
        return float(np.sin(harmonics * angle + phases) @ weights)

    count = 16 * int(harmonics[-1])
    angles = 2.0 * np.pi * np.arange(count + 1) / count
    values = np.sin(np.outer(angles, harmonics) + phases) @ weights
    i = int(np.argmax(values[:-1] * values[1:] <= 0.0))  # its mean is zero, so it changes sign
    crossed = at(angles[i]) * at(angles[i + 1]) < 0.0
    nearest = angles[i + int(np.argmin(np.abs(values[i : i + 2])))]
    begin = brentq(at, angles[i], angles[i + 1], xtol=1e-13) if crossed else nearest
    return np.asarray(np.mod(phases + harmonics * begin, 2.0 * np.pi))


#: a family of inputs: its dimension, guesses ``starts`` (k, dimension) of what one would fly without a design, and the tables
#: of a maneuver file, ``inputs(x)``, for a point of the unit box
Shape = StepInputs | SquareWaves | Multisines
SHAPES: Final[dict[str, Callable[[Frame], Shape]]] = {
    "multisine": Multisines,
    "square": SquareWaves,
    "3-2-1-1": lambda frame: StepInputs(frame, "3-2-1-1"),
    "doublet": lambda frame: StepInputs(frame, "doublet"),
}

"""Families of inputs, from points of a unit box to the tables of a maneuver file.

Amplitude and slew hold by construction; the envelope is for the search.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from scipy.optimize import brentq

from stoop.extend.arrays import FloatArray, IntArray
from stoop.extend.errors import SimulationError
from stoop.extend.motion import Maneuver, Steps

Table = dict[str, Any]  #: of an input in a maneuver file
LEAD: Final = 0.5  #: s of steady flight before and after the inputs
SLEW_SHARE: Final = 0.999  #: of the slew that is used, against rounding
MOST_COUNTS: Final = 4  #: of one step that is counted aloud (our choice); longer ones leave the trim
MIN_AMPLITUDE: Final = 0.2  #: of the allowed amplitude
STEADY: Final = 1.0  #: s of steady flight before a pilot begins to count
HANDS_OFF: Final = 3.0  #: s after a maneuver by hand, in which the motion decays
STICK_STEP: Final = math.radians(0.5)  #: to which the amplitude of a stop is set


@dataclass(frozen=True)
class Frame:
    """Limits and times that all families of inputs share.

    Amplitude by control, rad (on rotors the unit of the command); slew rate by control, rad/s, of those that have one; duration
    of the whole maneuver, s; highest frequency of a multisine or a sweep, Hz; shortest step, s; smallest amplitude by
    control; beat that is counted aloud, s, where a pilot flies the steps.
    """

    amplitude: Mapping[str, float]
    slew: Mapping[str, float]
    duration: float
    band: float
    shortest: float
    min_amplitude: Mapping[str, float] = field(default_factory=dict)
    beat: float | None = None

    @property
    def active(self) -> float:
        """Seconds in which there are inputs."""
        return self.duration - 2.0 * LEAD

    def size(self, control: str, share: float, longest: float) -> float:
        """Return a share of the amplitude, not below the smallest, or what a slow surface gets within the longest step, s."""
        most = self.amplitude[control]
        wanted = max(most * max(MIN_AMPLITUDE, share), self.min_amplitude.get(control, 0.0))
        return min(wanted, SLEW_SHARE * 0.5 * self.rate(control) * longest)

    def least(self, control: str, amplitude: float) -> float:
        """Return the shortest step, s, in which a control gets from one side to the other."""
        return max(self.shortest, 2.0 * abs(amplitude) / self.rate(control))

    def rate(self, control: str) -> float:
        """Return the slew rate of a control, infinite where it has none."""
        return self.slew.get(control, math.inf)

    def limited(self, control: str) -> dict[str, float]:
        """Return the entry ``slew`` of an input table."""
        return {"slew": self.slew[control]} if control in self.slew else {}


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
        rows = []
        for share in (1.0, 0.5):
            step = share * frame.active / count / units
            room = frame.active - units * step
            for i, control in enumerate(frame.amplitude):
                least = frame.least(control, frame.size(control, 1.0, longest))
                begin = i * frame.active / count / room if room > 0.0 else 0.0
                rows.append(np.clip([begin, (step - least) / (longest - least), 1.0], 0.0, 1.0))
        return np.array(rows).reshape(2, -1)

    def inputs(self, x: FloatArray) -> tuple[Table, ...]:
        """Return one table per control."""
        frame, units, longest, out = self.frame, self._units, self._longest, []
        for control, point in zip(frame.amplitude, x.reshape(-1, 3), strict=True):
            signed = 2.0 * float(point[2]) - 1.0
            size = frame.size(control, abs(signed), longest)
            least = frame.least(control, size)
            step = least + float(point[1]) * (longest - least)
            begin = LEAD + float(point[0]) * (frame.active - units * step)
            table = {
                "control": control, "shape": self.pattern, "start": begin, "step": step,
                "amplitude": float(np.copysign(size, signed)), **frame.limited(control),
            }  # fmt: skip
            out.append(table)
        return tuple(out)

    @property
    def _units(self) -> int:
        return sum(Steps.PATTERNS[self.pattern])

    @property
    def _longest(self) -> float:
        """Longest step, s: the row then fills the whole time."""
        return self.frame.active / self._units


@dataclass(frozen=True)
class CountedSteps:
    """Steps by hand: one control after the other, on a beat that is counted aloud, then hands off."""

    frame: Frame
    pattern: str
    beat: float

    @property
    def dimension(self) -> int:
        """Two for each control: counts of a step, amplitude with its sign."""
        return 2 * len(self.frame.amplitude)

    @property
    def starts(self) -> FloatArray:
        """Full amplitude, with steps as long as the time allows and of one count."""
        return np.array([[share, 1.0] * len(self.frame.amplitude) for share in (1.0, 0.0)])

    def inputs(self, x: FloatArray) -> tuple[Table, ...]:
        """Return one table per control, whose edges fall on the beat."""
        frame, out = self.frame, []
        for i, (control, point) in enumerate(zip(frame.amplitude, x.reshape(-1, 2), strict=True)):
            signed = 2.0 * float(point[1]) - 1.0
            size = self._readable(control, frame.size(control, abs(signed), self._most * self.beat))
            fewest = min(math.ceil(frame.least(control, size) / self.beat - 1e-9), self._most)
            counts = min(fewest + int(float(point[0]) * (self._most - fewest + 1)), self._most)
            table = {
                "control": control, "shape": self.pattern, "start": self.beat * (self._first + i * self._slot),
                "step": self.beat * counts, "amplitude": float(np.copysign(size, signed)), **frame.limited(control),
            }  # fmt: skip
            out.append(table)
        return tuple(out)

    def _readable(self, control: str, size: float) -> float:
        """Return an amplitude of the half degrees that a card names, or on rotors one as it is."""
        if Maneuver.unit_of(control) != "rad":
            return size
        floor, most = self.frame.min_amplitude.get(control, 0.0), self.frame.amplitude[control]
        steps = max(math.floor(size / STICK_STEP + 1e-9), math.ceil(floor / STICK_STEP - 1e-9), 1)
        return STICK_STEP * steps if STICK_STEP * steps <= most else size

    @property
    def _first(self) -> int:
        """Counts before the first input."""
        return math.ceil(STEADY / self.beat - 1e-9)

    @cached_property
    def _slot(self) -> int:
        """Counts from one control to the next."""
        return int((self.frame.duration / self.beat - self._first + 1e-9) // len(self.frame.amplitude))

    @cached_property
    def _most(self) -> int:
        """Counts of the longest step."""
        units, rest = sum(Steps.PATTERNS[self.pattern]), math.ceil(HANDS_OFF / self.beat - 1e-9)
        most = min((self._slot - rest) // units, MOST_COUNTS)
        if most < 1:
            count = len(self.frame.amplitude)
            least = self.beat * (self._first + count * (units + rest))
            raise SimulationError(
                f"design: a {self.pattern} on {count} controls by a beat of {self.beat:g} s takes {least:g} s at least; design "
                "for longer, with a shorter beat, or for fewer controls (an amplitude of 0 leaves one alone)"
            )
        return most


@dataclass(frozen=True)
class Sweeps:
    """Frequency sweeps on one control after the other: amplitude, first and last frequency of each."""

    frame: Frame

    @property
    def dimension(self) -> int:
        """Three for each control."""
        return 3 * len(self.frame.amplitude)

    @property
    def starts(self) -> FloatArray:
        """Full amplitude, from the lowest to the highest frequency, and to half of it in logarithms."""
        return np.array([[1.0, 0.0, last] * len(self.frame.amplitude) for last in (1.0, 0.5)])

    def inputs(self, x: FloatArray) -> tuple[Table, ...]:
        """Return one table per control."""
        frame, out = self.frame, []
        length = frame.active / len(frame.amplitude) - LEAD
        # the constant frequency at the beginning takes two periods, and a third of the sweep at most
        lowest, highest = 6.0 / length if length > 0.0 else math.inf, frame.band
        if not 2.0 * lowest <= highest:
            raise SimulationError(
                f"design: sweeps of {max(length, 0.0):.3g} s do not reach from {lowest:.3g} Hz to twice that within a band of "
                f"{highest:g} Hz; design for longer, with a higher band, or for fewer controls (--amplitude CONTROL=0)"
            )
        for i, (control, point) in enumerate(zip(frame.amplitude, x.reshape(-1, 3), strict=True)):
            low = lowest * (highest / lowest / 2.0) ** float(point[1])
            top = 2.0 * low * (highest / low / 2.0) ** float(point[2])
            fastest = frame.rate(control) / (2.0 * np.pi * top)
            size = min(frame.size(control, float(point[0]), math.inf), fastest)
            table = {
                "control": control, "shape": "sweep", "start": LEAD + i * (length + LEAD), "duration": length,
                "amplitude": size, "low": low, "band": top, "fade": min(1.0, 0.1 * length),
            }  # fmt: skip
            out.append(table)
        return tuple(out)


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

    def inputs(self, x: FloatArray) -> tuple[Table, ...]:
        """Return one table per control."""
        frame, out = self.frame, []
        signs = (-1.0) ** np.arange(self.levels)
        rows = x.reshape(-1, 1 + self.levels)
        for control, point in zip(frame.amplitude, rows, strict=True):
            signed = 2.0 * float(point[0]) - 1.0
            size = frame.size(control, abs(signed), frame.active / self.levels)
            amplitude, least = float(np.copysign(size, signed)), frame.least(control, size)
            shares = (0.01 + point[1:]) / np.sum(0.01 + point[1:])
            lengths = least + shares * (frame.active - self.levels * least)
            table = {
                "control": control, "shape": "levels", "start": LEAD, **frame.limited(control),
                "levels": (amplitude * signs).tolist(), "lengths": lengths.tolist(),
            }  # fmt: skip
            out.append(table)
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

    def inputs(self, x: FloatArray) -> tuple[Table, ...]:
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
            size = max(share * most, self.frame.min_amplitude.get(control, 0.0))
            scale = min(size / peak, self.frame.rate(control) / speed) if peak > 0.0 else 0.0
            table = {
                "control": control, "shape": "harmonics", "start": LEAD, "duration": self.frame.active,
                "harmonics": harmonics.tolist(), "amplitudes": (scale * weights).tolist(), "phases": phases.tolist(),
            }  # fmt: skip
            out.append(table)
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


def _steps(pattern: str) -> Callable[[Frame], Shape]:
    return lambda frame: (
        StepInputs(frame, pattern) if frame.beat is None else CountedSteps(frame, pattern, frame.beat)
    )


#: a family of inputs: its dimension, guesses ``starts`` (k, dimension) of what one would fly without a design, and the tables
#: of a maneuver file, ``inputs(x)``, for a point of the unit box
Shape = StepInputs | CountedSteps | SquareWaves | Multisines | Sweeps
SHAPES: Final[dict[str, Callable[[Frame], Shape]]] = {
    "multisine": Multisines,
    "square": SquareWaves,
    "3-2-1-1": _steps("3-2-1-1"),
    "doublet": _steps("doublet"),
    "2-1-1": _steps("2-1-1"),
    "sweep": Sweeps,
}
USUAL_SHAPES: Final = ("multisine", "square", "3-2-1-1", "doublet")  #: that are tried where none is named
COUNTED_SHAPES: Final = ("3-2-1-1", "2-1-1", "doublet")  #: that a pilot can fly

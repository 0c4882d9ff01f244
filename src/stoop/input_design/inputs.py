"""Families of inputs, from points of a unit box to the tables of a maneuver file.

Amplitude and slew hold by construction; the envelope is for the search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from stoop.base.arrays import FloatArray
from stoop.errors import SimulationError
from stoop.simulation.maneuver import PATTERNS, Harmonics, Input, Levels, Steps

LEAD: Final = 0.5  #: s of steady flight before and after the inputs
SLEW_SHARE: Final = 0.999  #: of the slew that is used, against rounding
MIN_AMPLITUDE: Final = 0.2  #: of the allowed amplitude


@dataclass(frozen=True)
class Frame:
    """Limits and times that all families of inputs share.

    Attributes
    ----------
    amplitude : dict of control to rad
    slew : float, rad/s
    duration : float, s
        Of the whole maneuver.
    band : float, Hz
        Highest frequency of a multisine.
    shortest : float, s
        Shortest step.
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


class Shape(Protocol):
    """A family of inputs."""

    @property
    def dimension(self) -> int:
        """Number of unknowns, each in [0, 1]."""

    @property
    def starts(self) -> FloatArray:
        """Guesses (k, dimension): what one would fly without a design."""

    def inputs(self, x: FloatArray) -> tuple[Input, ...]:
        """Return the tables of a maneuver file for a point (dimension,)."""


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
        count = len(self.frame.amplitude)
        rows = []
        for share in (1.0, 0.5):
            step = share * self.frame.active / count / self._units
            begins = [i * self.frame.active / count for i in range(count)]
            rows.append([v for begin in begins for v in (*self._placed(begin, step), 1.0)])
        return np.array(rows)

    def inputs(self, x: FloatArray) -> tuple[Input, ...]:
        """Return one table per control."""
        rows = zip(self.frame.amplitude.items(), x.reshape(-1, 3), strict=True)
        return tuple(self._row(control, most, point) for (control, most), point in rows)

    def _row(self, control: str, most: float, point: FloatArray) -> Input:
        signed = 2.0 * float(point[2]) - 1.0
        size = self.frame.reached(most * max(MIN_AMPLITUDE, abs(signed)), self._longest)
        amplitude, least = np.copysign(size, signed), self.frame.least(size)
        step = least + float(point[1]) * (self._longest - least)
        begin = LEAD + float(point[0]) * (self.frame.active - self._units * step)
        return Steps.model_validate(
            {"control": control, "shape": self.pattern, "start": begin, "step": step, "amplitude": float(amplitude),
             "slew": self.frame.slew}
        )  # fmt: skip

    def _placed(self, begin: float, step: float) -> tuple[float, float]:
        """Return the unknowns of a row at full amplitude that begins and steps about so."""
        least = self.frame.least(self.frame.reached(max(self.frame.amplitude.values()), self._longest))
        room = self.frame.active - self._units * step
        at = begin / room if room > 0.0 else 0.0
        return float(np.clip(at, 0.0, 1.0)), float(
            np.clip((step - least) / (self._longest - least), 0.0, 1.0)
        )

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
        rows = zip(self.frame.amplitude.items(), x.reshape(-1, 1 + self.levels), strict=True)
        return tuple(self._wave(control, most, point) for (control, most), point in rows)

    def _wave(self, control: str, most: float, point: FloatArray) -> Input:
        signed = 2.0 * float(point[0]) - 1.0
        size = self.frame.reached(most * max(MIN_AMPLITUDE, abs(signed)), self.frame.active / self.levels)
        amplitude, least = float(np.copysign(size, signed)), self.frame.least(size)
        shares = (0.01 + point[1:]) / np.sum(0.01 + point[1:])
        lengths = least + shares * (self.frame.active - self.levels * least)
        signs = (-1.0) ** np.arange(self.levels)
        return Levels.model_validate(
            {"control": control, "shape": "levels", "start": LEAD, "slew": self.frame.slew,
             "levels": (amplitude * signs).tolist(), "lengths": lengths.tolist()}
        )  # fmt: skip


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
        """Equal power with Schroeder's phases, at full and half amplitude; power falling with frequency."""
        return np.array(
            [self._schroeder(share, fall) for share, fall in ((1.0, 0.0), (0.5, 0.0), (1.0, 1.0))]
        )

    def inputs(self, x: FloatArray) -> tuple[Input, ...]:
        """Return one table per control."""
        out, first = [], 0
        for (control, most), harmonics in zip(self.frame.amplitude.items(), self._harmonics, strict=True):
            point = x[first : first + 1 + 2 * len(harmonics)]
            out.append(self._sum(control, most, harmonics, point))
            first += len(point)
        return tuple(out)

    @cached_property
    def _harmonics(self) -> list[NDArray[np.intp]]:
        count, most = len(self.frame.amplitude), int(self.frame.band * self.frame.active)
        if most < count:
            raise SimulationError(
                f"design: {self.frame.active:g} s and {self.frame.band:g} Hz leave no harmonic for every control; "
                "design for longer, or with a higher band"
            )
        return [np.arange(i + 1, most + 1, count) for i in range(count)]

    def _sum(self, control: str, most: float, harmonics: NDArray[np.intp], point: FloatArray) -> Input:
        count = len(harmonics)
        weights, phases = point[1 : 1 + count], 2.0 * np.pi * point[1 + count :]
        phases = _from_zero(harmonics, weights, phases)
        peak, speed = self._peaks(harmonics, weights, phases)
        share = MIN_AMPLITUDE + (1.0 - MIN_AMPLITUDE) * float(point[0])
        scale = min(share * most / peak, self.frame.slew / speed) if peak > 0.0 else 0.0
        return Harmonics.model_validate(
            {"control": control, "shape": "harmonics", "start": LEAD, "duration": self.frame.active,
             "harmonics": harmonics.tolist(), "amplitudes": (scale * weights).tolist(), "phases": phases.tolist()}
        )  # fmt: skip

    def _peaks(
        self, harmonics: NDArray[np.intp], weights: FloatArray, phases: FloatArray
    ) -> tuple[float, float]:
        """Return the largest deflection and the largest rate of a sum over one period."""
        tau = np.arange(16 * int(harmonics[-1])) / (16 * int(harmonics[-1]))
        angles = 2.0 * np.pi * np.outer(tau, harmonics) + phases
        rates = 2.0 * np.pi / self.frame.active * harmonics * weights
        deflection, speed = np.sin(angles) @ weights, np.cos(angles) @ rates
        return float(np.abs(deflection).max()), max(float(np.abs(speed).max()), 1e-12)

    def _schroeder(self, share: float, fall: float) -> list[float]:
        """Return a multisine with little peak factor, whose amplitudes fall with a power of the frequency.

        M. R. Schroeder, "Synthesis of low-peak-factor signals", IEEE Trans. Inf. Theory 16(1), 1970, eq. (11).
        """
        out: list[float] = []
        for harmonics in self._harmonics:
            k, count = np.arange(len(harmonics)), len(harmonics)
            phases = np.mod(-k * (k + 1) / (2.0 * count), 1.0)
            weights = (harmonics / harmonics[0]) ** -fall
            out += [(share - MIN_AMPLITUDE) / (1.0 - MIN_AMPLITUDE), *weights, *phases]
        return out


def _from_zero(harmonics: NDArray[np.intp], weights: FloatArray, phases: FloatArray) -> FloatArray:
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


SHAPES: Final[dict[str, Callable[[Frame], Any]]] = {
    "multisine": Multisines,
    "square": SquareWaves,
    "3-2-1-1": lambda frame: StepInputs(frame, "3-2-1-1"),
    "doublet": lambda frame: StepInputs(frame, "doublet"),
}

"""Files with which a maneuver is flown: by a pilot, or by what an autopilot runs beside its control.

Signs of the autopilots are those of the moments: a positive output rolls right, pitches up and yaws right. The sign of a control
follows from the vehicle's equations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from string import Template
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.motion import Maneuver, Trim
from stoop.extend.text import printable
from stoop.extend.units import SEA_LEVEL_DENSITY

AXES: Final = {"roll": "p", "pitch": "q", "yaw": "r"}  #: and their rates
AXIS_OF: Final = {
    "aileron": "roll", "elevator": "pitch", "rudder": "yaw", "elevon_left": "pitch", "elevon_right": "pitch",
    "vtail_left": "pitch", "vtail_right": "pitch",
}  #: of a surface by its name, whose moment gives the sign of its output  # fmt: skip

MAX_ANGLE: Final = 0.6  #: rad, of bank and pitch without an envelope
MAX_AIRSPEED: Final = 999.0  #: m/s, likewise


@dataclass(frozen=True, eq=False)
class Injection:
    """A maneuver from a steady flight, and what is expected of it.

    Attributes
    ----------
    readings : (n, n_y), expected, SI
    envelope : channel to (low, high), SI; beyond it a maneuver is broken off
    throws : control to its deflection at full output or full stick, rad
    beat : s, of a maneuver that is counted aloud
    caution : a sentence for a pilot, or nothing
    """

    vehicle: Vehicle
    trim: Trim
    maneuver: Maneuver
    readings: FloatArray
    envelope: Mapping[str, tuple[float, float]]
    throws: Mapping[str, float]
    beat: float | None = None
    caution: str = ""

    @property
    def on_rotors(self) -> bool:
        """Whether rotors carry the vehicle."""
        return not self.trim.on_wings

    @property
    def name(self) -> str:
        """Name of the vehicle on one line that ends no comment or string."""
        return "".join(c for c in printable(self.vehicle.name) if c.isalnum() or c in " .,+-_()")[:80]

    @cached_property
    def moved_controls(self) -> tuple[str, ...]:
        """Controls that move."""
        return tuple(c for c, x in self.maneuver.deflections().items() if np.any(x))

    def expected(self, channel: str) -> FloatArray:
        """Return an expected reading (n,)."""
        return self.readings[:, self.vehicle.outputs.index(channel)]

    def angles(self, channel: str) -> tuple[float, float]:
        """Return the lowest and the highest value of an angle, rad."""
        return self.envelope.get(channel, (-MAX_ANGLE, MAX_ANGLE))

    def airspeeds(self) -> tuple[float, float]:
        """Return the lowest and the highest equivalent airspeed, m/s, which is what autopilots measure."""
        low, high = self.envelope.get("V", (0.0, MAX_AIRSPEED))
        ratio = math.sqrt(self.trim.density(self.vehicle) / SEA_LEVEL_DENSITY)
        return ratio * low, ratio * high

    def at(self, rate: float) -> FloatArray:
        """Return evenly spaced times (m,) of the maneuver, s, at a rate in Hz."""
        return np.arange(math.floor(self.maneuver.duration * rate + 1e-9) + 1) / rate

    def moments(self, control: str) -> dict[str, float]:
        """Return the angular accelerations by axis, rad/s2, per rad of a surface."""
        return dict(zip(AXES, self.trim.surface_moments(self.vehicle, control).tolist(), strict=True))

    def outputs(self) -> dict[str, FloatArray]:
        """Return the change (n,) of the normalized output of each moved control, one at full throw.

        Raises
        ------
        SimulationError
            A throw is exceeded.
        """
        out = {}
        for control in self.moved_controls:
            sign = math.copysign(1.0, self.moments(control)[AXIS_OF[control]])
            out[control] = sign * self.maneuver.deflections()[control] / self.throws[control] + 0.0  # no -0
            most = float(np.abs(out[control]).max())
            if most > 1.0:
                raise SimulationError(
                    f"the maneuver moves {control} {100.0 * most:.0f} % of its throw; lower --amplitude"
                )
        return out


@dataclass(frozen=True)
class Target:
    """A pilot or an autopilot, and the files that it needs.

    Attributes
    ----------
    write : makes the files, name to text
    names : of all files that it may make
    on_wings, on_rotors : what it flies
    advice : for what it does not fly
    surfaces : that it moves by their throws; any where it moves none
    needs : outputs of the vehicle whose expected readings it sends
    """

    write: Callable[[Injection], dict[str, str]]
    names: tuple[str, ...]
    on_wings: bool
    on_rotors: bool
    advice: str = ""
    surfaces: Collection[str] = ()
    needs: tuple[str, ...] = ()

    def check(
        self, name: str, vehicle: Vehicle, steady: Trim, moved: Collection[str], throws: Mapping[str, float]
    ) -> None:
        """Refuse what it cannot fly, before a design.

        Raises
        ------
        SimulationError
            With what can be changed.
        """
        on_rotors = not steady.on_wings
        if not (self.on_rotors if on_rotors else self.on_wings):
            raise SimulationError(
                f"--for {name}: this flight is on {'rotors' if on_rotors else 'wings'}; {self.advice}"
            )
        for channel in self.needs:
            if channel not in vehicle.outputs:
                raise SimulationError(f"--for {name}: it needs the output {channel}; add [sensors.{channel}]")
        for control, throw in throws.items():
            if control not in vehicle.controls:
                choices = ", ".join(vehicle.controls) or "none"
                raise SimulationError(f"--throw {control}: there is no such surface; choose from {choices}")
            if not 0.0 < throw <= math.pi / 2.0:
                raise SimulationError(
                    f"--throw {control}: write the degrees at full output, above 0 and up to 90"
                )
        surfaces = moved if self.surfaces and not on_rotors else ()
        for control in surfaces:
            if control not in self.surfaces:
                raise SimulationError(
                    f"--for {name}: its script moves {', '.join(self.surfaces)}, not '{control}'; "
                    f"exclude it with --amplitude {control}=0"
                )
        missing = [control for control in surfaces if control not in throws]
        if missing:
            raise SimulationError(
                f"--for {name}: how far {', '.join(missing)} move at full output is not known; measure it and add --throw "
                + " ".join(f"{control}=DEG" for control in missing)
            )


def corners(t: FloatArray, x: FloatArray, tolerance: float) -> FloatArray:
    """Return the samples (k, 2) between which straight lines stay within a tolerance of a signal (n,).

    D. H. Douglas, T. K. Peucker, Cartographica 10(2), 1973, with distances along the ordinate.
    """
    kept, parts = {0, len(t) - 1}, [(0, len(t) - 1)]
    while parts:
        a, b = parts.pop()
        line = np.interp(t[a : b + 1], t[[a, b]], x[[a, b]])
        off = np.abs(x[a : b + 1] - line)
        i = a + int(np.argmax(off))
        if off[i - a] > tolerance:
            kept.add(i)
            parts += [(a, i), (i, b)]
    index = sorted(kept)
    return np.column_stack([t[index], x[index]])


def template(file: str, /, **texts: object) -> str:
    """Return a template of this package, filled in."""
    text = files("stoop_plan").joinpath("templates", file).read_text("utf-8")
    return Template(text).substitute({key: str(value) for key, value in texts.items()})


def pair(ends: tuple[float, float], decimals: int) -> str:
    """Return two numbers as Python writes them."""
    return f"({ends[0]:.{decimals}f}, {ends[1]:.{decimals}f})"

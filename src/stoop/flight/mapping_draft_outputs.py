"""Outputs in a drafted mapping: which pulses are motors, which move a surface, and over which range.

ArduPilot's parameters tell for certain: SERVOn_FUNCTION of motor 1 is 33 (Copter and QuadPlane, "Connecting outputs").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from stoop.base.toml import quoted
from stoop.base.variables import VARIABLES
from stoop.flight.airborne import rotor_pulses
from stoop.flight.flight import from_columns
from stoop.flight.time_delay import Signal

FUNCTIONS: Final[dict[float, str]] = {
    **{33 + k: f"motor_{1 + k}" for k in range(8)},
    **{82 + k: f"motor_{9 + k}" for k in range(4)},
    2: "flap",
    3: "flap",
    4: "aileron",
    19: "elevator",
    21: "rudder",
}  #: SERVOn_FUNCTION, a whole number, -> what the output does
RANGES: Final = (("MOT_PWM_MIN", "MOT_PWM_MAX"), ("Q_M_PWM_MIN", "Q_M_PWM_MAX"))  #: us; 0 where not set
DEFAULT_RANGE: Final = (1000.0, 2000.0)  #: us
DEFAULT_THROW: Final = 0.4  #: rad to each side, to start from
PULSE_RATE: Final = 200.0  #: Hz at which pulses are compared with rates
MIN_SAMPLES, MAX_SAMPLES = 100, 400_000  #: of that comparison
MAX_OUTPUTS: Final = 4  #: for which a calibration is drafted


@dataclass(frozen=True)
class Outputs:
    """The outputs of a log.

    Attributes
    ----------
    mapped : their variables, in order
    places : pulses -> where they are recorded, as the mapping writes it
    signals : variable -> samples, of pulses and rates
    parameters : of the autopilot
    called : pulses whose columns are called motors
    """

    mapped: tuple[str, ...]
    places: Mapping[str, str]
    signals: Mapping[str, Signal]
    parameters: Mapping[str, float]
    called: tuple[str, ...] = ()

    def motor_lines(self) -> list[str]:
        """Return lines for [variables] that make commands from 0 to 1 of the pulses of motors."""
        return [self._motor(pulse, motor) for pulse, motor in self.motors.items() if pulse in self.places]

    @cached_property
    def motors(self) -> dict[str, str]:
        """Return which pulse is which motor, by the parameters, by a column's name, or by what the pulses turn.

        None where motors are known.
        """
        if any(name.startswith(("motor_", "rotor_")) for name in self.mapped):
            return {}
        if self.functions:
            return {pulse: use for pulse, use in self.functions.items() if use.startswith("motor_")}
        return {pulse: pulse.replace("pwm", "motor") for pulse in self.called or turning(self.signals)}

    @cached_property
    def functions(self) -> dict[str, str]:
        """Return what the parameters say that each pulse does, as far as the registry knows it."""
        pulses = [name for name in self.mapped if name.startswith("pwm_")]
        uses = {p: FUNCTIONS.get(self.parameters.get(f"SERVO{p[4:]}_FUNCTION", 0.0), "") for p in pulses}
        return {pulse: use for pulse, use in uses.items() if use in VARIABLES}

    def surface_lines(self) -> list[str]:
        """Give outputs that may move a surface something to start a calibration from, as comments."""
        motors, uses = self.motors, self.functions
        named = {
            pulse: use for pulse, use in uses.items() if pulse not in motors and not use.startswith("motor_")
        }
        rest = [n for n in self.mapped if n.startswith(("pwm_", "servo_")) and n not in motors]
        if not (named or (rest and not motors)):
            return [] if set(motors) <= set(self.places) else _driving(list(motors))
        surfaces = (
            {s: [p for p in named if named[p] == s] for s in named.values()}
            if named
            else {"elevator": rest[:1]}
        )
        out = [
            "",
            "# Outputs that move a surface: measure its deflection (trailing edge down is positive), and mix them.",
        ]
        for name in named or rest[:MAX_OUTPUTS]:
            out += [f"# [calibration.{name}]", f"# points = {self._points(name)}"]
        for surface, names in surfaces.items():
            share = round(1.0 / len(names), 3)
            out += [f"# [surface.{surface}]", f"# from = {{{', '.join(f'{n} = {share!r}' for n in names)}}}"]
        return out

    def _motor(self, pulse: str, motor: str) -> str:
        low, high, said = self._range(pulse)
        scale, offset = 1.0 / (high - low), -low / (high - low)
        line = f'{motor} = {{{self.places[pulse]}, unit = "1", scale = {scale:.10g}, offset = {offset:.10g}}}'
        return f"{line}  # {self._told(said)}0 at {low:g} us, 1 at {high:g} us, {said or 'as is usual: write your own'}"

    def _told(self, said: str) -> str:
        """Return what is unsure of a motor: its number, its range."""
        number = "" if self.functions or self.called else "a motor by what it turns, check its number; "
        return (
            f"unsure: {number}"
            if number or not said.startswith(tuple(f"by {low}" for low, _ in RANGES))
            else ""
        )

    def _range(self, pulse: str) -> tuple[float, float, str]:
        """Return idle and full of a motor in us, and the parameters that say so."""
        number = pulse.removeprefix("pwm_")
        for low, high in (*RANGES, (f"SERVO{number}_MIN", f"SERVO{number}_MAX")):
            least, most = self.parameters.get(low, 0.0), self.parameters.get(high, 0.0)
            if 500.0 <= least < most <= 2500.0:
                return least, most, f"by {low} and {high}"
        return (*DEFAULT_RANGE, "")

    def _points(self, name: str) -> str:
        if name.startswith("servo"):
            return f"[[-1, {-DEFAULT_THROW}], [1, {DEFAULT_THROW}]]"
        low, middle, high = (
            self.parameters.get(f"SERVO{name[4:]}_{end}", 0.0) for end in ("MIN", "TRIM", "MAX")
        )
        if not 500.0 <= low < middle < high <= 2500.0:
            low, middle, high = 1100.0, 1500.0, 1900.0
        return f"[[{low:g}, {-DEFAULT_THROW}], [{middle:g}, 0.0], [{high:g}, {DEFAULT_THROW}]]"


def place(column: str, stream: str = "") -> str:
    """Return where a column lies, as a line of a mapping says it."""
    return f"{f'stream = {quoted(stream)}, ' if stream else ''}column = {quoted(column)}"


def turning(signals: Mapping[str, Signal]) -> list[str]:
    """Return pulses that turn the vehicle as motors do, each signal on its own clock."""
    used = {n: s for n, s in signals.items() if n in ("p", "q") or n.startswith("pwm_")}
    if not {"p", "q"} <= set(used) or min(t.size for t, _ in used.values()) < MIN_SAMPLES:
        return []
    start, stop = max(float(t[0]) for t, _ in used.values()), min(float(t[-1]) for t, _ in used.values())
    count = int(min(max(stop - start, 0.0) * PULSE_RATE, MAX_SAMPLES))
    if count < MIN_SAMPLES:
        return []
    time = np.arange(count) / PULSE_RATE
    columns = {name: np.interp(start + time, t, x) for name, (t, x) in used.items()}
    return rotor_pulses(from_columns("drafted", time, columns))


def _driving(pulses: Sequence[str]) -> list[str]:
    """Say what to do with the pulses of motors that the ready mapping takes."""
    idle, full = DEFAULT_RANGE
    return [
        "",
        f"# {' '.join(pulses)} turn the vehicle against one another, as motors do: name each as the channel of its rotor in",
        f"# the vehicle file, with gain = {1.0 / (full - idle):g} and idle = {idle:g} (yours) under [rotors].",
    ]

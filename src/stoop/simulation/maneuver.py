"""Maneuver files: what the pilot does, as a small TOML.

::

    format = "stoop-maneuver/1"
    duration = 30.0            # s
    rate = 100.0               # Hz
    airspeed = 35.0            # m/s; the vehicle's V* when left out
    altitude = 200.0           # m

    [[input]]
    control = "elevator"
    shape = "3-2-1-1"          # or doublet, pulse, multisine
    start = 1.0                # s
    step = 0.3                 # s
    amplitude = 0.2            # rad

    [noise]                    # standard deviations; the vehicle file's where left out
    V = 0.3

A vehicle that hovers is flown by an autopilot: inputs are added to its commands (`EXCITATIONS`, or the channel of one
rotor) or tell it what to fly (`SETPOINTS`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from stoop.base.arrays import FloatArray
from stoop.base.schema_errors import first_complaint
from stoop.base.toml import parse_source, read_source
from stoop.errors import ManeuverError
from stoop.vehicle.quantity import Number

MAX_SAMPLES = 5_000_000
MAX_HARMONICS = 2000
MAX_LEVELS = 2000
_EDGE = 1e-9  #: s, so that a step falls on the sample it names
EXCITATIONS = {"roll": "rad/s2", "pitch": "rad/s2", "yaw": "rad/s2", "heave": "m/s2"}
"""Accelerations that rotors are asked for beside what the autopilot commands, and their units; heave is up."""
SETPOINTS = {
    "north": "m/s", "east": "m/s", "down": "m/s", "forward": "m/s", "right": "m/s", "heading": "rad",
}  # fmt: skip
"""What the autopilot is told to fly, and units: a velocity over ground (forward and right of the heading), a heading."""
_CHANNELS = {"motor_": "", "rotor_": "rad/s", "pwm_": "us"}  #: of rotors, by how their names begin
_WILD = 1e6  #: of any unit


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


def unit_of(control: str) -> str:
    """Return the unit in which an input of this name is given."""
    channel = next((unit for head, unit in _CHANNELS.items() if control.startswith(head)), "rad")
    return (EXCITATIONS | SETPOINTS).get(control, channel)


def _no_angle(control: str) -> str:
    """Say what else may have been meant by a control that is taken for a surface."""
    others = f", or, for what hovers without '{control}', name {', '.join([*EXCITATIONS, *SETPOINTS])} or a motor_N"
    return others if control and control not in SETPOINTS else ""


def _sensible(value: float, info: ValidationInfo) -> float:
    control = str(info.data.get("control", ""))
    turns = 2.0 * math.pi if control == "heading" else math.pi / 2.0
    if unit_of(control) == "rad" and abs(value) > turns:
        raise ValueError(
            f"{value:g} looks like degrees; write radians ({math.radians(value):.4g}){_no_angle(control)}"
        )
    if abs(value) > _WILD:
        raise ValueError(f"{value:g} is beyond any size; write it in {unit_of(control) or 'its unit'}")
    return value


Seconds = Annotated[Number, Field(gt=0.0)]
Instant = Annotated[Number, Field(ge=0.0)]
Deflection = Annotated[Number, AfterValidator(_sensible)]
Speed = Annotated[Number, Field(ge=-200.0, le=200.0)]
Vector = tuple[Speed, Speed, Speed]
Harmonic = Annotated[int, Field(strict=True, ge=1, le=MAX_HARMONICS)]


def _check_slew(
    levels: Sequence[float], lengths: Sequence[float], slew: float | None, unit: str = "rad"
) -> None:
    for before, after, length in zip((0.0, *levels[:-1]), levels, lengths, strict=True):
        if slew is not None and abs(after - before) > slew * length * (1.0 + _EDGE):
            raise ValueError(
                f"a slew of {slew:g} {unit}/s does not get from {before:g} to {after:g} {unit} within {length:g} s; "
                "give it longer, or lower the amplitude"
            )


class Steps(_Table):
    """A row of steps of alternating sign, each a whole number of ``step`` long.

    With a ``slew`` (rad/s) the surface takes its time from one level to the next.
    """

    control: str
    shape: Literal["3-2-1-1", "doublet", "1-1", "2-1-1"]
    start: Instant
    step: Seconds
    amplitude: Deflection
    slew: Annotated[Number, Field(gt=0.0)] | None = None

    @model_validator(mode="after")
    def _reaches_its_levels(self) -> Steps:
        _check_slew(
            (self.amplitude, -self.amplitude), (self.step, self.step), self.slew, unit_of(self.control)
        )
        return self


class Levels(_Table):
    """A row of levels, each held for its own length, then back to the trim; with a ``slew`` as in `Steps`."""

    control: str
    shape: Literal["levels"]
    start: Instant
    levels: Annotated[tuple[Deflection, ...], Field(min_length=1, max_length=MAX_LEVELS)]  #: rad
    lengths: tuple[Seconds, ...]  #: s, one per level
    slew: Annotated[Number, Field(gt=0.0)] | None = None

    @model_validator(mode="after")
    def _reaches_its_levels(self) -> Levels:
        if len(self.levels) != len(self.lengths):
            raise ValueError("levels and lengths differ in length; give one length per level")
        _check_slew(self.levels, self.lengths, self.slew, unit_of(self.control))
        return self


class Pulse(_Table):
    """One pulse."""

    control: str
    shape: Literal["pulse"]
    start: Instant
    duration: Seconds
    amplitude: Deflection


class Multisine(_Table):
    """Equal-power harmonics with Schroeder phases (IEEE Trans. Inf. Theory 16(1), 1970), low peak factor.

    Harmonics ``first``, ``first + stride``, ... of 1/duration up to ``band`` Hz: different ``first`` with one
    ``stride`` make inputs on several controls orthogonal.
    """

    control: str
    shape: Literal["multisine"]
    start: Instant
    duration: Seconds
    amplitude: Deflection
    band: Annotated[Number, Field(gt=0.0)]  #: Hz
    first: Harmonic = 1
    stride: Harmonic = 1

    @model_validator(mode="after")
    def _has_harmonics(self) -> Multisine:
        if self.first / self.duration > self.band:
            raise ValueError(
                f"no harmonic of 1/{self.duration:g} s lies below {self.band:g} Hz; raise band or duration"
            )
        if self.band * self.duration > MAX_HARMONICS * self.stride:
            raise ValueError(f"more than {MAX_HARMONICS} harmonics; lower band or duration, or raise stride")
        return self


class Harmonics(_Table):
    """Harmonics of 1/duration, each with its own amplitude and phase: the sum of a sin(2 pi k t/duration + phase)."""

    control: str
    shape: Literal["harmonics"]
    start: Instant
    duration: Seconds
    harmonics: Annotated[tuple[Harmonic, ...], Field(min_length=1, max_length=MAX_HARMONICS)]
    amplitudes: tuple[Deflection, ...]  #: rad, one per harmonic
    phases: tuple[Number, ...]  #: rad, one per harmonic

    @model_validator(mode="after")
    def _as_many_of_each(self) -> Harmonics:
        if not len(self.harmonics) == len(self.amplitudes) == len(self.phases):
            raise ValueError(
                "harmonics, amplitudes and phases differ in length; give one of each per harmonic"
            )
        return self

    @property
    def band(self) -> float:
        """Highest frequency, Hz."""
        return max(self.harmonics) / self.duration


Input = Annotated[Steps | Levels | Pulse | Multisine | Harmonics, Field(discriminator="shape")]


class Battery(_Table):
    """How the voltage falls, for vehicles whose rotors feel it: start - fall t - sag (x / x of the trim)^2."""

    start: Annotated[Number, Field(gt=0.0, le=1000.0)] | None = None  #: V, idle; nominal when absent
    fall: Instant = 0.0  #: V/s
    sag: Instant = 0.0  #: V that the current of the steady flight costs


class Maneuver(_Table):
    """A maneuver flown from trim."""

    format: Literal["stoop-maneuver/1"] = "stoop-maneuver/1"
    duration: Annotated[Number, Field(gt=0.0, le=36000.0)]
    rate: Annotated[Number, Field(gt=0.0, le=10000.0)] = 100.0
    airspeed: Annotated[Number, Field(gt=0.0)] | None = None
    altitude: Annotated[Number, Field(ge=-1000.0, le=11000.0)] = 200.0
    velocity: Vector | None = None  #: north, east, down over ground at the start, m/s; of what hovers
    heading: Annotated[Number, Field(ge=-2.0 * math.pi, le=2.0 * math.pi)] = 0.0  #: at the start, rad
    wind: Vector | None = None  #: blowing north, east, down, m/s
    battery: Battery | None = None
    input: tuple[Input, ...] = ()
    noise: dict[str, Instant] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _bounded(self) -> Maneuver:
        if self.duration * self.rate > MAX_SAMPLES:
            raise ValueError(f"duration times rate exceeds {MAX_SAMPLES} samples; lower one of them")
        if self.duration * self.rate < 1.0:
            raise ValueError("duration is shorter than one sample; raise duration or rate")
        if self.airspeed is not None and self.velocity is not None:
            raise ValueError("airspeed and velocity: one flies on wings, the other on rotors; remove one")
        bands = [spec.band for spec in self.input if isinstance(spec, Multisine | Harmonics)]
        if max(bands, default=0.0) > self.rate / 2.0:
            raise ValueError(f"band {max(bands):g} Hz is above half the rate; lower band or raise rate")
        return self

    @property
    def time(self) -> FloatArray:
        """Sample times, s."""
        return np.arange(round(self.duration * self.rate) + 1) / self.rate

    def deflections(self) -> dict[str, FloatArray]:
        """Return the change of each control from trim over :attr:`time`, in :func:`unit_of` it."""
        out: dict[str, FloatArray] = {}
        for spec in self.input:
            signal = _SHAPES[spec.shape](spec, self.time)
            out[spec.control] = out.get(spec.control, np.zeros_like(signal)) + signal
        return out


PATTERNS = {"3-2-1-1": (3, 2, 1, 1), "doublet": (1, 1), "1-1": (1, 1), "2-1-1": (2, 1, 1)}


def _steps(spec: Any, t: FloatArray) -> FloatArray:
    pattern = PATTERNS[spec.shape]
    levels = [spec.amplitude * (-1.0) ** i for i in range(len(pattern))]
    return _levels(t, spec.start + spec.step * np.concatenate([[0], np.cumsum(pattern)]), levels, spec.slew)


def _rows_of_levels(spec: Any, t: FloatArray) -> FloatArray:
    return _levels(t, spec.start + np.concatenate([[0.0], np.cumsum(spec.lengths)]), spec.levels, spec.slew)


def _levels(t: FloatArray, edges: FloatArray, levels: Sequence[float], slew: float | None) -> FloatArray:
    """Return one level between each two edges, the trim before and after; with a slew from level to level in ramps."""
    held = np.array([0.0, *levels, 0.0])
    if slew is None:
        return np.asarray(held[np.searchsorted(edges - _EDGE, t, side="right")])
    corners = np.column_stack([edges, edges + np.abs(np.diff(held)) / slew])
    return np.asarray(np.interp(t, corners.ravel(), np.column_stack([held[:-1], held[1:]]).ravel()))


def _pulse(spec: Any, t: FloatArray) -> FloatArray:
    inside = (t >= spec.start - _EDGE) & (t < spec.start + spec.duration - _EDGE)
    return np.where(inside, spec.amplitude, 0.0)


def _multisine(spec: Any, t: FloatArray) -> FloatArray:
    harmonics = range(spec.first, int(spec.band * spec.duration) + 1, spec.stride)
    tau = t - spec.start
    waves = np.zeros_like(t)
    for k, harmonic in enumerate(harmonics):
        phase = -np.pi * k * (k + 1) / len(harmonics)
        waves += np.sin(2.0 * np.pi * harmonic * tau / spec.duration + phase)
    inside = (tau >= -_EDGE) & (tau < spec.duration - _EDGE)
    return np.asarray(
        np.where(inside, spec.amplitude * waves / max(float(np.max(np.abs(waves))), 1e-12), 0.0)
    )


def _harmonics(spec: Any, t: FloatArray) -> FloatArray:
    tau = t - spec.start
    waves = np.zeros_like(t)
    for k, amplitude, phase in zip(spec.harmonics, spec.amplitudes, spec.phases, strict=True):
        waves += amplitude * np.sin(2.0 * np.pi * k * tau / spec.duration + phase)
    inside = (tau >= -_EDGE) & (tau < spec.duration - _EDGE)
    return np.asarray(np.where(inside, waves, 0.0))


_SHAPES: dict[str, Callable[[Any, FloatArray], FloatArray]] = {
    **dict.fromkeys(PATTERNS, _steps),
    "levels": _rows_of_levels,
    "pulse": _pulse,
    "multisine": _multisine,
    "harmonics": _harmonics,
}


def load_maneuver(path: Path | str) -> Maneuver:
    """Read a maneuver file.

    Raises
    ------
    ManeuverError
        One line naming the file, the key and the fix.
    """
    return parse_maneuver(read_source(path, "maneuver", ManeuverError), str(path))


def parse_maneuver(text: str, where: str) -> Maneuver:
    """Read a maneuver from TOML text; ``where`` names it in messages."""
    raw = parse_source(text, where, ManeuverError)
    try:
        return Maneuver.model_validate(raw)
    except ValidationError as error:
        raise ManeuverError(f"{where}: {first_complaint(error, raw, Maneuver)}") from None

"""Maneuver files: the inputs of a simulated flight, as a small TOML.

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

On rotors an autopilot flies the vehicle: inputs are added to its commands (`EXCITATIONS`, or the channel of one rotor)
or are its set-points (`SETPOINTS`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationError, ValidationInfo, model_validator

from stoop.base.arrays import FloatArray
from stoop.base.schema_errors import first_complaint
from stoop.base.toml import parse_source, read_source
from stoop.base.variables import EULER
from stoop.errors import ManeuverError
from stoop.simulation.steady_flight import steady_flight, trim
from stoop.simulation.trim import Trim
from stoop.vehicle import Vehicle
from stoop.vehicle.rotor_channels import EXCITATIONS, SETPOINTS
from stoop.vehicle.schema import Number, Table

MAX_SAMPLES = 5_000_000
MAX_HARMONICS = MAX_LEVELS = 2000
MAX_WAVES = 200_000_000  #: samples of all inputs and their harmonics together; some seconds
MAX_VALUE = 1e6  #: of any unit
_EDGE = 1e-9  #: s, so that a step falls on the sample it names


def unit_of(control: str) -> str:
    """Return the unit in which an input of this name is given."""
    by_channel = {"motor_": "", "throttle": "", "rotor_": "rad/s", "pwm_": "us", "wind_": "m/s"}
    unit = next((unit for head, unit in by_channel.items() if control.startswith(head)), "rad")
    return (EXCITATIONS | SETPOINTS).get(control, unit)


def _plausible(value: float, info: ValidationInfo) -> float:
    control = str(info.data.get("control", ""))
    largest = 2.0 * math.pi if control == "heading" else math.pi / 2.0
    if unit_of(control) == "rad" and abs(value) > largest:
        names = ", ".join([*EXCITATIONS, *SETPOINTS])
        others = f", or, on rotors without a surface '{control}', name {names} or a motor_N"
        raise ValueError(
            f"{value:g} looks like degrees; write radians ({math.radians(value):.4g})"
            f"{others if control and control not in SETPOINTS else ''}"
        )
    if abs(value) > MAX_VALUE:
        raise ValueError(f"{value:g} is out of range; write it in {unit_of(control) or 'its unit'}")
    return value


Seconds = Annotated[Number, Field(gt=0.0)]
Instant = Annotated[Number, Field(ge=0.0)]
Deflection = Annotated[Number, AfterValidator(_plausible)]
Speed = Annotated[Number, Field(ge=-200.0, le=200.0)]
Vector = tuple[Speed, Speed, Speed]
Harmonic = Annotated[int, Field(strict=True, ge=1, le=MAX_HARMONICS)]


class _Signal(Table):
    control: str
    shape: str
    start: Instant

    @property
    def waves(self) -> int:
        """How many signals it is the sum of."""
        return 1


class _LevelSignal(_Signal):
    """Levels between edges; with a `slew` (rad/s) the signal ramps from one level to the next."""

    slew: Seconds | None = None

    def _check_slew(self, levels: Sequence[float], lengths: Sequence[float]) -> None:
        unit = unit_of(self.control)
        for before, after, length in zip((0.0, *levels[:-1]), levels, lengths, strict=True):
            if self.slew is not None and abs(after - before) > self.slew * length * (1.0 + _EDGE):
                raise ValueError(
                    f"a slew of {self.slew:g} {unit}/s does not get from {before:g} to {after:g} {unit} within {length:g} s; "
                    "give it longer, or lower the amplitude"
                )

    def _levels(self, t: FloatArray, edges: FloatArray, levels: Sequence[float]) -> FloatArray:
        """Return one level between each two edges, zero before and after."""
        all_levels = np.array([0.0, *levels, 0.0])
        if self.slew is None:
            return np.asarray(all_levels[np.searchsorted(edges - _EDGE, t, side="right")])
        corners = np.column_stack([edges, edges + np.abs(np.diff(all_levels)) / self.slew])
        values = np.column_stack([all_levels[:-1], all_levels[1:]])
        return np.asarray(np.interp(t, corners.ravel(), values.ravel()))


class Steps(_LevelSignal):
    """Steps of alternating sign, each a whole number of ``step`` long."""

    PATTERNS: ClassVar = {"3-2-1-1": (3, 2, 1, 1), "doublet": (1, 1), "1-1": (1, 1), "2-1-1": (2, 1, 1)}

    shape: Literal["3-2-1-1", "doublet", "1-1", "2-1-1"]
    step: Seconds
    amplitude: Deflection

    @model_validator(mode="after")
    def _reaches_levels(self) -> Steps:
        self._check_slew((self.amplitude, -self.amplitude), (self.step, self.step))
        return self

    def signal(self, t: FloatArray) -> FloatArray:
        """Return the change from the trim (n,) at times (n,), s."""
        pattern = self.PATTERNS[self.shape]
        levels = [self.amplitude * (-1.0) ** i for i in range(len(pattern))]
        return self._levels(t, self.start + self.step * np.concatenate([[0], np.cumsum(pattern)]), levels)


class Levels(_LevelSignal):
    """Levels of individual lengths, then back to the trim."""

    shape: Literal["levels"]
    levels: Annotated[tuple[Deflection, ...], Field(min_length=1, max_length=MAX_LEVELS)]  #: rad
    lengths: tuple[Seconds, ...]  #: s, one per level

    @model_validator(mode="after")
    def _reaches_levels(self) -> Levels:
        if len(self.levels) != len(self.lengths):
            raise ValueError("levels and lengths differ in length; give one length per level")
        self._check_slew(self.levels, self.lengths)
        return self

    def signal(self, t: FloatArray) -> FloatArray:
        """Return the change from the trim (n,) at times (n,), s."""
        return self._levels(t, self.start + np.concatenate([[0.0], np.cumsum(self.lengths)]), self.levels)


class _TimedSignal(_Signal):
    duration: Seconds

    def _inside(self, t: FloatArray, values: float | FloatArray) -> FloatArray:
        tau = t - self.start
        return np.where((tau >= -_EDGE) & (tau < self.duration - _EDGE), values, 0.0)


class Pulse(_TimedSignal):
    """One pulse."""

    shape: Literal["pulse"]
    amplitude: Deflection

    def signal(self, t: FloatArray) -> FloatArray:
        """Return the change from the trim (n,) at times (n,), s."""
        return self._inside(t, self.amplitude)


class Multisine(_TimedSignal):
    """Equal-power harmonics with Schroeder phases (IEEE Trans. Inf. Theory 16(1), 1970), low peak factor.

    Harmonics ``first``, ``first + stride``, ... of 1/duration up to ``band`` Hz: different ``first`` with one
    ``stride`` make inputs on several controls orthogonal.
    """

    shape: Literal["multisine"]
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

    @property
    def _harmonics(self) -> range:
        return range(self.first, int(self.band * self.duration) + 1, self.stride)

    @property
    def waves(self) -> int:
        """How many harmonics it has."""
        return len(self._harmonics)

    def signal(self, t: FloatArray) -> FloatArray:
        """Return the change from the trim (n,) at times (n,), s."""
        waves = np.zeros_like(t)
        for k, harmonic in enumerate(self._harmonics):
            phase = -np.pi * k * (k + 1) / self.waves
            waves += np.sin(2.0 * np.pi * harmonic * (t - self.start) / self.duration + phase)
        return self._inside(t, self.amplitude * waves / max(float(np.max(np.abs(waves))), 1e-12))


class Harmonics(_TimedSignal):
    """Harmonics of 1/duration, each with its own amplitude and phase: the sum of a sin(2 pi k t/duration + phase)."""

    shape: Literal["harmonics"]
    harmonics: Annotated[tuple[Harmonic, ...], Field(min_length=1, max_length=MAX_HARMONICS)]
    amplitudes: tuple[Deflection, ...]  #: rad, one per harmonic
    phases: tuple[Number, ...]  #: rad, one per harmonic

    @model_validator(mode="after")
    def _same_lengths(self) -> Harmonics:
        if not len(self.harmonics) == len(self.amplitudes) == len(self.phases):
            raise ValueError(
                "harmonics, amplitudes and phases differ in length; give one of each per harmonic"
            )
        return self

    @property
    def waves(self) -> int:
        """How many harmonics it has."""
        return len(self.harmonics)

    @property
    def band(self) -> float:
        """Highest frequency, Hz."""
        return max(self.harmonics) / self.duration

    def signal(self, t: FloatArray) -> FloatArray:
        """Return the change from the trim (n,) at times (n,), s."""
        waves = np.zeros_like(t)
        for k, amplitude, phase in zip(self.harmonics, self.amplitudes, self.phases, strict=True):
            waves += amplitude * np.sin(2.0 * np.pi * k * (t - self.start) / self.duration + phase)
        return self._inside(t, waves)


class Sweep(_TimedSignal):
    """A sine whose frequency grows exponentially from ``low`` to ``band``, Hz, after two periods of ``low``.

    It rises and falls over ``fade`` seconds as (1 - cos) / 2: the signal of ArduPilot's mode System ID, by
    ``ModeSystemId::waveform`` of ArduCopter.
    """

    shape: Literal["sweep"]
    amplitude: Deflection
    low: Annotated[Number, Field(gt=0.0)]  #: Hz
    band: Annotated[Number, Field(gt=0.0)]  #: Hz
    fade: Instant = 0.0  #: s, at either end

    @model_validator(mode="after")
    def _has_time(self) -> Sweep:
        if not self.low < self.band:
            raise ValueError(f"low {self.low:g} Hz is not below band {self.band:g} Hz; exchange them")
        least = max(2.0 / self.low, 2.0 * self.fade)
        if not least < self.duration:
            raise ValueError(
                f"two periods of {self.low:g} Hz, and the fades, take {least:g} s; make the duration longer, or raise low"
            )
        return self

    def signal(self, t: FloatArray) -> FloatArray:
        """Return the change from the trim (n,) at times (n,), s."""
        tau, constant = t - self.start, 2.0 / self.low
        rest, growth = self.duration - constant, math.log(self.band / self.low)
        later = np.clip((tau - constant) / rest, 0.0, 1.0)
        rising = rest / growth * np.expm1(growth * later)
        phase = 2.0 * np.pi * self.low * np.where(tau <= constant, tau - constant, rising)
        window = np.ones_like(tau)
        if self.fade > 0.0:
            ends = np.clip(np.minimum(tau, self.duration - tau) / self.fade, 0.0, 1.0)
            window = 0.5 - 0.5 * np.cos(np.pi * ends)
        return self._inside(t, self.amplitude * window * np.sin(phase))


Input = Annotated[Steps | Levels | Pulse | Multisine | Harmonics | Sweep, Field(discriminator="shape")]


class Battery(Table):
    """How the voltage falls, for rotors that depend on it: start - fall t - sag (x / x of the trim)^2."""

    start: Annotated[Number, Field(gt=0.0, le=1000.0)] | None = None  #: V, idle; nominal when absent
    fall: Instant = 0.0  #: V/s
    sag: Instant = 0.0  #: V, under the current of the steady flight


class Maneuver(Table):
    """A maneuver flown from trim."""

    MAX_ROTOR_SAMPLES: ClassVar = 500_000  #: an autopilot takes them one by one
    #: of the attitude, rad, and of the wind, m/s, that a maneuver under the law of an autopilot may hold
    UNDER_LAW: ClassVar = (*EULER, "wind_n", "wind_e", "wind_d")
    unit_of = staticmethod(unit_of)

    format: Literal["stoop-maneuver/1"] = "stoop-maneuver/1"
    duration: Annotated[Number, Field(gt=0.0, le=36000.0)]
    rate: Annotated[Number, Field(gt=0.0, le=10000.0)] = 100.0
    airspeed: Annotated[Number, Field(gt=0.0)] | None = None
    altitude: Annotated[Number, Field(ge=-1000.0, le=11000.0)] = 200.0
    velocity: Vector | None = None  #: north, east, down over ground at the start, m/s; on rotors
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
        if self.duration * self.rate * sum(spec.waves for spec in self.input) > MAX_WAVES:
            raise ValueError(
                f"inputs and their harmonics, times samples, exceed {MAX_WAVES}; lower duration, rate or bands, or remove some"
            )
        if self.airspeed is not None and self.velocity is not None:
            raise ValueError("airspeed and velocity: one flies on wings, the other on rotors; remove one")
        bands = [spec.band for spec in self.input if isinstance(spec, Multisine | Harmonics | Sweep)]
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
            signal = spec.signal(self.time)
            out[spec.control] = out.get(spec.control, np.zeros_like(signal)) + signal
        return out

    def check(self, vehicle: Vehicle) -> None:
        """Check that a vehicle can fly a maneuver.

        Raises
        ------
        ManeuverError
            An input, wings, rotors or a battery that the vehicle does not have.
        """
        flight, rotors = steady_flight(vehicle, self.airspeed), vehicle.file.rotors
        known, without_airspeed = (f.movable(vehicle) for f in (flight, steady_flight(vehicle, None)))
        if vehicle.file.reference is None and self.airspeed is not None:
            raise ManeuverError(
                f"airspeed: {vehicle.where} has no wings to fly {self.airspeed:g} m/s on, so no trim there; leave it out, write "
                f"velocity, and move {', '.join(without_airspeed)}"
            )
        for spec in self.input:
            if spec.control not in known:
                hint = ""
                if spec.control in without_airspeed:
                    hint = f", or leave the airspeed out: '{spec.control}' is moved where rotors carry the vehicle"
                elif spec.control in self.UNDER_LAW:
                    hint = ", or fly the attitude and the wind under the law of an autopilot (--autopilot)"
                raise ManeuverError(
                    f"{vehicle.where}: the maneuver moves '{spec.control}', but the controls are {', '.join(known) or 'none'}; "
                    f"correct the maneuver file{hint}"
                )
        if flight.commands and len(self.time) > self.MAX_ROTOR_SAMPLES:
            raise ManeuverError(
                f"duration times rate: more than {self.MAX_ROTOR_SAMPLES} samples under the autopilot; lower one of them"
            )
        if self.heading and vehicle.reduce == "longitudinal":
            raise ManeuverError(
                "heading: a longitudinal model flies north; remove the heading, or fly the full model"
            )
        if self.velocity is not None and "velocity" in flight.refused:
            raise ManeuverError(
                f"velocity: {vehicle.where} has no rotors to hover on; write airspeed, and wind for the speed over ground"
            )
        if self.battery is None:
            return
        if rotors is None or rotors.nominal_voltage is None or not flight.commands:
            raise ManeuverError(
                f"battery: no rotor of {vehicle.where} depends on the voltage in this flight; write nominal_voltage into "
                "[rotors] of the vehicle file, or remove it"
            )
        if self.battery.sag and rotors.voltage_average:
            raise ManeuverError(
                f"battery.sag: the rotors of {vehicle.where} take the voltage over {rotors.voltage_average:g} s "
                "(voltage_average), so sag is part of their thrust; remove one of the two"
            )

    def trim(self, vehicle: Vehicle) -> Trim:
        """Return the steady flight at the start of a maneuver."""
        velocity, wind, heading = self.velocity, self.wind, self.heading
        return trim(vehicle, self.airspeed, self.altitude, velocity=velocity, wind=wind, heading=heading)


def load_maneuver(path: Path | str) -> Maneuver:
    """Read a maneuver file.

    Parameters
    ----------
    path : path

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

"""Limits of a designed maneuver: amplitude and slew of the surfaces, envelope of the readings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from stoop.base.arrays import FloatArray
from stoop.errors import SimulationError
from stoop.simulation import Trim
from stoop.vehicle import Vehicle

Span = tuple[float, float]

AMPLITUDE: Final = math.radians(3.0)  #: of every control that is not given one
SLEW: Final = math.radians(60.0)  #: rad/s; a slow servo
_ANGLE: Final = {"alpha": 6.0, "beta": 8.0, "phi": 35.0, "theta": 20.0}  #: degrees about the trim
_RATE: Final = 60.0  #: degrees per second
_SPEED: Final = 0.2  #: of the airspeed
_LOAD: Final = 9.80665  #: m/s2 about the trim: one g more or less


@dataclass(frozen=True)
class Limits:
    """Limits of a maneuver.

    Attributes
    ----------
    amplitude : mapping of control to rad
        Largest deflection from the trim, to either side.
    slew : float, rad/s
        Largest rate of every control.
    envelope : mapping of channel to (low, high), SI
        Where the readings stay.
    """

    amplitude: Mapping[str, float]
    slew: float
    envelope: Mapping[str, Span]

    @classmethod
    def about(
        cls,
        vehicle: Vehicle,
        trim: Trim,
        amplitude: Mapping[str, float] | None = None,
        slew: float = SLEW,
        envelope: Mapping[str, Span] | None = None,
    ) -> Limits:
        """Return limits about a steady flight: those that are given, defaults for the others.

        Parameters
        ----------
        vehicle : Vehicle
        trim : Trim
        amplitude : mapping, optional
            By control, rad; :data:`AMPLITUDE` for the others.
        slew : float, rad/s
        envelope : mapping, optional
            By channel, (low, high) in SI.

        Raises
        ------
        SimulationError
            A control or a channel that the vehicle does not have, or a trim outside its own envelope.
        """
        own, wanted, where = dict(amplitude or {}), dict(envelope or {}), vehicle.where
        for given, names, kind in ((own, vehicle.controls, "control"), (wanted, vehicle.outputs, "channel")):
            for name in given:
                if name not in names:
                    choices = ", ".join(names) or "none"
                    raise SimulationError(f"{where}: there is no {kind} '{name}'; choose from {choices}")
        for channel, (low, high) in wanted.items():
            steady = trim.start.get(channel, 0.5 * (low + high))
            if not low < steady < high:
                raise SimulationError(
                    f"{where}: the steady flight has {channel} = {steady:.4g}, which is not between {low:.4g} and {high:.4g}; "
                    "widen that limit or choose another airspeed"
                )
        amplitudes = {c: own.get(c, AMPLITUDE) for c in vehicle.controls}
        moved = {c: a for c, a in amplitudes.items() if a > 0.0}
        if not moved:
            raise SimulationError(
                f"{where}: no control is moved ({', '.join(amplitudes) or 'it has none'}); "
                "give one an amplitude above zero"
            )
        return cls(moved, slew, default_envelope(vehicle, trim) | wanted)

    def excess(self, readings: FloatArray, outputs: Sequence[str]) -> float:
        """Return by how much readings (n, n_y) leave the envelope, in its widths; zero inside."""
        out = 0.0
        for channel, values in zip(outputs, readings.T, strict=True):
            if channel in self.envelope:
                low, high = self.envelope[channel]
                over = max(low - float(values.min()), float(values.max()) - high)
                out = max(out, over / (high - low))
        return out


def default_envelope(vehicle: Vehicle, trim: Trim) -> dict[str, Span]:
    """Return an envelope in which a linear aerodynamic model is usually meant to hold."""
    angles = {c: _about(trim.start.get(c, 0.0), math.radians(width)) for c, width in _ANGLE.items()}
    rates = {c: _about(0.0, math.radians(_RATE)) for c in ("p", "q", "r")}
    speed = {"V": _about(trim.start["V"], _SPEED * trim.start["V"])}
    weight = -9.80665 * math.cos(trim.start["theta"])
    every = speed | angles | rates | {"az": _about(weight, _LOAD)}
    return {c: span for c, span in every.items() if c in vehicle.outputs}


def _about(center: float, width: float) -> Span:
    return center - width, center + width

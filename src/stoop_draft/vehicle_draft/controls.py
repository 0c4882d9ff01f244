"""Which channels of a log move the surfaces, and by what mixers.

In order of trust: deflections that were recorded; outputs whose mixers the parameters tell; moments that the autopilot
asked for; outputs by what they turn. Among these the one that was logged fast enough is taken. Deflections have the signs
of :mod:`stoop_draft.vehicle_draft`: elevator trailing edge down, aileron right wing down, rudder trailing edge left.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from stoop import Flight
from stoop.extend.arrays import FloatArray
from stoop_draft.vehicle_draft.autopilot import Scale, Setup
from stoop_draft.vehicle_draft.steady import STEADY, turning

#: control -> axis of the shares, its command, its rate, and its sign for a positive moment
AXES: Final[Mapping[str, tuple[int, str, str, float]]] = {
    "elevator": (1, "control_pitch", "q", -1.0),
    "aileron": (0, "control_roll", "p", 1.0),
    "rudder": (2, "control_yaw", "r", -1.0),
}
THROW: Final = 0.35  #: rad, of a full command
THROW_TEXT: Final = f"{THROW:g} rad ({math.degrees(THROW):.0f} deg)"
ENOUGH: Final = 0.6  #: of the fastest rate: at half of it commands are aliased
SMALL_WEIGHT: Final = 0.25  #: of the largest weight of outputs; less takes no part in an axis


@dataclass(frozen=True)
class Mixer:
    """How a deflection is made of channels."""

    #: rad per unit; empty: the channel is the deflection
    gains: Mapping[str, float] = field(default_factory=dict)
    centers: Mapping[str, float] = field(default_factory=dict)
    comment: str = ""
    sign: float = 1.0  #: -1 where a recorded deflection is positive the other way

    def deflection(self, flight: Flight, control: str) -> FloatArray:
        """Return the deflection (n,), rad, as the file will have it."""
        if not self.gains:
            return flight.column(control)
        parts = [g * (flight.column(n) - self.centers.get(n, 0.0)) for n, g in self.gains.items()]
        return np.asarray(np.sum(parts, axis=0))


@dataclass(frozen=True)
class Controls:
    """Mixers of the surfaces."""

    mixers: Mapping[str, Mixer] = field(default_factory=dict)
    source: str = ""  #: what they are from, in words
    guessed: bool = False

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the mixers use."""
        return tuple(dict.fromkeys(n for c, m in self.mixers.items() for n in (m.gains or {c: 1.0})))


def find_controls(flight: Flight, setup: Setup, wanted: tuple[str, ...]) -> Controls:
    """Return the mixers of the surfaces of a flight; none where it has nothing that moves them.

    Parameters
    ----------
    flight : Flight
    setup : Setup
        Of the autopilot.
    wanted : tuple of str
        Controls that the template has.
    """
    found = _recorded(flight, wanted)
    if not found.mixers:
        there = [name for name in wanted if recorded(flight, AXES[name][1])]
        moments = Controls({name: _moment(name) for name in there}, "the autopilot's normalized moments")
        outputs = (_of_outputs(flight, setup, kind) for kind in ("servo_", "pwm_"))
        known = [one for one in (*outputs, moments) if one.mixers]
        rates = [min(flight.sources[n].rate for n in one.channels) for one in known]
        fast = (one for one, rate in zip(known, rates, strict=True) if rate >= ENOUGH * max(rates))
        found = next(fast, None) or _by_motion(flight, wanted)
    mixers = {name: found.mixers[name] for name in AXES if name in found.mixers and name in wanted}
    return replace(found, mixers=mixers)


def default_controls(wanted: tuple[str, ...]) -> Controls:
    """Return mixers of the normalized moments, where there is no log."""
    return Controls({name: _moment(name) for name in AXES if name in wanted}, "normalized commands", True)


def recorded(flight: Flight, name: str) -> bool:
    """Tell whether a channel was recorded and moved."""
    if name not in flight.names or (name in flight.sources and flight.sources[name].derived):
        return False
    x = flight.column(name)
    x = x[np.isfinite(x)]
    return bool(x.size > 1 and np.ptp(x) > 1e-9)


def _recorded(flight: Flight, wanted: tuple[str, ...]) -> Controls:
    mixers = {}
    for control in wanted:
        if not recorded(flight, control):
            continue
        _, _, rate, sign = AXES[control]
        seen = sign * turning(flight, flight.column(control), rate)
        backward = control == "aileron" and seen < -STEADY.correlation
        comment = "the channel is the deflection, rad"
        if backward:
            comment += "; positive rolls to the left in this log, hence the signs of its derivatives"
        mixers[control] = Mixer(comment=comment, sign=-1.0 if backward else 1.0)
    return Controls(mixers, "recorded deflections")


def _of_outputs(flight: Flight, setup: Setup, kind: str) -> Controls:
    """Mix outputs by the shares of the parameters; every servo has the same full throw."""
    outputs = []
    for surface in setup.surfaces:
        channel = next((n for n in surface.channels if n.startswith(kind)), None)
        if channel is None or channel not in flight.names or not np.isfinite(flight.column(channel)).any():
            continue
        outputs.append((surface, channel, surface.channels[channel]))
    mixers = {}
    for control, (axis, _, _, sign) in AXES.items():
        total = sum(abs(surface.shares[axis]) for surface, *_ in outputs)
        gains: dict[str, float] = {}
        centers: dict[str, float] = {}
        names = []
        for surface, channel, scale in outputs if total > 0.0 else ():
            share = surface.shares[axis] / total
            if share:
                gains[channel] = gains.get(channel, 0.0) + sign * THROW * share / scale.unit
                centers |= {channel: scale.zero} if scale != Scale(0.0, scale.unit) else {}
                names.append(f"{surface.name} {channel}")
        if gains:
            mixers[control] = Mixer(gains, centers, f"{', '.join(names)}; full throw taken as {THROW_TEXT}")
    return Controls(mixers, f"outputs by {setup.autopilot}'s parameters")


def _moment(control: str) -> Mixer:
    _, channel, _, sign = AXES[control]
    return Mixer({channel: sign * THROW}, {}, f"a full command is taken as {THROW_TEXT}")


def _by_motion(flight: Flight, wanted: tuple[str, ...]) -> Controls:
    """Mix outputs by what they turn; a guess."""
    for names in flight.output_families():
        if names[0].startswith(("motor", "rotor")):
            continue
        mixers = {}
        by_axis = {c.axis: c.u for c in flight.directions(names)}
        outputs = np.column_stack([flight.column(name) for name in names])
        for control in wanted:
            axis, _, _, sign = AXES[control]
            u = by_axis.get(("roll", "pitch", "yaw")[axis])
            if u is None:
                continue
            good = np.isfinite(outputs).all(axis=1) & np.isfinite(u)
            x = outputs[good] - np.median(outputs[good], axis=0)
            weights = np.linalg.lstsq(x, u[good] - np.median(u[good]), rcond=None)[0]
            reach = np.abs(weights) * x.std(axis=0)
            kept = np.flatnonzero(reach > SMALL_WEIGHT * reach.max())
            size = float(np.abs(weights[kept]).sum())
            unit = 500.0 if names[0].startswith("pwm") else 1.0
            gains = {names[k]: sign * THROW * float(weights[k]) / size / unit for k in kept}
            middle = np.median(outputs[good], axis=0)
            centers = {names[k]: float(middle[k]) for k in kept} if unit > 1.0 else {}
            mixers[control] = Mixer(gains, centers, "A GUESS, by what the outputs turn: check each gain")
        if mixers:
            return Controls(mixers, "outputs by what they turn", guessed=True)
    return Controls()

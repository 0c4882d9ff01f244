"""What a model that flies on rotors says: hover and level flight, thrust over weight, time constants, control authority."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from stoop import Notice, Vehicle
from stoop.extend import motion
from stoop.extend.arrays import BoolArray, FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.notices import notice
from stoop_analysis.propagation.quantities import Curve, Samples, curve
from stoop_analysis.propagation.wing_figures import (
    FEW,
    SPEEDS,
    Domain,
    Found,
    Grouped,
    over_speeds,
    stretches,
)

#: group of figures, and name of a curve, whose rad/s are speeds of rotors
HOVER: Final = "Hover"
ROTOR_COMMAND: Final = "mean rotor command"
FASTER: Final = 0.5  #: m/s; faster than what was flown by less is within
ANGULAR: Final = {"p": "roll", "q": "pitch", "r": "yaw"}
RATES: Final = ("u", "v", "w", "p", "q", "r")


def rotor_figures(vehicle: Vehicle, rows: FloatArray, domain: Domain) -> Found:
    """Return what follows from kernel parameters (n_p, 1 + D), the first lane being the estimate.

    Raises
    ------
    SimulationError
        The estimate cannot hover.
    """
    return _Study(vehicle.coupled_to(()), rows, domain).found()


class _Study:
    """One model in still air, its nose in the direction of flight; the first lane is the estimate."""

    def __init__(self, vehicle: Vehicle, rows: FloatArray, domain: Domain) -> None:
        self.vehicle, self.rows, self.domain = vehicle, rows, domain
        self.count, self.area, self.notices = rows.shape[1], vehicle.rotor_range, list[Notice]()
        self.flying = motion.OnRotors.still(vehicle, rows, domain.altitude, domain.density)
        self.effect = vehicle.rotor_effects({"h": domain.altitude}, self.flying.level, {})
        self.hover, self.commands, self.hovers = self.flight(0.0, np.zeros((6, self.count)))
        if not self.hovers[0]:
            raise SimulationError(
                f"{vehicle.where}: the estimates do not hover; check mass, thrust and center of gravity, or fit hover as well"
            )

    def flight(self, speed: float, guess: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return scaled unknowns (6, 1 + D), rotor channels (m, 1 + D), NaN where there is none, and which lanes fly."""
        at = replace(self.flying.at, velocity=np.array([speed, 0.0, 0.0]))
        flying = replace(self.flying, at=at)
        x, solved = flying.solve(guess)
        commands = flying.trims(x).inputs[self.area.columns]
        inside = ((commands <= self.area.full[:, None]) & (commands >= self.area.idle[:, None])).all(axis=0)
        flies = solved & inside
        return x, np.where(flies, commands, np.nan), np.asarray(flies)

    @cached_property
    def _still(self) -> motion.Trims:
        return self.flying.trims(self.hover)

    def _with_channels(self, commands: FloatArray) -> FloatArray:
        """Return the accelerations (6, 1 + D) of rotor channels (m, 1 + D) in the attitude of the hover."""
        inputs = self._still.inputs.copy()
        inputs[self.area.columns] = commands
        return self.vehicle.accelerations(self._still.start, inputs, self.rows)

    def found(self) -> Found:
        """Return all numbers and curves."""
        figures = (*self.hovering(), *self.authority())
        curves, flown = tuple(self.curves()), self.domain.speeds
        if flown is None:
            return Found(figures, curves, tuple(self.notices))
        beyond = stretches(curves[0].airspeed, curves[0].airspeed, (0.0, flown[1]), FASTER)
        for low, high in beyond[:1]:
            self.notices.append(notice("propagate-faster-than-flown", low=low, high=high, flown=flown[1]))
        return Found(figures, curves, tuple(self.notices), beyond)

    def hovering(self) -> Iterator[Grouped]:
        """Yield hover throttle, thrust over weight and the time constant of the rotors."""
        failed = 1.0 - float(np.mean(self.hovers[1:]))
        if failed > FEW:
            self.notices.append(notice("propagate-no-hover", share=failed))
        unit = "1" if self.vehicle.drive == "command" else "rad/s"
        mean = "hover throttle" if unit == "1" else "rotor speed in hover"
        yield HOVER, Samples.of(mean, unit, self.commands.mean(axis=0))
        for name, command in zip(self.area.names, self.commands, strict=True):
            yield HOVER, Samples.of(f"{name} in hover", unit, command)
        if np.isfinite(self.area.full).all():
            full = np.repeat(self.area.full[:, None], self.count, axis=1)
            gravity = self.rows[self.vehicle.rows["environment.gravity"]]
            lift = self._with_channels(full)[2] - self._with_channels(np.nan_to_num(self.commands))[2]
            # in hover lift is weight: what full command adds is the excess
            yield HOVER, Samples.of("thrust over weight at full command", "1", 1.0 - lift / gravity)
        else:
            self.notices.append(notice("propagate-no-full-command"))
        if "rotors.lag" in self.vehicle.rows:
            lag = self.rows[self.vehicle.rows["rotors.lag"]]
            yield HOVER, Samples.of("rotor time constant", "s", lag)

    def authority(self) -> Iterator[Grouped]:
        """Yield the greatest angular accelerations from hover, all rotors within idle and full, the lift about kept."""
        if not np.isfinite(self.area.full).all():
            return
        room = np.minimum(self.area.full[:, None] - self.commands, self.commands - self.area.idle[:, None])
        for i, (state, axis) in enumerate(ANGULAR.items()):
            effect = self.effect[i]
            signs = np.sign(np.where(np.abs(effect) > 1e-9 * np.abs(effect).max(), effect, 0.0))
            found = self._with_channels(self.commands + signs[:, None] * room)[RATES.index(state)]
            yield "Control authority", Samples.of(f"{axis} acceleration from hover", "rad/s2", np.abs(found))

    def curves(self) -> list[Curve]:
        """Return pitch angle and throttle over the speed."""
        speeds = np.linspace(*self.domain.airspeed, SPEEDS)
        guess, theta, throttle, lost = self.hover, [], [], []
        for speed in speeds:
            guess, commands, flies = self.flight(float(speed), guess)
            theta.append(np.where(flies, self.flying.trims(guess).start["theta"], np.nan))
            throttle.append(commands.mean(axis=0))
            lost.append(1.0 - float(np.mean(flies[1:])))
        self.notices += over_speeds("propagate-no-trim", speeds, np.array(lost))
        unit = "1" if self.vehicle.drive == "command" else "rad/s"
        drawn = {"theta": ("rad", np.array(theta)), ROTOR_COMMAND: (unit, np.array(throttle))}
        return [curve(n, unit, speeds, v) for n, (unit, v) in drawn.items()]

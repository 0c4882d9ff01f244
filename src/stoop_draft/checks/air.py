"""Air data against the velocity over ground: V, alpha and beta follow velocity, attitude and a steady wind.

The wind, and offsets of the sensors, are fitted anew under each hypothesis; what priors say of them counts. Without a
velocity over ground, lift must grow with alpha and side force fall with beta.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray, robust_std, rotations
from stoop.extend.variables import FAMILIES
from stoop_draft.checks.engine import Evidence, Key, Penalty, Range, Residual, Residuals
from stoop_draft.checks.kinematics import LIMITS as AGREEMENT
from stoop_draft.checks.kinematics import Columns, Motion
from stoop_draft.checks.lines import AIRSPEEDS, VANES, Assignment, reading


@dataclass(frozen=True)
class AirLimits:
    """How air data are compared."""

    rate: float = 5.0  #: Hz
    longest: int = 3000  #: samples
    least: int = 100  #: samples
    speed: float = 4.0  #: m/s through the air; slower flow has no direction
    wind: float = 8.0  #: m/s, standard deviation of each component of a steady wind
    span: float = 3.0  #: s between independent gusts
    iterations: int = 6
    #: standard deviations of offsets, and floors of residuals
    offset: tuple[float, float] = (
        1.0,
        math.radians(3.0),
    )  #: m/s, rad; those of flight.instrument_errors or less
    floor: tuple[float, float] = (0.5, math.radians(1.0))  #: m/s, rad
    likeness: float = 0.8  #: correlation from which a slope of lift or side force means something
    #: slope of lift over lift, 1/rad: CLalpha of 2 to 7 over CL of 0.1 to 1.5
    slope: tuple[float, float] = (1.5, 80.0)
    odds: float = 10.0  #: of a slope outside


LIMITS: Final = AirLimits()


class Air:
    """The residuals of air data of columns at one rate [Hz]."""

    def __init__(self, data: Columns, rate: float) -> None:
        size = next(iter(data.values())).size
        step = max(1, round(rate / LIMITS.rate), -(-size // LIMITS.longest))
        self.data, self.rate = {name: x[::step] for name, x in data.items()}, rate / step
        self.motion = Motion(self.data, self.rate)
        there = data.keys()
        ground = {*FAMILIES["euler"], *FAMILIES["velocity"]} <= there
        names = (*AIRSPEEDS, *VANES) if ground else ()
        self.names = [n for n in names if n in there and np.isfinite(self.data[n]).sum() >= LIMITS.least]
        if "airspeed_equivalent" in there and "airspeed_pitot" in self.names:
            self.names.remove("airspeed_pitot")  # made of the other
        pitot, own = (self.data.get(n, np.ones(1)) for n in ("airspeed_pitot", "airspeed_equivalent"))
        both = {"airspeed_pitot", "airspeed_equivalent"} <= there
        ratio = np.nanmedian(pitot / np.where(own > 1.0, own, np.nan)) if both and (own > 1.0).any() else 1.0
        self.equivalent = float(ratio)  #: true over equivalent airspeed
        #: standard deviations of the wind, north and east, and of the offset of each channel before any data
        self.std = np.array([LIMITS.wind, LIMITS.wind, *(LIMITS.offset[n in VANES] for n in self.names)])

    def __call__(self, state: Assignment, changed: Collection[str] | None) -> Residuals:
        """Return what air data disagree, where some of those that changed take part."""
        out: dict[Key, Evidence] = {}
        every = {*self.names, *FAMILIES["euler"], *FAMILIES["velocity"]}
        if self.names and (changed is None or every & set(changed)):
            out.update(self._levels(state))
        if changed is None or {*VANES, "az", "ay", *AIRSPEEDS} & set(changed):
            out.update(self._slopes(state))
        return out

    def scales(self, state: Assignment) -> dict[tuple[str, ...], float]:
        """Return the factor of each airspeed that the velocity over ground shows, where it is no calibration."""
        out: dict[tuple[str, ...], float] = {}
        for name in (name for name in self.names if name in AIRSPEEDS):
            factor = 1.0 / self._fit(state, scaled=name)[1][-1]
            if factor > 0.1 and abs(factor - 1.0) > AGREEMENT.gain:
                out[name,] = float(factor)
        return out

    def _levels(self, state: Assignment) -> Residuals:
        measured, theta, predicted = self._fit(state)
        samples = LIMITS.span * self.rate
        out: dict[Key, Evidence] = {}
        for i, name in enumerate(self.names):
            vane = name in VANES
            left = measured[i] - predicted[i]
            known = measured[i][np.isfinite(measured[i])]
            size = measured[i] - float(known.mean()) if vane and known.size else measured[i]
            out["level", name] = Residual(left, size, samples, LIMITS.floor[vane] ** 2, level=not vane)
        out["wind", *self.names] = Penalty(0.5 * float(np.sum((theta / self.std) ** 2)))
        return out

    def _fit(self, state: Assignment, scaled: str = "") -> tuple[FloatArray, FloatArray, FloatArray]:
        """Fit wind and offsets by Gauss-Newton steps: measured (k, n), theta, predicted (k, n).

        theta = (w_n, w_e, an offset of each channel), and a scale of one channel last where one is named.
        """
        q = self.motion.attitude(state)
        velocity = np.column_stack([self._column(state, name) for name in FAMILIES["velocity"]])
        unit = np.zeros_like(velocity)
        axes = [
            rotations.to_body(q, unit + row) for row in np.eye(3)[:2]
        ]  # north and east along the body axes
        body = rotations.to_body(q, velocity)
        measured = np.array([self._column(state, name) for name in self.names])
        theta, count = np.zeros(2 + len(self.names)), len(self.names)
        theta[:2] = self._start(state, q, velocity)
        std = self.std
        if scaled:
            theta, std = np.append(theta, 1.0), np.append(std, 1.0)
        prior = np.zeros(theta.size)
        prior[2 + count :] = 1.0
        samples = LIMITS.span * self.rate
        for step in range(LIMITS.iterations + 1):
            predicted, slopes = self._predicted(theta, body, axes, scaled)
            left = measured - predicted
            if step == LIMITS.iterations:
                break
            information, gradient = np.diag(std**-2.0), (prior - theta) / std**2
            for i, name in enumerate(self.names):
                known = np.isfinite(left[i]) & np.isfinite(slopes[i]).all(axis=1)
                if not known.any():
                    continue
                y, J = left[i][known], slopes[i][known]
                sigma = max(robust_std(y), LIMITS.floor[name in VANES])
                weight = 1.0 / np.maximum(1.0, np.abs(y) / (1.5 * sigma)) / sigma**2 / samples
                information += J.T @ (weight[:, None] * J)
                gradient += J.T @ (weight * y)
            theta = theta + np.linalg.solve(information, gradient)
        return measured, theta, predicted

    def _predicted(
        self, theta: FloatArray, body: FloatArray, axes: list[FloatArray], scaled: str
    ) -> tuple[FloatArray, FloatArray]:
        """Return what each sensor should read (k, n), and its derivatives (k, n, p)."""
        air = body - theta[0] * axes[0] - theta[1] * axes[1]
        u, v, w = air.T
        speed = np.linalg.norm(air, axis=1)
        slow = speed < LIMITS.speed
        speed = np.where(slow, np.nan, speed)
        plane = np.hypot(u, w)
        rows: dict[str, tuple[FloatArray, Callable[[FloatArray], FloatArray]]] = {
            "alpha": (np.arctan2(w, u), lambda d: (u * d[:, 2] - w * d[:, 0]) / plane**2),
            "beta": (
                np.arcsin(np.clip(v / speed, -1.0, 1.0)),
                lambda d: (d[:, 1] - v * np.sum(air * d, axis=1) / speed**2) / np.maximum(plane, 1e-3),
            ),
        }
        predicted, slopes = [], []
        for i, name in enumerate(self.names):
            ratio = 1.0 / self.equivalent if name == "airspeed_equivalent" else 1.0
            value, slope = rows.get(
                name, (speed * ratio, lambda d, r=ratio: r * np.sum(air * d, axis=1) / speed)
            )
            factor = theta[-1] if name == scaled else 1.0
            columns = [-factor * slope(axis) for axis in axes]
            columns += [np.full(speed.size, float(i == j)) for j in range(len(self.names))]
            if scaled:
                columns.append(value * float(name == scaled))
            predicted.append(np.where(slow, np.nan, factor * value + theta[2 + i]))
            slopes.append(np.column_stack(columns))
        return np.array(predicted), np.array(slopes)

    def _start(self, state: Assignment, q: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the mean difference of the velocities over ground and through the air, within reason; north, east."""
        name = next((name for name in AIRSPEEDS if name in self.names), "")
        if not name:
            return np.zeros(2)
        ahead = np.zeros_like(velocity)
        ahead[:, 0] = self._column(state, name)
        apart = (velocity - rotations.to_ground(q, ahead))[:, :2]
        apart = apart[np.isfinite(apart).all(axis=1)]
        middle = np.median(apart, axis=0) if apart.size else np.zeros(2)
        return np.asarray(np.clip(middle, -LIMITS.wind, LIMITS.wind))

    def _column(self, state: Assignment, name: str) -> FloatArray:
        column, factor = reading(state, name)
        return factor * self.data[column]

    def _slopes(self, state: Assignment) -> Residuals:
        """Return what flow angles leave of the forces that grow with them, and the slope of lift over the lift."""
        out: dict[Key, Evidence] = {}
        speed = next((self.data[n] for n in AIRSPEEDS if n in self.data), np.full(1, 2.0))
        pressure = np.where(speed > 1.0, speed, np.nan) ** 2
        usual = float(np.mean(pressure[speed > 1.0])) if (speed > 1.0).any() else 1.0
        floor = (AGREEMENT.floors["force"] / usual) ** 2
        for vane, force in (("alpha", "az"), ("beta", "ay")):
            if not {vane, force} <= self.data.keys():
                continue
            x, y = self._column(state, vane), -self._column(state, force) / pressure
            middle, level, slope, likeness = _line(x, y)
            left = y - level - max(slope, 0.0) * (x - middle)
            out["flow", vane, force] = Residual(left, y - level, AGREEMENT.move * self.rate, floor)
            if vane == "alpha":
                share = slope / level if likeness > LIMITS.likeness else np.nan
                out["lift", vane, force] = Range(share, *LIMITS.slope, LIMITS.odds)
        return out


def _line(x: FloatArray, y: FloatArray) -> tuple[float, float, float, float]:
    """Return the means of x and y (n,), the slope of y over x, and their correlation; NaN where one moves by rounding alone."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if x.size < LIMITS.least or any(
        np.std(v) <= v.size * np.finfo(float).eps * np.abs(v).max() for v in (x, y)
    ):
        return np.nan, np.nan, np.nan, np.nan
    middle, level = float(x.mean()), float(y.mean())
    slope = float((x - middle) @ (y - level)) / float((x - middle) @ (x - middle))
    return middle, level, slope, slope * float(np.std(x) / np.std(y))

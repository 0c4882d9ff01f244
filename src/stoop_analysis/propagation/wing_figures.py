"""What a model that flies on wings says: trims over the airspeed, limits, stability, modes, control, and the glide."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop import Notice, Vehicle
from stoop.extend.arrays import BoolArray, FloatArray, run_slices
from stoop.extend.errors import SimulationError
from stoop.extend.motion import OnWings
from stoop.extend.notices import notice
from stoop.extend.units import STANDARD_GRAVITY
from stoop.extend.vehicles import full_command
from stoop_analysis.propagation.quantities import Curve, Samples, curve, mode_samples
from stoop_analysis.propagation.wings import (
    Linear,
    Steady,
    level_flight,
    lift_maximum,
    linear_flights,
    static_margin,
    steady_flights,
)

SPEEDS: Final = 21  #: of a curve
GLIDE_SPEEDS: Final = 25  #: at which the best glide is looked for
FEW: Final = 0.03  #: share of draws; a figure that fails in more is noted
MOST: Final = 0.5  #: share of draws, from which the lift has a maximum
OUTSIDE: Final = 1e-3  #: rad; beyond the angles of attack flown by less is within

Grouped = tuple[str, Samples]


@dataclass(frozen=True)
class Domain:
    """Where the model was flown, and where it is asked."""

    airspeed: tuple[float, float]  #: m/s, of the curves
    reference: float  #: m/s, of the numbers
    altitude: float  #: m
    density: float  #: kg/m3
    alpha: tuple[float, float] | None = None  #: rad, least and greatest angle of attack that was fitted
    speeds: tuple[float, float] | None = None  #: m/s, likewise: airspeed, over ground with rotors


@dataclass(frozen=True, eq=False)
class Found:
    """Numbers and curves of one model."""

    figures: tuple[Grouped, ...]
    curves: tuple[Curve, ...]
    notices: tuple[Notice, ...]
    #: m/s, stretches of the curves outside of what was fitted
    extrapolated: tuple[tuple[float, float], ...] = ()


def wing_figures(vehicle: Vehicle, rows: FloatArray, domain: Domain) -> Found:
    """Return what follows from kernel parameters (n_p, 1 + D), the first lane being the estimate.

    Raises
    ------
    SimulationError
        At the estimate nothing trims at the airspeed.
    """
    return _Study(vehicle, rows, domain).found()


class _Study:
    """One model; the first lane is the estimate."""

    def __init__(self, vehicle: Vehicle, rows: FloatArray, domain: Domain) -> None:
        self.domain, self.count = domain, rows.shape[1]
        self.notices: list[Notice] = []
        self.beyond: tuple[tuple[float, float], ...] = ()
        first = level_flight(vehicle, rows[:, :1], domain.altitude, domain.density)
        speed = {"V": np.array([domain.reference])}
        at = steady_flights(first, speed)
        if not at.flies[0]:  # some vehicles have no control that holds the sideslip at zero
            first = first.sideslipping()
            at = steady_flights(first, speed)
        if not at.flies[0]:
            raise SimulationError(
                f"{vehicle.where}: nothing trims at {domain.reference:g} m/s with the estimates; give --airspeed A:B about the "
                "airspeeds that were flown, or check thrust, CL and Cm"
            )
        self.wings, self.vehicle = replace(first, rows=rows), first.at.vehicle
        self.rows = rows
        self.at = self._at_speed(self.wings, domain.reference, self._all(at.solution))

    def _at_speed(self, flight: OnWings, speed: float, guess: FloatArray) -> Steady:
        return steady_flights(flight, {"V": np.full(self.count, speed)}, guess)

    def _all(self, solution: FloatArray) -> FloatArray:
        return np.repeat(solution[:, :1], self.count, axis=1)

    def found(self) -> Found:
        """Return all numbers and curves."""
        models = linear_flights(self.wings, self.at)
        self.drawn = self.curves()
        figures = [
            *self.trim(), *self.stability(), *self.modes(models), *self.limits(), *self.control(models), *self.glide(),
        ]  # fmt: skip
        return Found(tuple(figures), tuple(self.drawn), tuple(self.notices), self.beyond)

    def trim(self) -> Iterator[Grouped]:
        """Yield angles, controls and thrust of level flight at the airspeed."""
        at, group = self.at, "Level flight"
        for name in ("alpha", "beta", "phi"):
            if name in at.start:
                yield group, Samples.of(name, "rad", at.start[name])
        for name, value in at.deflections.items():
            yield group, Samples.of(name, "rad", value)
        for name, value in at.thrust.items():
            yield group, Samples.of(*_thrust(name), value)
        share, speed = float(np.mean(at.overpowered[1:])), self.domain.reference
        if share > FEW:
            self.notices.append(notice("propagate-overpowered", airspeed=speed, share=share))

    def curves(self) -> list[Curve]:
        """Return trims over the airspeed, each lane beginning from its own at the neighboring one."""
        speeds = np.linspace(*self.domain.airspeed, SPEEDS)
        points = self._along(self.wings, speeds, self.at.solution)
        if not any(p.flies[0] for p in points):
            low, high = self.domain.airspeed
            raise SimulationError(
                f"{self.vehicle.where}: nothing trims between {low:g} and {high:g} m/s with the estimates; "
                "give --airspeed A:B about the airspeeds that were flown"
            )
        quantities = {
            "alpha": ("rad", [p.start["alpha"] for p in points]),
            **{c: ("rad", [p.deflections[c] for p in points]) for c in self.vehicle.controls},
        }
        for name in points[0].thrust:
            shown, unit = _thrust(name)
            quantities[shown] = (unit, [p.thrust[name] for p in points])
        if not points[0].thrust:
            quantities["flight-path angle"] = ("rad", [p.climb for p in points])
        failed = np.array([1.0 - np.mean(p.flies[1:]) for p in points])
        short = np.array([np.mean(p.overpowered[1:]) for p in points])
        self.notices += over_speeds("propagate-no-trim", speeds, failed)
        self.notices += over_speeds("propagate-overpowered-between", speeds, short)
        self._tell_extrapolation(speeds, np.array([p.start["alpha"] for p in points]))
        return [curve(n, unit, speeds, np.array(v)) for n, (unit, v) in quantities.items()]

    def _along(self, flight: OnWings, speeds: FloatArray, solution: FloatArray) -> list[Steady]:
        """Return steady flights at airspeeds; `solution` (m, 1 + D) is that at the reference."""
        out: dict[int, Steady] = {}
        middle = int(np.argmin(np.abs(speeds - self.domain.reference)))
        for way in (range(middle, len(speeds)), range(middle - 1, -1, -1)):
            guess, before = solution, None
            for i in way:
                out[i] = self._at_speed(flight, speeds[i], guess)
                now, lost = out[i].solution, ~out[i].flies
                if lost[0]:
                    guess, before = solution, None
                    continue
                now = np.where(lost, self._all(now), now)
                guess = now if before is None else 2.0 * now - before  # to first order in the airspeed
                before = now
        return [out[i] for i in range(len(speeds))]

    def _tell_extrapolation(self, speeds: FloatArray, alpha: FloatArray) -> None:
        flown = self.domain.alpha
        if flown is None:
            self.notices.append(notice("propagate-alpha-unknown"))
            return
        self.beyond = stretches(speeds, alpha[:, 0], flown, OUTSIDE)
        if self.beyond:
            (low, _), (_, high) = self.beyond[0], self.beyond[-1]
            found = notice("propagate-extrapolated", low=low, high=high, first=flown[0], last=flown[1])
            self.notices.append(found)

    def stability(self) -> Iterator[Grouped]:
        """Yield static margin and neutral point with fixed controls."""
        vehicle = self.vehicle
        if not {"CL", "Cm"} <= set(vehicle.terms):
            return
        margin = static_margin(vehicle, self.rows, self.at.start, self.at.deflections)
        chord = self.rows[vehicle.rows["reference.chord"]]
        yield "Static stability", Samples.of("static margin", "chord", margin)
        yield "Static stability", Samples.of("neutral point behind the c.g.", "m", margin * chord)

    def modes(self, models: Linear) -> Iterator[Grouped]:
        """Yield the modes at the airspeed."""
        found, other = mode_samples(models.A, models.names)
        if many := {name: share for name, share in other.items() if share > FEW}:
            found_notice = notice("propagate-other-character", modes=tuple(many), share=max(many.values()))
            self.notices.append(found_notice)
        yield from (("Modes", one) for one in found)

    def limits(self) -> Iterator[Grouped]:
        """Yield the lowest airspeed of level flight within the angles of attack flown, or the stall of the model."""
        flown = self.domain.alpha
        self.slowest = float("nan")
        if flown is None or "CL" not in self.vehicle.terms:
            return
        low, high = min(float(self.at.start["alpha"][0]), flown[1]), flown[1]
        peak = lift_maximum(self.vehicle, self.rows, self.at.start, self.at.deflections, low, high)
        stalls = np.isfinite(peak)
        limit = np.where(stalls, peak, high)
        first = steady_flights(replace(self.wings, rows=self.rows[:, :1]), {"alpha": limit[:1]})
        found = steady_flights(self.wings, {"alpha": limit}, self._all(first.solution))
        share = float(np.mean(stalls[1:]))
        stalled = bool(stalls[0])
        name = "stall speed" if stalled else "lowest airspeed, alpha as flown"
        if stalled:
            yield "Limits", Samples.of("angle of attack of greatest lift", "rad", limit)
        yield "Limits", Samples.of(name, "m/s", found.start["V"])
        self.slowest = float(found.start["V"][0])
        code = "propagate-stall" if stalled else "propagate-no-stall"
        self.notices.append(notice(code, alpha=high, share=share))

    def control(self, models: Linear) -> Iterator[Grouped]:
        """Yield steady roll rate and angular accelerations at full deflection, or per radian where its size is unknown."""
        group, unlimited = "Control authority", []
        axes = (
            ("p", "steady roll rate", "rad/s", True), ("p", "roll acceleration", "rad/s2", False),
            ("q", "pitch acceleration", "rad/s2", False), ("r", "yaw acceleration", "rad/s2", False),
        )  # fmt: skip
        for state, what, unit, steady in axes:
            if state not in models.names or not models.effects:
                continue
            i = models.names.index(state)
            control = max(models.effects, key=lambda c: abs(float(models.effects[c][0, i])))
            effect = models.effects[control][:, i]
            if not abs(float(effect[0])) > 0.0:
                continue
            value = np.abs(models.steady_rate(state, control) if steady else effect)
            full = full_deflection(self.vehicle, self.rows, control)
            if full is None:
                unlimited.append(control)
                yield group, Samples.of(f"{what} per {control}", unit.replace("rad", "1"), value)
            else:
                yield group, Samples.of(f"{what}, full {control}", unit, value * full)
        if unlimited:
            self.notices.append(notice("propagate-no-range", controls=tuple(dict.fromkeys(unlimited))))

    def glide(self) -> Iterator[Grouped]:
        """Yield the best glide and the least sink without thrust, within the airspeeds and angles of attack flown."""
        gliding = replace(self.wings, powered=False)
        low, high = self.domain.airspeed
        if np.isfinite(self.slowest):
            low = min(max(self.slowest, 0.5 * low), low)
        speeds = np.linspace(low, high, GLIDE_SPEEDS)
        kept = [n in gliding.unknowns for n in self.wings.unknowns]
        points = self._along(gliding, speeds, self.at.solution[kept])
        nearest = int(np.argmin(np.abs(speeds - self.domain.reference)))
        angles = np.array([p.climb for p in points])
        with np.errstate(divide="ignore", invalid="ignore"):
            sink = -speeds[:, None] * np.sin(angles)
        ratio = glide_ratio(angles)
        mass = self.rows[self.vehicle.rows["mass.mass"]]
        self.drawn.append(curve("glide ratio without thrust", "1", speeds, ratio))
        here = self._at_speed(gliding, self.domain.reference, points[nearest].solution)
        yield "Glide without thrust", Samples.of("glide ratio at the airspeed", "1", glide_ratio(here.climb))
        best, where, edge = peak_of(speeds, ratio)
        least, slow, low_edge = peak_of(speeds, -sink)
        if edge[0] or np.mean(edge[1:]) > FEW:
            share = float(np.mean(edge[1:]))
            self.notices.append(notice("propagate-glide-at-end", low=low, high=high, share=share))
        if not edge[0]:
            yield "Glide without thrust", Samples.of("best glide ratio", "1", best)
            yield "Glide without thrust", Samples.of("airspeed of the best glide", "m/s", where)
        if not low_edge[0]:
            yield "Glide without thrust", Samples.of("least sink rate", "m/s", -least)
            yield "Glide without thrust", Samples.of("airspeed of the least sink", "m/s", slow)
            power = -least * mass * STANDARD_GRAVITY
            yield "Glide without thrust", Samples.of("least power that must be replaced", "W", power)
        self.notices.append(notice("propagate-no-power"))


def over_speeds(code: str, speeds: FloatArray, shares: FloatArray) -> list[Notice]:
    """Return a notice of the speeds (n,) where a share (n,) of the draws is above :data:`FEW`, if there are some."""
    where = speeds[shares > FEW]
    if not where.size:
        return []
    return [notice(code, low=float(where[0]), high=float(where[-1]), share=float(shares.max()))]


def stretches(
    speeds: FloatArray, values: FloatArray, flown: tuple[float, float], margin: float
) -> tuple[tuple[float, float], ...]:
    """Return the stretches of speeds (n,) where values (n,) lie outside of what was flown."""
    outside = (values < flown[0] - margin) | (values > flown[1] + margin)
    return tuple((float(speeds[run.start]), float(speeds[run.stop - 1])) for run in run_slices(outside))


def glide_ratio(climb: FloatArray) -> FloatArray:
    """Return distance over height of a flight-path angle, rad; NaN where it does not descend."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(climb < 0.0, -1.0 / np.tan(climb), np.nan)


def full_deflection(vehicle: Vehicle, rows: FloatArray, control: str) -> FloatArray | None:
    """Return the deflection (B,), rad, with all its channels at full command; None where these have no known end."""
    total = np.zeros(rows.shape[1])
    for channel in vehicle.channels_of(control):
        mix, full = f"controls.{control}.mix.{channel}", full_command(channel)
        if mix not in vehicle.rows or full is None:
            return None
        center = f"controls.{control}.center.{channel}"
        middle = rows[vehicle.rows[center]] if center in vehicle.rows else 0.0
        total = total + np.abs(rows[vehicle.rows[mix]] * (full - middle))
    return total


def peak_of(x: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the greatest of values (n, B) along x (n,), and its place, by a parabola through three points; NaN at an end."""
    count = values.shape[1]
    lanes, filled = np.arange(count), np.where(np.isfinite(values), values, -np.inf)
    at = filled.argmax(axis=0)
    inner = np.clip(at, 1, len(x) - 2)
    before, here, after = (values[inner + k, lanes] for k in (-1, 0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        bend = before - 2.0 * here + after
        shift = 0.5 * (before - after) / bend
        top, place = here - 0.25 * (before - after) * shift, x[inner] + shift * (x[1] - x[0])
    edge = (at == 0) | (at == len(x) - 1) | ~np.isfinite(top) | ~(bend < 0.0)
    return np.where(edge, np.nan, top), np.where(edge, np.nan, place), edge


def _thrust(name: str) -> tuple[str, str]:
    """Return name and unit of what holds the speed."""
    return ("thrust", "N") if name in ("propulsion.thrust", "thrust") else (name, "1")

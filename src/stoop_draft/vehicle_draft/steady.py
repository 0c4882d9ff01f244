"""What logs say of steady flight: airspeed, angle of attack, lift, and where controls and motors stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop import Flight
from stoop.extend.arrays import BoolArray, FloatArray
from stoop.extend.flights import FLYING, density_of
from stoop.extend.units import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from stoop_draft.checks.lines import AIRSPEEDS, RATES, VELOCITY


@dataclass(frozen=True)
class SteadyLimits:
    """What counts as steady, and what a control must show to turn a vehicle."""

    bank: float = 0.6  #: rad
    rate: float = 0.35  #: rad/s
    load: tuple[float, float] = (0.6, 1.5)  #: of gravity
    samples: int = 100  #: fewer are not enough: then all of the flight counts
    correlation: float = 0.2  #: partial, of an angular acceleration with what turns about that axis


DENSITY: Final = ("density", "pressure", "temperature", "altitude", "pd")  #: what tells it
STEADY: Final = SteadyLimits()


@dataclass(frozen=True, eq=False)
class Steady:
    """Flights with the samples that are steady."""

    flights: tuple[Flight, ...]
    masks: tuple[BoolArray, ...]  #: (n,) of each flight

    @property
    def duration(self) -> float:
        """Length of steady flight, s."""
        return sum(float(m.sum()) / f.rate for f, m in zip(self.flights, self.masks, strict=True))

    def values(self, *names: str) -> list[FloatArray]:
        """Return channels (n,) where all of them are finite; empty where one is missing."""
        parts = []
        for flight, mask in zip(self.flights, self.masks, strict=True):
            if set(names) <= flight.names:
                columns = np.array([flight.column(name)[mask] for name in names])
                parts.append(columns[:, np.isfinite(columns).all(axis=0)])
        return list(np.concatenate(parts, axis=1)) if parts else [np.empty(0)] * len(names)

    def median(self, name: str, default: float = math.nan) -> float:
        """Return the median of a channel."""
        (x,) = self.values(name)
        return float(np.median(x)) if x.size else default

    def airspeed(self) -> tuple[float, str]:
        """Return the median airspeed, m/s, and the channel it is from; NaN where the log has none."""
        for name in AIRSPEEDS:
            value = self.median(name)
            if value > FLYING.speed:
                return value, name
        vn, ve = self.values("vn", "ve")
        speed = float(np.median(np.hypot(vn, ve))) if vn.size else math.nan
        return (speed, "velocity over ground") if speed > FLYING.speed else (math.nan, "")

    def density(self) -> tuple[float, str]:
        """Return the density of the air, kg/m3, by what the logs tell best, and by what; that at sea level where nothing does."""
        found = []
        for flight, mask in zip(self.flights, self.masks, strict=True):
            told = density_of({name: flight.column(name)[mask] for name in DENSITY if name in flight.names})
            found += [] if told is None else [told]
        if not found:
            return SEA_LEVEL_DENSITY, "at sea level"
        return float(np.nanmedian(np.concatenate([x for x, _ in found]))), found[0][1]

    def lift_over_mass(self) -> float:
        """Return the median of the specific force across the airflow, upwards, m/s2."""
        alpha, ax, az = self.values("alpha", "ax", "az")
        if not alpha.size:
            return -self.median("az", -STANDARD_GRAVITY)
        return float(np.median(ax * np.sin(alpha) - az * np.cos(alpha)))

    def push_over_mass(self) -> float:
        """Return the median of the specific force along the airflow, m/s2: of thrust less drag; zero where it is unknown."""
        alpha, ax, az = self.values("alpha", "ax", "az")
        return float(np.median(ax * np.cos(alpha) + az * np.sin(alpha))) if alpha.size else 0.0


def steady_flight(flights: Sequence[Flight], wings: bool = True) -> Steady:
    """Return where flights are steady: airborne, level wings, slow rates, about 1 g; without wings where they hover."""
    masks = []
    for flight in flights:
        up = flight.airborne() if wings else flight.flying()
        limits = dict.fromkeys(RATES, (-STEADY.rate, STEADY.rate))
        limits["az"] = -STANDARD_GRAVITY * STEADY.load[1], -STANDARD_GRAVITY * STEADY.load[0]
        limits |= {"phi": (-STEADY.bank, STEADY.bank)} if wings else {}
        calm = up.copy()
        for name, (low, high) in limits.items():
            if name in flight.names:
                calm &= (flight.column(name) >= low) & (flight.column(name) <= high)
        if not wings and flight.names >= set(VELOCITY):
            calm &= np.hypot(flight.column("vn"), flight.column("ve")) < FLYING.hover_speed
        masks.append(calm if calm.sum() >= STEADY.samples else up)
    return Steady(tuple(flights), tuple(masks))


def turning(flight: Flight, u: FloatArray, rate: str) -> float:
    """Return the partial correlation of an angular acceleration with a command (n,), the rates kept still.

    Both are band-passed. Zero where the flight is too short, or lacks the rates.
    """
    if not set(RATES) <= flight.names or not np.isfinite(u).any():
        return 0.0
    rates = flight.band_pass(np.column_stack([flight.column(name) for name in RATES]))
    acceleration = np.gradient(rates[:, RATES.index(rate)]) * flight.rate
    columns = np.column_stack([acceleration, flight.band_pass(u[:, None])[:, 0], rates])
    columns = columns[flight.airborne() & np.isfinite(columns).all(axis=1)]
    if len(columns) < STEADY.samples:
        return 0.0
    fixed = columns[:, 2:]
    with np.errstate(over="ignore", invalid="ignore"):  # numbers that no vehicle has
        y, x = (a - fixed @ np.linalg.lstsq(fixed, a, rcond=None)[0] for a in columns[:, :2].T)
        sizes = np.sqrt((y @ y) * (x @ x))
    return float(x @ y / sizes) if 0.0 < sizes < np.inf else 0.0

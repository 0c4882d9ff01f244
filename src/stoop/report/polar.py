"""The page of a drag polar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.numbers import number, rounded_to_error
from stoop.base.units import DEGREE
from stoop.reconstruction.polar import Polar
from stoop.report.plots import Series, plot
from stoop.report.sheet import Bullets, Code, Figure, Section, Sheet, Table

POINTS: Final = 61
MEANINGS: Final = {
    "CD0": "least drag coefficient",
    "K": "CD = CD0 + K (CL - CL0)²",
    "CL0": "lift coefficient of least drag",
    "best glide": "greatest CL / CD, propeller effects on drag in it",
    "airspeed": "true airspeed over that of the flight file",
    "efficiency": "motor, controller and blades, without induced loss",
    "diameter": "of the propeller's disc, m",
}
LEAD: Final = """\
Drag by the energy-rate method, lift from the accelerometers, both over blocks of some seconds; a parabola by robust
regression. The intervals count the color of what is left, the error of the airspeed, and that of the propulsion."""


def polar_sheet(name: str, polar: Polar, notices: Sequence[Notice], command: str) -> Sheet:
    """Return the page of the polar of a flight of this name."""
    sections = [
        Section("Drag", (_numbers(polar), _drag(polar), _figure(polar), _bins(polar))),
        Section("Lift against angle of attack", (_lift(polar),)),
        Section("What it rests on", (Bullets([str(one) for one in notices]),)),
        Section("Made by", (Code(command),)),
    ]
    if polar.blocks.powered:
        sections.insert(1, Section("Power of steady level flight", (_power(polar),)))
    return Sheet(f"Drag polar of {name}", LEAD, tuple(sections))


def grid(polar: Polar) -> FloatArray:
    """Return the lift coefficients in tenths that the blocks cover."""
    low, high = polar.valid
    return np.round(np.arange(np.ceil(10.0 * low), np.floor(10.0 * high) + 1.0) / 10.0, 10)


def _numbers(polar: Polar) -> Table:
    prior = dict(zip(polar.names, polar.prior_std, strict=True))
    rows = []
    for name, (value, error) in polar.summary.items():
        shown = rounded_to_error(value, error)
        known = number(prior.get(name, np.nan), 2)
        rows.append((name, *shown, "log " + known if name == "diameter" else known, MEANINGS[name]))
    return Table("Estimates", ("", "estimate", "std error", "prior std", "what it is"), tuple(rows))


def _drag(polar: Polar) -> Table:
    CL = grid(polar)
    value, std = polar.drag(CL)
    rows = tuple(
        (number(c, 2), number(v, 3), number(v - NORMAL_95 * s, 3), number(v + NORMAL_95 * s, 3))
        for c, v, s in zip(CL, value, std, strict=True)
    )
    return Table("Drag coefficient with 95 % intervals", ("CL", "CD", "from", "to"), rows)


def _figure(polar: Polar) -> Figure:
    CL = np.linspace(*polar.valid, POINTS)
    value, std = polar.drag(CL)
    found = polar.bins()
    series = [
        Series("blocks", polar.CD, polar.CL, "points"),
        Series("medians of bins", np.array([b.CD for b in found]), np.array([b.CL for b in found]), "points"),
        Series("parabola", value, CL),
        Series("95 % interval, low", value - NORMAL_95 * std, CL),
        Series("95 % interval, high", value + NORMAL_95 * std, CL),
    ]
    high = float(max(np.max(value + NORMAL_95 * std), np.quantile(polar.CD, 0.9)))
    caption = "Lift coefficient over drag coefficient."
    return Figure(
        caption,
        plot(series, "drag coefficient CD", "lift coefficient CL", caption, x_range=(0.0, 1.1 * high)),
    )


def _bins(polar: Polar) -> Table:
    rows = tuple((number(b.CL, 3), number(b.CD, 3), number(b.spread, 2), str(b.count)) for b in polar.bins())
    return Table("Medians of blocks of similar lift", ("CL", "CD", "spread (68 %)", "blocks"), rows)


def _power(polar: Polar) -> Figure:
    low, high = np.quantile(polar.blocks.speed, [0.05, 0.95])
    speed = np.linspace(low, high, POINTS)
    value, std = polar.level_power(speed)
    series = [
        Series("electric power", speed, value),
        Series("95 % interval, low", speed, value - NORMAL_95 * std),
        Series("95 % interval, high", speed, value + NORMAL_95 * std),
    ]
    best = int(np.argmin(value))
    caption = (
        f"Least power {value[best]:.0f} ± {std[best]:.0f} W at {speed[best]:.1f} m/s (one standard error), from the "
        "parabola and the propulsion."
    )
    return Figure(
        caption,
        plot(
            series,
            "true airspeed, m/s",
            "electric power, W",
            caption,
            y_range=(0.0, 1.1 * float(np.max(value + std))),
        ),
    )


def _lift(polar: Polar) -> Figure:
    series = [Series("blocks", polar.blocks.alpha / DEGREE, polar.CL, "points")]
    caption = (
        "Lift coefficient over angle of attack, blocks. An angle of attack that was reconstructed with a steady wind holds "
        "vertical gusts, which spread the points sideways: no slope is fitted, it would come out too low."
    )
    return Figure(caption, plot(series, "angle of attack, deg", "lift coefficient CL", caption))

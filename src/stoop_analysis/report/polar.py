"""The page of the drag polar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop import Notice
from stoop.extend.arrays import FloatArray
from stoop.extend.fits import NORMAL_95
from stoop.extend.reports import plots, sheet
from stoop.extend.text import number, rounded_to_error
from stoop_analysis.performance.polar import Polar

MEANINGS: Final = {
    "CD0": "least drag coefficient",
    "K": "CD = CD0 + K (CL - CL0)²",
    "CL0": "lift coefficient of least drag",
    "best glide": "greatest CL / CD, propeller effects on drag in it",
    "airspeed": "true airspeed over that of the flight file",
    "efficiency": "motor, controller and blades, without induced loss",
    "diameter": "of the propeller's disc, m",
}
POLAR_LEAD: Final = """\
Drag by the energy-rate method, lift from the accelerometers, both over blocks of some seconds; a parabola by robust
regression. The intervals count the color of what is left, the error of the airspeed, and that of the propulsion."""
LIFT: Final = (
    "Lift coefficient over angle of attack, blocks. An angle of attack that was reconstructed with a steady wind holds "
    "vertical gusts, which spread the points sideways: no slope is fitted, it would come out too low."
)


def polar_sheet(name: str, polar: Polar, notices: Sequence[Notice], command: str) -> sheet.Sheet:
    """Return the page of the polar of a flight of this name."""
    prior, rows = dict(zip(polar.names, polar.prior_std, strict=True)), []
    for unknown, (value, error) in polar.summary.items():
        known = number(prior.get(unknown, np.nan), 2)
        known = "log " + known if unknown == "diameter" else known
        rows.append((unknown, *rounded_to_error(value, error), known, MEANINGS[unknown]))
    numbers = sheet.Table("Estimates", ("", "estimate", "std error", "prior std", "what it is"), tuple(rows))

    CL = lift_grid(polar)
    drag, std = polar.drag(CL)
    cells = tuple(
        (number(c, 2), number(v, 3), number(v - NORMAL_95 * s, 3), number(v + NORMAL_95 * s, 3))
        for c, v, s in zip(CL, drag, std, strict=True)
    )
    table = sheet.Table("Drag coefficient with 95 % intervals", ("CL", "CD", "from", "to"), cells)
    found = polar.bins()
    medians = tuple((number(b.CL, 3), number(b.CD, 3), number(b.spread, 2), str(b.count)) for b in found)
    bins = sheet.Table("Medians of blocks of similar lift", ("CL", "CD", "spread (68 %)", "blocks"), medians)

    CL = np.linspace(*polar.valid, 61)
    drag, std = polar.drag(CL)
    series = [
        sheet.Series("blocks", polar.CD, polar.CL, "points"),
        sheet.Series(
            "medians of bins", np.array([b.CD for b in found]), np.array([b.CL for b in found]), "points"
        ),
        sheet.Series("parabola", drag, CL),
        sheet.Series("95 % interval, low", drag - NORMAL_95 * std, CL),
        sheet.Series("95 % interval, high", drag + NORMAL_95 * std, CL),
    ]
    high = float(max(np.max(drag + NORMAL_95 * std), np.quantile(polar.CD, 0.9)))
    caption = "Lift coefficient over drag coefficient."
    axes = ("drag coefficient CD", "lift coefficient CL", caption)
    figure = sheet.Figure(caption, plots.plot(series, *axes, x_range=(0.0, 1.1 * high)))
    blocks = [sheet.Series("blocks", np.degrees(polar.blocks.alpha), polar.CL, "points")]
    lift = sheet.Figure(LIFT, plots.plot(blocks, "angle of attack, deg", "lift coefficient CL", LIFT))
    sections = [
        sheet.Section("Drag", (numbers, table, figure, bins)),
        sheet.Section("Lift against angle of attack", (lift,)),
        sheet.Section("What it rests on", (sheet.Bullets(notices),)),
        sheet.Section("Made by", (sheet.Code(command),)),
    ]
    if polar.blocks.powered:
        low, high = np.quantile(polar.blocks.speed, [0.05, 0.95])
        speed = np.linspace(low, high, 61)
        power, std = polar.level_power(speed)
        balanced = np.isfinite(power + std)
        speed, power, std = speed[balanced], power[balanced], std[balanced]
    if polar.blocks.powered and power.size:
        series = [
            sheet.Series("electric power", speed, power),
            sheet.Series("95 % interval, low", speed, power - NORMAL_95 * std),
            sheet.Series("95 % interval, high", speed, power + NORMAL_95 * std),
        ]
        best, shown = int(np.argmin(power)), (0.0, 1.1 * float(np.max(power + std)))
        caption = (
            f"Least power {power[best]:.0f} ± {std[best]:.0f} W at {speed[best]:.1f} m/s (one standard error), from the "
            "parabola and the propulsion."
        )
        drawing = plots.plot(series, "true airspeed, m/s", "electric power, W", caption, y_range=shown)
        sections.insert(1, sheet.Section("Power of steady level flight", (sheet.Figure(caption, drawing),)))
    return sheet.Sheet(f"Drag polar of {name}", POLAR_LEAD, tuple(sections))


def lift_grid(polar: Polar) -> FloatArray:
    """Return the lift coefficients in tenths that the blocks cover."""
    low, high = polar.valid
    return np.round(np.arange(np.ceil(10.0 * low), np.floor(10.0 * high) + 1.0) / 10.0, 10)

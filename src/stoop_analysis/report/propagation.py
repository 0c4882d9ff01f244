"""The page of propagated uncertainty: figures with their intervals, and fans over the airspeed."""

from __future__ import annotations

import math
from itertools import groupby
from typing import Final

import numpy as np

from stoop.extend.reports import plots, sheet
from stoop.extend.text import factor_and_unit, number, rounded_to_error
from stoop.extend.units import UNITS
from stoop_analysis.propagation.propagation import EXPRESSIONS, Propagation
from stoop_analysis.propagation.quantities import Curve, Figure
from stoop_analysis.propagation.rotor_figures import HOVER, ROTOR_COMMAND

MODES: Final = "Modes"  #: whose frequencies stay in rad/s
HEAD: Final = ("", "estimate", "std error", "95 % from", "to", "unit", "depends most on")
LEGEND: Final = (
    ("swatch fan-estimate", "estimate"), ("swatch fan-median", "median of the draws"), ("swatch fan-half", "50 % band"),
    ("swatch fan-most", "95 % band"),
)  # fmt: skip
BEYOND: Final = ("swatch fan-beyond", "outside of what was fitted")
READ: Final = """\
Every draw of the parameters is trimmed and linearized by itself, so that correlations and curvature are in the \
intervals: they are the 2.5 and 97.5 percentiles of the draws, and need not lie symmetrically about the estimate. The \
last column lists the parameters whose knowledge would reduce the variance most, with the share (to first order; shares of \
correlated parameters overlap). The intervals describe the uncertainty of the parameters of this model, not errors of its \
form."""
SOURCES: Final = {
    "posterior": "the posterior of the parameters",
    "covariance": "the corrected covariance of the estimates, cut off at their bounds",
}


def shown(figure: Figure) -> tuple[float, str]:
    """Return by what a figure is multiplied to be shown, and in which unit: angles in degrees, modes in rad/s, rotors in rpm."""
    if figure.group == HOVER:
        return rotor_unit(figure.unit)
    kept = figure.group in (MODES, EXPRESSIONS) and figure.unit != "1"
    return (1.0, figure.unit) if kept else factor_and_unit(figure.unit)


def rotor_unit(unit: str) -> tuple[float, str]:
    """Return by what a figure of rotors is multiplied to be shown, and in which unit: speeds in revolutions per minute."""
    return (1.0 / UNITS["rpm"].factor, "rpm") if unit == "rad/s" else factor_and_unit(unit)


def propagation_page(found: Propagation, command: str = "") -> sheet.Page:
    """Return the page."""
    domain, sections = found.domain, list[sheet.Section]()
    low, high = domain.airspeed
    where = f"{low:g} to {high:g} m/s at {domain.altitude:.0f} m ({domain.density:.3f} kg/m³)"
    lead = (
        f"{found.count} draws from {SOURCES[found.source]}, carried into what the model says. Curves: {where}; "
        + (f"numbers: at {domain.reference:g} m/s." if domain.reference else "numbers: in hover.")
    )
    warnings, notes = ([n for n in found.notices if n.severity == kind] for kind in ("warning", "info"))
    if warnings:
        sections.append(sheet.Section("Cautions", (sheet.Bullets(warnings, "warnings"),)))
    groups = groupby(found.figures, lambda one: one.group)
    tables = [sheet.Table(group, HEAD, tuple(_row(one) for one in some)) for group, some in groups]
    sections.append(sheet.Section("Figures", (sheet.Prose(READ, muted=True), *tables)))
    if found.curves:
        fans = sheet.Panels([_panel(found, c) for c in found.curves])
        sections.append(
            sheet.Section(
                "Over the airspeed", (sheet.Legend((*LEGEND, *[BEYOND] * bool(found.extrapolated))), fans)
            )
        )
    if notes:
        sections.append(sheet.Section("What they rest on", (sheet.Bullets(notes),)))
    if found.expressions:
        rows = tuple(found.expressions.items())
        sections.append(sheet.Section("Expressions", (sheet.Table("Given", ("name", "expression"), rows),)))
    if command:
        sections.append(sheet.Section("Made by", (sheet.Code(command),)))
    return sheet.Page(sheet.Sheet(f"What the uncertainty means: {found.vehicle}", lead, tuple(sections)))


def _row(one: Figure) -> tuple[str, ...]:
    factor, unit = shown(one)
    values = (one.estimate, one.std_error, one.ci95_lower, one.ci95_upper)
    estimate, error, low, high = (factor * v for v in values)
    value, std = rounded_to_error(estimate, error)
    # two digits of the error
    digits = max(0, 1 - math.floor(math.log10(error))) if math.isfinite(error) and error > 0.0 else None
    ends = tuple("–" if not math.isfinite(v) else _fixed(v, digits) for v in (low, high))
    sources = [f"{name} {100.0 * part:.0f} %" for name, part in one.sources]
    if one.std_error == 0.0:
        sources.append("not estimated")
    if one.rests_on_prior:
        sources.append("mostly priors")
    return (one.name, value, std, *ends, unit or "–", ", ".join(sources) or "–")


def _fixed(value: float, decimals: int | None) -> str:
    text = number(value) if decimals is None or decimals > 8 else f"{value:z.{decimals}f}"
    return text.replace("-", "−")


def _panel(found: Propagation, one: Curve) -> sheet.Panel:
    factor, unit = rotor_unit(one.unit) if one.name == ROTOR_COMMAND else factor_and_unit(one.unit)
    drawing = plots.fan_panel(
        one.airspeed, factor * one.estimate, factor * one.bands, "airspeed, m/s", one.name, found.extrapolated
    )
    lost = float(np.max(one.failed, initial=0.0))
    note = f"no value for up to {100.0 * lost:.0f} % of the draws" if lost > 0.0 else ""
    return sheet.Panel(one.name, drawing, unit, note=note)

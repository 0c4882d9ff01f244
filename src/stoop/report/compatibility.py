"""The page of a compatibility check: contradictions, errors of each sensor, measured over reconstructed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import of_severity
from stoop.base.numbers import NOTHING, factor_and_unit, number, rounded_to_error, window
from stoop.reconstruction.compatibility import Compatibility, Finding, Trace
from stoop.report.plots import Series, Strip, stacked_plots
from stoop.report.sheet import Bullets, Code, Figure, Prose, Section, Sheet, Table

GROUPS: Final = (
    ("Attitude", ("phi", "theta", "psi")),
    ("Velocity over ground", ("vn", "ve", "vd")),
    ("Position", ("pn", "pe", "pd")),
    ("Air data", ("V", "airspeed_pitot", "alpha", "beta")),
)
LEAD: Final = """\
Accelerations and rates were integrated from one initial state per piece; the readings of the other sensors were compared
with that. Biases, scales, delays, positions and a steady wind were estimated such that all agree as well as they can; the
standard errors count the color of what is left."""
READING: Final = """\
An unknown that is not identifiable keeps its prior: it is listed with the reason, and says nothing about the sensor.
Delays are against the accelerometers; positions are relative to the point whose velocity over ground was logged."""


def compatibility_sheet(result: Compatibility, command: str) -> Sheet:
    """Return the page."""
    warnings = [str(found) for found in of_severity(result.notices, "warning")]
    sections = [
        Section("What is inconsistent", (Bullets(warnings or ["nothing evident"]),)),
        Section("Sensors", (Prose(READING), _estimates(result), _channels(result))),
        Section("Measured and reconstructed", tuple(_figures(result, residual=False))),
        Section("What is left", tuple(_figures(result, residual=True))),
    ]
    notes = [str(found) for found in of_severity(result.notices, "info")]
    if notes:
        sections.append(Section("Notes", (Bullets(notes),)))
    return Sheet(
        f"Data compatibility of {result.flight}", LEAD, (*sections, Section("Made by", (Code(command),)))
    )


def _estimates(result: Compatibility) -> Table:
    head = ("unknown", "estimate", "std error", "if white", "prior", "unit", "what it is", "identifiable")
    return Table(
        "Estimates with standard errors", head, tuple(_row(n, one) for n, one in result.findings.items())
    )


def _row(name: str, one: Finding) -> tuple[str, ...]:
    factor, unit = factor_and_unit(one.unit)
    value, error = rounded_to_error(factor * one.estimate, factor * one.std_error)
    prior = f"{number(factor * one.prior_mean, 2)} ± {number(factor * one.prior_std, 2)}"
    identifiable = "yes" if one.identifiable else f"no: {one.reason}"
    return (
        name,
        value,
        error,
        number(factor * one.cramer_rao, 2),
        prior,
        unit or NOTHING,
        one.meaning,
        identifiable,
    )


def _channels(result: Compatibility) -> Table:
    rows = []
    for name, one in result.channels.items():
        factor, unit = factor_and_unit(one.unit)
        rows.append((name, number(factor * one.rms, 3), number(factor * one.movement, 3), unit))
    head = ("channel", "rms left", "rms movement", "unit")
    return Table(
        "Measured minus reconstructed, beside how much the channel moves within the pieces", head, tuple(rows)
    )


def _figures(result: Compatibility, *, residual: bool) -> list[Figure]:
    what = (
        "measured minus reconstructed"
        if residual
        else "measured (first) and reconstructed from rates and accelerations"
    )
    out = []
    for title, names in GROUPS:
        there = [name for name in names if name in result.channels]
        if there:
            strips = [_strip(result, name, residual) for name in there]
            spans = ", ".join(window(float(t.time[0]), float(t.time[-1])) for t in result.traces)
            caption = f"{title}: {what}."
            drawn = stacked_plots(strips, "time, s", caption)
            out.append(Figure(f"{caption} Pieces: {spans}.", drawn))
    return out


def _strip(result: Compatibility, name: str, residual: bool) -> Strip:
    factor, unit = factor_and_unit(result.channels[name].unit)
    time = _joined([trace.time for trace in result.traces])
    measured = factor * _joined([trace.measured[name] for trace in result.traces])
    simulated = factor * _joined([_compared(trace, name) for trace in result.traces])
    label = f"{name}, {unit}"
    if residual:
        turn = factor * 2.0 * np.pi if name in ("phi", "psi") else np.inf
        left = measured - simulated
        left = left - turn * np.round(left / turn) if np.isfinite(turn) else left
        return Strip(label, (Series("measured minus reconstructed", time, left),))
    return Strip(label, (Series("measured", time, measured), Series("reconstructed", time, simulated)))


def _compared(trace: Trace, name: str) -> FloatArray:
    """Return the reconstruction where it was compared: outside, a delayed reading has no past."""
    return np.where(np.isfinite(trace.measured[name]), trace.reconstructed[name], np.nan)


def _joined(parts: Sequence[FloatArray]) -> FloatArray:
    """Join pieces with a NaN between them, which breaks the curve."""
    return np.concatenate([np.append(part, np.nan) for part in parts])

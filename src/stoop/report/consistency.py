"""The page of a compatibility check: what contradicts, what each sensor is off by, measured over reconstructed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import of_severity
from stoop.base.numbers import NOTHING, factor_and_unit, number, rounded_to_error, window
from stoop.reconstruct.compatibility import Compatibility, Finding, Trace
from stoop.report.plots import Series, Strip, stacked_plots
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table

GROUPS: Final = (
    ("Attitude", ("phi", "theta", "psi")),
    ("Velocity over ground", ("vn", "ve", "vd")),
    ("Position", ("pn", "pe", "pd")),
    ("Air data", ("V", "airspeed_pitot", "alpha", "beta")),
)
_LEAD: Final = """\
Accelerations and rates were integrated from one initial state per piece; what the other sensors logged was held against
that. Biases, scales, delays, positions and a steady wind were estimated such that all agree as well as they can; the
standard errors count the color of what is left."""
_READ: Final = """\
An unknown that the data do not see keeps its prior: it stands here with the reason, and is no statement about the sensor.
Delays are against the accelerometers; positions are relative to the point whose velocity over ground was logged."""


def consistency_sheet(result: Compatibility, command: str) -> Sheet:
    """Return the page."""
    warnings = [str(found) for found in of_severity(result.notices, "warning")]
    sections = [
        Section("What is inconsistent", (Prose(_listed(warnings or ("nothing evident",))),)),
        Section("Sensors", (Prose(_READ), _estimates(result), _channels(result))),
        Section("Measured and reconstructed", tuple(_figures(result, residual=False))),
        Section("What is left", tuple(_figures(result, residual=True))),
    ]
    notes = [str(found) for found in of_severity(result.notices, "info")]
    if notes:
        sections.append(Section("Notes", (Prose(_listed(notes)),)))
    return Sheet(
        f"Data compatibility of {result.flight}", _LEAD, (*sections, Section("Made by", (Code(command),)))
    )


def _listed(lines: Sequence[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def _estimates(result: Compatibility) -> Table:
    head = ("unknown", "estimate", "std error", "if white", "prior", "unit", "what it is", "told by the data")
    return Table(
        "Estimates with standard errors", head, tuple(_row(n, one) for n, one in result.findings.items())
    )


def _row(name: str, one: Finding) -> tuple[str, ...]:
    factor, unit = factor_and_unit(one.unit)
    value, error = rounded_to_error(factor * one.estimate, factor * one.std_error)
    prior = f"{number(factor * one.prior_mean, 2)} ± {number(factor * one.prior_std, 2)}"
    told = "yes" if one.identifiable else f"no: {one.reason}"
    return name, value, error, number(factor * one.cramer_rao, 2), prior, unit or NOTHING, one.meaning, told


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
            words = f"{title}: {what}."
            out.append(Figure(f"{words} Pieces: {spans}.", stacked_plots(strips, "time, s", words)))
    return out


def _strip(result: Compatibility, name: str, residual: bool) -> Strip:
    factor, unit = factor_and_unit(result.channels[name].unit)
    time = _joined([trace.time for trace in result.traces])
    measured = factor * _joined([trace.measured[name] for trace in result.traces])
    simulated = factor * _joined([_shown(trace, name) for trace in result.traces])
    label = f"{name}, {unit}"
    if residual:
        turn = factor * 2.0 * np.pi if name in ("phi", "psi") else np.inf
        left = measured - simulated
        left = left - turn * np.round(left / turn) if np.isfinite(turn) else left
        return Strip(label, (Series("measured minus reconstructed", time, left),))
    return Strip(label, (Series("measured", time, measured), Series("reconstructed", time, simulated)))


def _shown(trace: Trace, name: str) -> FloatArray:
    """Return the reconstruction where it was compared: outside, a delayed reading has no past."""
    return np.where(np.isfinite(trace.measured[name]), trace.reconstructed[name], np.nan)


def _joined(parts: Sequence[FloatArray]) -> FloatArray:
    """Join pieces with a NaN between them, which breaks the curve."""
    return np.concatenate([np.append(part, np.nan) for part in parts])

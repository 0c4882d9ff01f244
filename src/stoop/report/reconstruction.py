"""The page of a reconstructed flight path: the compatibility of the sensors."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import of_severity
from stoop.base.numbers import NOTHING, factor_and_unit, number, rounded_to_error
from stoop.base.variables import VARIABLES, WRAPPED
from stoop.reconstruction.compatibility import Compatibility
from stoop.report.series import Series, Shade
from stoop.report.sheet import Bullets, Code, Prose, Section, Sheet, Table
from stoop.report.time_history import HistoryPanel, TimeHistory, holes, with_residual

COMPATIBILITY_LEAD: Final = """\
Accelerations and rates were integrated from one initial state per piece; the readings of the other sensors were compared
with that. Biases, scales, delays, positions and a steady wind were estimated such that all agree as well as they can; the
standard errors count the color of what is left."""
READING: Final = """\
An unknown that is not identifiable keeps its prior: it is listed with the reason, and says nothing about the sensor.
Delays are against the accelerometers; positions are relative to the point whose velocity over ground was logged."""
TRACES: Final = """\
Reconstructed from rates and accelerations, against time in s; below each channel what is left. Grey: not used."""


def compatibility_sheet(result: Compatibility, command: str) -> Sheet:
    """Return the page: contradictions, errors of each sensor, measured over reconstructed."""
    estimates, channels = [], []
    for name, one in result.findings.items():
        factor, unit = factor_and_unit(one.unit)
        value, error = rounded_to_error(factor * one.estimate, factor * one.std_error)
        white = number(factor * one.cramer_rao, 2)
        prior = f"{number(factor * one.prior_mean, 2)} ± {number(factor * one.prior_std, 2)}"
        identifiable = "yes" if one.identifiable else f"no: {one.reason}"
        estimates.append((name, value, error, white, prior, unit or NOTHING, one.meaning, identifiable))
    for name, left in result.channels.items():
        factor, unit = factor_and_unit(left.unit)
        channels.append((name, number(factor * left.rms, 3), number(factor * left.movement, 3), unit))
    head = ("unknown", "estimate", "std error", "if white", "prior", "unit", "what it is", "identifiable")
    caption = "Measured minus reconstructed, beside how much the channel moves within the pieces"
    residuals = Table(caption, ("channel", "rms left", "rms movement", "unit"), tuple(channels))
    sensors = (Prose(READING), Table("Estimates with standard errors", head, tuple(estimates)), residuals)
    inconsistent = Bullets(of_severity(result.notices, "warning") or ["nothing evident"])
    sections = [
        Section("What is inconsistent", (inconsistent,)),
        Section("Sensors", sensors),
        Section("Measured and reconstructed", (Prose(TRACES), compatibility_history(result))),
    ]
    notes = of_severity(result.notices, "info")
    sections += [Section("Notes", (Bullets(notes),))] if notes else []
    sections.append(Section("Made by", (Code(command),)))
    return Sheet(f"Data compatibility of {result.flight}", COMPATIBILITY_LEAD, tuple(sections))


def compatibility_history(result: Compatibility) -> TimeHistory:
    """Return measured and reconstructed channels, and their difference below.

    The reconstruction is drawn where it was compared: outside, a delayed reading has no past.
    """

    def joined(parts: list[FloatArray]) -> FloatArray:
        """Join pieces with a NaN between them, which breaks the curve."""
        return np.concatenate([np.append(part, np.nan) for part in parts])

    panels, time = [], joined([t.time for t in result.traces])
    for name, left in result.channels.items():
        factor, unit = factor_and_unit(left.unit)
        pieces = [(t.measured[name], t.reconstructed[name]) for t in result.traces]
        measured = factor * joined([z for z, _ in pieces])
        simulated = factor * joined([np.where(np.isfinite(z), y, np.nan) for z, y in pieces])
        difference = measured - simulated
        if name in WRAPPED:
            turn = factor * 2.0 * np.pi
            difference -= turn * np.round(difference / turn)
        above = Series("reconstructed", time, simulated, role="fit")
        curves = (Series("measured", time, measured, role="measured", width=2.8), above)
        strips = with_residual(curves, "measured − reconstructed", difference)
        panels.append(HistoryPanel(name, strips, unit, VARIABLES[name].meaning if name in VARIABLES else ""))
    gaps = [Shade(*gap, "", "hole") for gap in holes(time)]
    return TimeHistory(panels, "--maneuver ", gaps)

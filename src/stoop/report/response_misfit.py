"""Frequency responses of the flights that the model misses, as a section of the report."""

from __future__ import annotations

from typing import Final

from stoop.base.numbers import number
from stoop.report.model import Model
from stoop.report.sheet import Prose, Section, Table

LEAD: Final = (
    "Frequency response of the residuals to each input, over that of the measured rate, from all maneuvers fitted and held back, "
    "at the frequencies at which the flights show it (coherence 0.6 and more). A model that holds leaves nothing. Of the missed "
    "share random error is taken off; at least: the largest random error of about forty."
)
HEAD: Final = ("Rate", "Input", "From rad/s", "To rad/s", "Coherence", "Missed %", "At least %")


def responses_section(identification: Model) -> Section | None:
    """Return what the model misses of each frequency response; None where the flights show none."""
    rows = tuple(
        (
            one.output, one.input, number(one.low, 3), number(one.high, 3), f"{one.coherence:.2f}",
            f"{100.0 * one.share:.1f}", f"{100.0 * one.least:.1f}",
        )
        for one in identification.result.response_misfits
    )  # fmt: skip
    if not rows:
        return None
    table = Table("", HEAD, rows, ("", "", "n", "n", "n", "n", "n"), label="Frequency responses")
    return Section("Frequency responses", (Prose(LEAD, muted=True), table))

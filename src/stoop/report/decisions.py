"""Decisions that a fit took by itself, as a section of the report."""

from __future__ import annotations

import math
from typing import Final

from stoop.base.numbers import NOTHING
from stoop.report.model import Model
from stoop.report.sheet import Prose, Section, Table

LEAD: Final = (
    "What the fit decided by itself, in order. Each decision can be switched off with --without NAME, all of them with "
    "--textbook."
)
HEAD: Final = ("Decision", "Found", "Done", "Log-likelihood", "Held back", "Seconds")


def decisions_section(identification: Model) -> Section | None:
    """Return the decisions that applied, and which did not; None for a result of an older version."""
    found = identification.result.decisions
    if not found:
        return None
    rows = [
        (one.name, one.found, one.done, _gain(one.gained), _gain(one.held_back), f"{one.seconds:.1f}")
        for one in found
        if one.state == "applied"
    ]
    kinds = ("", "wrap", "wrap", "n", "n", "n")
    table = [Table("", HEAD, tuple(rows), kinds, label="Decisions")] if rows else []
    others = {state: [one.name for one in found if one.state == state] for state in ("not needed", "off")}
    rest = "; ".join(f"{state}: {', '.join(names)}" for state, names in others.items() if names)
    return Section(
        "Decisions", [Prose(LEAD, muted=True), *table, Prose(f"{rest}.".capitalize())], "Decisions"
    )


def _gain(value: float) -> str:
    return f"{value:+.1f}" if math.isfinite(value) else NOTHING

"""What the fit decided by itself and what the model lacks, as sections: decisions, extensions, responses that it misses."""

from __future__ import annotations

import math
from typing import Final

from stoop.base.numbers import NOTHING, number, readable_unit, rounded_to_error
from stoop.report.model import Model
from stoop.report.sheet import Code, Part, Prose, Section, Table
from stoop.results.extensions import ExtensionTest

LEAD: Final = (
    "Score tests of {tested} extensions of the model, each beside all unknowns of the fit, residuals taken as colored; of a "
    "right model at most one fit in {chance:.0f} names any. What stands below the first may be its consequence: the last "
    "statistic is what is left of it once the first has been added."
)
HEAD: Final = (
    "Extension", "Value", "± Std. error", "Unit", "Statistic t", "Log-likelihood", "Beside the first", "Not distinguished from",
    "Parameters that would move, standard errors",
)  # fmt: skip
RESPONSES_LEAD: Final = (
    "Frequency response of the residuals to each input, over that of the measured rate, from all maneuvers fitted and held back, "
    "at the frequencies at which the flights show it (coherence 0.6 and more). A model that holds leaves nothing. Of the missed "
    "share random error is taken off; at least: the largest random error of about forty."
)
RESPONSES_HEAD: Final = ("Rate", "Input", "From rad/s", "To rad/s", "Coherence", "Missed %", "At least %")
DECISIONS_LEAD: Final = (
    "What the fit decided by itself, in order. Each decision can be switched off with --without NAME, all of them with "
    "--textbook."
)
DECISIONS_HEAD: Final = ("Decision", "Found", "Done", "Log-likelihood", "Held back", "Seconds")


def extensions_section(identification: Model) -> Section | None:
    """Return the significant extensions; None where nothing was tested."""
    found = identification.result.extensions
    if not found.tested:
        return None
    lead = LEAD.format(tested=found.tested, chance=1.0 / found.level)
    parts: list[Part] = [Prose(lead, muted=True)]
    if not found.found:
        parts.append(Prose("None is significant: these data ask for nothing that the model lacks."))
        return Section("What the model lacks", parts, "Extensions")
    kinds = ("", "n", "n", "", "n", "n", "n", "wrap", "wrap")
    parts += [
        Table("", HEAD, tuple(map(_row, found.found)), kinds, label="Extensions"),
        Prose("To add the first, write into the vehicle file, or identify again with --extend:"),
        Code(as_toml(found.found[0].line)),
    ]
    return Section("What the model lacks", parts, "Extensions")


def as_toml(line: str) -> str:
    """Return the line of an extension as it stands in a vehicle file: each table once, its keys below."""
    tables: dict[str, list[str]] = {}
    for part in line.split("; "):
        head, _, entry = part.partition("] ")
        tables.setdefault(f"{head}]", []).append(entry)
    return "\n".join(text for head, entries in tables.items() for text in (head, *entries))


def _row(one: ExtensionTest) -> tuple[str, ...]:
    value, error = rounded_to_error(one.value, one.std_error)
    beside = number(one.beside, 3) if math.isfinite(one.beside) else NOTHING
    moves = ", ".join(f"{name}\N{NO-BREAK SPACE}{shift:+.1f}" for name, shift in one.moves.items())
    return (
        one.name, value, error, readable_unit(one.unit), number(one.statistic, 3), f"+{one.gain:.0f}", beside,
        ", ".join(one.rivals) or NOTHING, moves or NOTHING,
    )  # fmt: skip


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
    table = Table("", RESPONSES_HEAD, rows, ("", "", "n", "n", "n", "n", "n"), label="Frequency responses")
    return Section("Frequency responses", (Prose(RESPONSES_LEAD, muted=True), table))


def decisions_section(identification: Model) -> Section | None:
    """Return the decisions that applied, and which did not; None for a result of an older version."""
    found = identification.result.decisions
    if not found:
        return None
    rows = []
    for one in (one for one in found if one.state == "applied"):
        gains = _gain(one.gained), _gain(one.held_back)
        rows.append((one.name, one.found, one.done, *gains, f"{one.seconds:.1f}"))
    kinds = ("", "wrap", "wrap", "n", "n", "n")
    table = [Table("", DECISIONS_HEAD, tuple(rows), kinds, label="Decisions")] if rows else []
    others = {state: [one.name for one in found if one.state == state] for state in ("not needed", "off")}
    rest = "; ".join(f"{state}: {', '.join(names)}" for state, names in others.items() if names)
    parts: list[Part] = [Prose(DECISIONS_LEAD, muted=True), *table, Prose(f"{rest}.".capitalize())]
    return Section("Decisions", parts, "Decisions")


def _gain(value: float) -> str:
    return f"{value:+.1f}" if math.isfinite(value) else NOTHING

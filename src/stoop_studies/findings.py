"""The setting of a study and its findings: claims compared with numbers, tables, the page that shows both."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from stoop.base.csv_text import Cell, csv_text
from stoop.parallel import Plan
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table

#: longer tables are left to the CSV file
MAX_ROWS: Final = 150
CLAIMS_HEAD: Final = ("verdict", "statement: what was measured")
Results = Mapping[str, Any]
#: name of a column -> its cell
Record = Mapping[str, Cell]
#: names of the columns, rows under them
Numbers = tuple[tuple[str, ...], tuple[tuple[Cell, ...], ...]]
Part = Table | Figure | Code | Prose


@dataclass(frozen=True)
class Setting:
    """Choices of the user: seeds per case, the first seed, and for some studies more.

    ``box`` (N, S or W) selects the bounds of the paper's problem; ``data`` is a folder of published data.
    """

    runs: int
    seed: int = 0
    box: str = "N"
    data: Path | None = None

    @property
    def seeds(self) -> range:
        """All seeds."""
        return range(self.seed, self.seed + self.runs)


@dataclass(frozen=True)
class Claim:
    """A statement, its verdict ("holds", "does not hold", "reproduces", "does not reproduce"), and the figures."""

    statement: str
    verdict: str
    figures: str

    @property
    def line(self) -> str:
        """All of it in one line."""
        return f"{self.verdict}: {self.statement} ({self.figures})"


def reproduces(statement: str, so: bool, figures: str) -> Claim:
    """Return the verdict on a statement or a number of the paper."""
    return Claim(statement, "reproduces" if so else "does not reproduce", figures)


def holds(statement: str, so: bool, figures: str) -> Claim:
    """Return the verdict on anything else."""
    return Claim(statement, "holds" if so else "does not hold", figures)


@dataclass(frozen=True)
class Findings:
    """The findings of one study: claims, sections of its page, the table (head, rows) of the CSV file, further tables by name."""

    title: str
    claims: tuple[Claim, ...]
    sections: tuple[Section, ...]
    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    parts: Mapping[str, Numbers] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        title: str,
        claims: Iterable[Claim],
        records: Sequence[Record],
        parts: Mapping[str, Sequence[Record]] | None = None,
        summary: Sequence[Record] = (),
        figures: Iterable[Part] = (),
    ) -> Findings:
        """Return findings from records: the page shows summary, figures and the tables of the CSV files."""
        named = {"Summary": summary, "All cases": records, **(parts or {})}
        tables = [table_of(name.capitalize(), own) for name, own in named.items() if own]
        kept = [table for table in tables if len(table.rows) <= MAX_ROWS]
        sections = (Section("Measured", (*kept[: bool(summary)], *figures, *kept[bool(summary) :])),)
        own = {n: (tuple(p[0]) if p else (), _values(p)) for n, p in (parts or {}).items()}
        return cls(title, tuple(claims), sections, tuple(records[0]), _values(records), own)

    @property
    def csv(self) -> str:
        """The numbers as text."""
        return csv_text(self.head, self.rows)

    def part(self, name: str) -> str:
        """Return the numbers of a further table as text."""
        return csv_text(*self.parts[name])

    def sheet(self, command: str, lead: str) -> Sheet:
        """Return the page; at its end stands the command that makes it."""
        table = Table("Each statement compared with the numbers below", CLAIMS_HEAD, claim_rows(self.claims))
        verdicts = Section("Claims", (table,))
        made = Section("Made by", (Code(command),))
        return Sheet(self.title, lead, (verdicts, *self.sections, made))


def _values(records: Sequence[Record]) -> tuple[tuple[Cell, ...], ...]:
    return tuple(tuple(record.values()) for record in records)


class Experiment(Protocol):
    """A study: its runs, and the findings from their results."""

    @property
    def name(self) -> str:
        """As on the command line."""

    @property
    def runs(self) -> int:
        """Seeds per case when none are asked for."""

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the further tables that it writes."""

    def plan(self, setting: Setting) -> Plan | None:
        """Return all runs; None where there is nothing that takes long."""

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return the findings from the results of the runs, by key."""


def claim_rows(claims: Sequence[Claim]) -> tuple[tuple[str, ...], ...]:
    """Return the cells under `CLAIMS_HEAD`."""
    return tuple((c.verdict, f"{c.statement}: {c.figures}") for c in claims)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as a page shows it; a dash for None and for what is not finite."""
    if value is None or not np.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text.replace("-", "−")
    mantissa, exponent = text.split("e")
    return f"{mantissa}e{int(exponent)}".replace("-", "−")


def counted(many: int, whole: int) -> str:
    """Return ``many of whole``."""
    return f"{many} of {whole}"


def table_of(caption: str, records: Sequence[Record]) -> Table:
    """Return the table of records on a page: numbers to four digits."""

    def cell(value: Cell) -> str:
        if value is None or isinstance(value, float):
            return number(value, 4)
        return ("no", "yes")[value] if isinstance(value, bool) else str(value)

    rows = tuple(tuple(map(cell, record.values())) for record in records)
    return Table(caption, tuple(name.replace("_", " ") for name in records[0]), rows)

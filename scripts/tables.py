"""Write the tables of documentation pages that are rows of a committed CSV file.

    python3 scripts/tables.py           # rewrite them
    python3 scripts/tables.py --check   # exit with 1, naming each page whose table differs

A comment before a table of a page says where its rows come from, and gives one row as a template::

    <!-- rows of verify/jsbsim.csv where aircraft = c172p
    | `{parameter}` | {jsbsim:.4g} | {difference_percent:+.1f} | {coverage:%.1f} |
    -->
    | derivative | JSBSim | difference, % | coverage, % |
    | --- | --- | --- | --- |

``where COLUMN`` keeps rows with an entry there, ``where COLUMN = VALUE`` those with that entry. After a colon stands a
format of Python for the number; ``%`` in front of it multiplies by 100, ``.Ng`` gives N significant digits. A format
that begins with ``+`` or ends in ``g`` writes a true minus. An empty cell is a dash.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
from pathlib import Path
from string import Formatter
from typing import Any

DOCS = Path(__file__).parents[1] / "docs"
TABLE = re.compile(
    r"^<!-- rows of (?P<file>\S+)(?: where (?P<column>\w+)(?: = (?P<value>[^\n]+))?)?\n"
    r"(?P<template>\|[^\n]*\|)\n-->\n(?P<head>\|[^\n]*\n\|[ :|-]+\n)(?P<rows>(?:\|[^\n]*\n)*)",
    re.MULTILINE,
)
POWER = re.compile(r"e(-?)\+?0*(?=\d)")
NOTHING = "–"
MINUS = "−"


class Cells(Formatter):
    """Fill a template with the cells of a row."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return a cell in a format."""
        if not value or not format_spec:
            return value or NOTHING
        number, spec = float(value), format_spec
        if spec.startswith("%"):
            number, spec = 100.0 * number, spec[1:]
        shown = POWER.sub("e\\1", format(number, spec))
        return shown.replace("-", MINUS) if spec.startswith("+") or spec.endswith("g") else shown


def table(found: re.Match[str], docs: Path) -> str:
    """Return a table as it should be, with the comment before it."""
    with (docs / found["file"]).open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    column, value = found["column"], found["value"]
    kept = [row for row in rows if not column or (row[column] == value if value else row[column])]
    written = "".join(f"{Cells().vformat(found['template'], (), row)}\n" for row in kept)
    return found[0].removesuffix(found["rows"]) + written


def main(arguments: list[str] | None = None, docs: Path = DOCS) -> int:
    """Rewrite all tables, or check them."""
    parser = argparse.ArgumentParser(
        description="Write the tables of the documentation from their CSV files."
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a table differs")
    check = parser.parse_args(arguments).check
    differ = 0
    for page in sorted(docs.glob("*.md")):
        text = page.read_text(encoding="utf-8")
        if text.count("<!-- rows of ") != len(TABLE.findall(text)):
            sys.exit(f"{page.name}: a comment 'rows of' is not followed by a table; see scripts/tables.py")
        for found in TABLE.finditer(text):
            if table(found, docs) != found[0]:
                differ += 1
                print(f"{page.name}: the table of {found['file']} differs; run python3 scripts/tables.py")
        if not check:
            page.write_text(TABLE.sub(lambda one: table(one, docs), text), encoding="utf-8")
    return int(check and differ > 0)


if __name__ == "__main__":
    sys.exit(main())

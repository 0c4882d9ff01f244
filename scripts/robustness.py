"""Write the counts of docs/verify/robustness.csv, which `stoop verify robustness` leaves, into docs/robustness.md."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final

from stoop_studies.verify.robustness import FAILED, FAMILIES, SURFACES

DOCS: Final = Path(__file__).parents[1] / "docs"
BEGIN, END = "<!-- counts: written by scripts/robustness.py -->", "<!-- end of counts -->"
COLUMNS: Final = {
    "cases": "cases", "refused": "one-line error", "listed": "read, defects listed", "unnoticed": "read, damage undetected",
    "same": "the same as undamaged", "read": "read", "limit": "refused for its memory",
    "contained": "third-party code crashed or hung", FAILED: "failed",
}  #: column of the table -> heading on the page  # fmt: skip
FIRST: Final = next(iter(SURFACES))


def tables(counts: Path) -> str:
    """Return the counts as Markdown, a table for each family; columns without a case are left out."""
    with counts.open(newline="", encoding="utf-8") as file:
        records = list(csv.DictReader(file))
    total, failed = (sum(int(record[key]) for record in records) for key in ("cases", FAILED))
    slices = sum(int(one["cases"]) for one in records if one["surface"] == FIRST) // SURFACES[FIRST].count
    parts = [f"The counts of {slices} slices: {total:,} cases, of which {failed} failed."]
    for family, described in FAMILIES.items():
        rows: dict[str, list[int]] = {}
        for record in records:
            if record["family"] == family:
                sums = rows.setdefault(record["surface"], [0] * len(COLUMNS))
                rows[record["surface"]] = [
                    so_far + int(record[key]) for so_far, key in zip(sums, COLUMNS, strict=True)
                ]
        if rows:
            parts.append(f"### {family[0].upper()}{family[1:]}\n\n{described.procedure}\n\n{_table(rows)}")
    return "\n\n".join(parts)


def _table(rows: dict[str, list[int]]) -> str:
    rows = {**rows, "all": [sum(column) for column in zip(*rows.values(), strict=True)]}
    kept = [k for k, name in enumerate(COLUMNS) if rows["all"][k] or name == FAILED]
    head = ["", *(list(COLUMNS.values())[k] for k in kept)]
    lines = [head, ["---"] * len(head)]
    lines += [[name, *(f"{counts[k]:,}".replace(",", " ") for k in kept)] for name, counts in rows.items()]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def page(text: str, counts: Path = DOCS / "verify" / "robustness.csv") -> str:
    """Return the page with its counts written anew."""
    before, _, rest = text.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{tables(counts)}\n\n{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    path = DOCS / "robustness.md"
    path.write_text(page(path.read_text(encoding="utf-8")), encoding="utf-8")

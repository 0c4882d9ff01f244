"""Write docs/notices.md, the list of all notices, from src/stoop/data/notices.toml."""

from __future__ import annotations

from pathlib import Path

from stoop.base.notices import table

PAGE = Path(__file__).parents[1] / "docs" / "notices.md"
LEAD = """\
# Notices

What stoop finds in a log, a mapping, a vehicle file or a fit is a notice: a code, a severity, a subject and
values (SI, radians). `result.json` holds them as data (`notices`), terminal and report as sentences. Severity
`warning` makes a result doubtful; `info` says what was done to the data or what a figure rests on. This page
is made from `src/stoop/data/notices.toml` by `python scripts/notices.py`.
"""
TITLES = {
    "log": "Logs",
    "mapping": "Mappings",
    "flight": "Flights",
    "vehicle": "Vehicles",
    "fit": "Fits",
    "assessment": "Error bars and other assessments",
    "design": "Experiment design",
}


def page() -> str:
    """Return the page as Markdown."""
    parts = [LEAD]
    for topic, title in TITLES.items():
        rows = [
            f"| `{code}` | {kind.severity} | {kind.text.replace('|', chr(92) + '|')} |"
            for code, kind in sorted(table().items())
            if kind.topic == topic
        ]
        if rows:
            parts.append(
                "\n".join(
                    [f"## {title}\n", "| code | severity | sentence |", "| --- | --- | --- |", *rows, ""]
                )
            )
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

"""`stoop map`: a mapping drafted of a log, or corrected."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.extend.files import to_json, write_file
from stoop.extend.verbs import LiveLine, page

MOST_LISTED = 40  #: columns that were not recognized


def map_log(arguments: argparse.Namespace) -> int:
    """Draft a mapping of a log, or correct one; print or write it, and with ``--json`` print the columns of the log too."""
    output, applied = arguments.output, arguments.apply
    with LiveLine("reading the log"):
        text, lines = _drafted(arguments.flight) if applied is None else _corrected(arguments.flight, applied)
        document = _columns(arguments.flight, text, lines) if arguments.json else ""
    if output is not None:
        write_file(output, text)
    if document or output is None:
        page().text(document or text.removesuffix("\n"))
        return 0
    out, (first, *others) = page(), lines
    out.line(f"{output}: {first}")
    out.bullets(others)
    out.command("next: ", ["stoop", "info", str(arguments.flight), "--mapping", str(output)])
    return 0


def _columns(log: Path, text: str, lines: list[str]) -> str:
    """Return a mapping, what is said of it, and the columns of its log, as JSON."""
    from stoop.extend.recordings import read_unmapped
    from stoop_draft.log_columns import columns_of

    return to_json({"mapping": text, "said": lines, "columns": [*columns_of(read_unmapped(log))]})


def _drafted(log: Path) -> tuple[str, list[str]]:
    """Return a draft, and what is said of it."""
    from stoop_draft.mapping_draft import draft

    made = draft(log)
    rest = f" and {len(made.unknown) - MOST_LISTED} more" * (len(made.unknown) > MOST_LISTED)
    unknown = [f"not recognized: {', '.join(made.unknown[:MOST_LISTED])}{rest}"] if made.unknown else []
    return made.text, [f"{made.mapped} variables, {made.unsure} of them unsure", *unknown]


def _corrected(log: Path, mapping: Path) -> tuple[str, list[str]]:
    """Return a mapping with the advice of the checks applied, and what is said of it."""
    from stoop_draft.mapping_corrections import corrected_mapping

    made = corrected_mapping(log, mapping)
    said = [f"applied: {one}" for one in made.applied] + [f"left to you: {one}" for one in made.left]
    confirmed = ", each confirmed by the log" if made.applied else ""
    return made.text, [f"corrections applied: {len(made.applied)}{confirmed}", *said]

"""`stoop info`: what a flight log holds."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from stoop.cli import options
from stoop.cli.page import alike, busy, fixed, numbers, page, points, shown_unit, to_json, words

if TYPE_CHECKING:
    from stoop.flight import FlightSummary, Maneuver

MAX_STREAMS, MAX_NAMES = 12, 24  #: lines and names shown of what is not mapped; JSON holds all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    options.add_flight(parser, "flight log", several=False)
    parser.add_argument("--json", action="store_true", help="print JSON (SI units, rad) instead of tables")


def run(arguments: argparse.Namespace) -> int:
    """Read, describe, print."""
    from stoop.flight import describe, load

    with busy("reading the log"):
        summary = describe(load(arguments.flight, arguments.mapping))
    if arguments.json:
        print(to_json(info_document(summary)))
        return 0
    flight, out = summary.flight, page()
    start, stop = float(flight.time[0]), float(flight.time[-1])
    out.line(str(arguments.flight))
    span = f"{start:.2f} to {stop:.2f} s on the log's own clock ({stop - start:.2f} s)"
    out.line(f"{span}, {flight.rate:g} Hz grid")
    full = [row for row in summary.rows if row.missing < 1.0]
    if full:
        out.heading("Sources")
        alike_recorded: dict[tuple[str, float, int, float], list[str]] = {}
        for row in full:
            key = (row.source, row.rate, row.gaps, row.longest_gap)
            alike_recorded.setdefault(key, []).append(row.variable)
        sources, rates, gaps, longest = zip(*alike_recorded, strict=True)
        names = [" ".join(group) for group in alike_recorded.values()]
        out.table(
            words("source", sources), fixed("Hz", rates, 1), fixed("gaps", gaps, 0), fixed("longest s", longest, 3),
            words("channels", names, wraps=True),
        )  # fmt: skip
        out.heading("Channels")
        low, middle, high = zip(*(alike((r.minimum, r.median, r.maximum)) for r in full), strict=True)
        out.table(
            words("", [row.variable for row in full]),
            words("unit", [shown_unit(row.unit) for row in full]),
            points("lowest", low),
            points("median", middle),
            points("highest", high),
            words("missing", [_percent(row.missing) for row in full]),
            words("meaning", [row.meaning for row in full]),
        )
    empty = [row.variable for row in summary.rows if row not in full]
    if empty:
        out.heading(f"Without any value: {' '.join(empty)}")
    faults = [fault.notice for fault in flight.faults]
    out.bullets(faults or ["none found"], "Suspected faults")
    out.heading("Candidate maneuvers")
    found = summary.maneuvers
    if found:
        out.table(
            words("window s", map(_window, found)),
            words("axis", [m.axis for m in found]),
            words("by", [m.variable for m in found]),
            numbers("amplitude", [m.amplitude for m in found]),
            fixed("swings", [m.swings for m in found], 0),
            points("times usual", [f"{m.strength:.1f}" if m.strength < 100.0 else ">100" for m in found]),
            words("recorded", [_percent(m.whole) for m in found]),
        )
        out.line()
        out.command("next: ", options.identify_command(arguments, "result", **windows_apart(found)))
        source = options.source_arguments([arguments.flight], arguments.mapping)
        informed = ["stoop", "maneuvers", *source, "--vehicle", "V.toml", "-o", "windows"]
        out.command("or, chosen by their information: ", informed)
    else:
        out.bullets(
            ["none found: no control stands out from how it is usually moved here, or none was recorded"]
        )
    out.bullets([one for one in summary.notices if one not in faults], "Notes")
    out.bullets(unmapped_lines(flight.unmapped), "Not mapped")
    return 0


def info_document(summary: FlightSummary) -> dict[str, Any]:
    """Return what is known of a flight for JSON, SI and rad; time histories and notes of its air data stand elsewhere."""
    flight = summary.flight
    own = {} if flight.air is None else vars(flight.air)
    air = {k: v for k, v in own.items() if k not in ("traces", "notices")} or None
    return {
        "format": "stoop-info/1",
        "name": flight.name,
        "path": None if flight.path is None else str(flight.path),
        "start": float(flight.time[0]),
        "stop": float(flight.time[-1]),
        "rate": flight.rate,
        "channels": [asdict(row) for row in summary.rows],
        "faults": [fault.to_dict() for fault in flight.faults],
        "maneuvers": [asdict(maneuver) for maneuver in summary.maneuvers],
        "air": air,
        "unmapped": flight.unmapped,
        "notes": [str(found) for found in summary.notices],
    }


def unmapped_lines(unmapped: Mapping[str, Sequence[str]]) -> list[str]:
    """Say which columns no mapping names, and which streams were not looked into; long lists are cut."""

    def some(names: Sequence[str]) -> str:
        more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
        return " ".join(names[:MAX_NAMES]) + more

    lines = [f"{stream}: {some(columns)}" for stream, columns in unmapped.items() if columns]
    whole = [stream for stream, columns in unmapped.items() if not columns]
    if len(lines) > MAX_STREAMS:
        lines[MAX_STREAMS:] = [f"and {len(lines) - MAX_STREAMS} more"]
    return lines + ([f"not read: {some(whole)}"] if whole else [])


def _percent(share: float) -> str:
    return f"{100.0 * share:5.1f} %" if share > 0.0 else ""


def windows_apart(found: Sequence[Maneuver]) -> dict[str, list[str]]:
    """Return windows to fit, the most completely recorded maneuver of each axis, and the others to validate.

    Windows that overlap (one's calm end is the next one's beginning) are cut in the middle.
    """
    apart = list(found)
    for i, (one, following) in enumerate(pairwise(found)):
        if following.start < one.stop:
            middle = 0.5 * (following.start + one.stop)
            apart[i : i + 2] = [replace(apart[i], stop=middle), replace(following, start=middle)]
    best = {m.axis: m for m in sorted(apart, key=lambda m: m.whole)}
    fitted = [_window(m) for m in apart if m is best[m.axis]]
    predicted = [_window(m) for m in apart if m is not best[m.axis]]
    return {"maneuver": fitted, "validate": predicted}


def _window(maneuver: Maneuver) -> str:
    """Return START:STOP as `stoop identify --maneuver` takes it."""
    return f"{maneuver.start:.1f}:{maneuver.stop:.1f}"

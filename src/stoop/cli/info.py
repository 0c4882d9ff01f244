"""`stoop info`, `look` and `compatibility`: what a flight log holds, and whether its sensors agree."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from typing import TYPE_CHECKING, Any

from stoop.base.files import check_targets, write_file
from stoop.base.notices import of_severity
from stoop.base.numbers import count, factor_and_unit, number, rounded_to_error
from stoop.base.text import show
from stoop.cli import options
from stoop.cli.page import Page, alike, fixed, numbers, page, points, shown_unit, to_json, words
from stoop.cli.progress import LiveLine

if TYPE_CHECKING:
    from stoop.flight import FlightSummary
    from stoop.flight.maneuvers import ChannelRow
    from stoop.flight.windows import Found, Overview

_INDEX = re.compile(r"\d{1,9}")  #: of an element of an array
MAX_STREAMS, MAX_NAMES = 12, 24  #: lines and names shown of what is not mapped; JSON holds all


def run(arguments: argparse.Namespace) -> int:
    """Read, describe, print."""
    seen = _overview(arguments)
    summary, found = seen.summary, seen.found
    if arguments.output is not None:
        _write_page(arguments, seen)
    if arguments.save is not None:
        from stoop.flight import flight_bytes

        write_file(arguments.save, flight_bytes(summary.flight))
    if arguments.json:
        show(to_json(info_document(summary, found)))
    else:
        _show(arguments, seen)
    return 0


def _show(arguments: argparse.Namespace, seen: Overview) -> None:
    """Print what the flight is good for, then where its channels come from; all that is known of it with --verbose."""
    summary, out = seen.summary, page()
    flight, faults = summary.flight, [fault.notice for fault in summary.flight.faults]
    if arguments.output is not None:
        out.line(f"wrote {arguments.output}")
    start, stop = float(flight.time[0]), float(flight.time[-1])
    out.line(str(arguments.flight))
    span = f"{start:.2f} to {stop:.2f} s on the log's own clock ({stop - start:.2f} s)"
    out.line(f"{span}, {flight.rate:g} Hz grid")
    out.bullets(faults or ["none found"], "Suspected faults")
    out.heading("Candidate maneuvers")
    if seen.found.windows:
        _show_candidates(out, arguments, seen.found)
    else:
        out.bullets([f"none found: {seen.why}"])
    full = [row for row in summary.rows if row.missing < 1.0]
    _show_sources(out, full)
    empty = [row.variable for row in summary.rows if row not in full]
    if empty:
        out.heading(f"Without any value: {' '.join(empty)}")
    notes = [one for one in summary.notices if one not in faults]
    if arguments.verbose:
        _show_channels(out, full)
        out.bullets(notes, "Notes")
        out.bullets(unmapped_lines(flight.unmapped), "Not mapped")
        return
    out.bullets(of_severity(notes, "warning"), "Warnings")
    out.line()
    more = count(len(of_severity(notes, "info")), "note"), count(len(flight.unmapped), "stream")
    out.line(f"--verbose: the range of each channel, {' and '.join(more)} not mapped in full")


def _show_candidates(out: Page, arguments: argparse.Namespace, found: Found) -> None:
    known = [w.maneuver for w in found.windows]
    out.table(
        words("window s", [w.span for w in found.windows]),
        words("use", [w.purpose for w in found.windows]),
        words("axis", [w.axis for w in found.windows]),
        words("by", [m.variable if m else "" for m in known]),
        numbers("amplitude", [m.amplitude if m else math.nan for m in known]),
        points("swings", [f"{m.swings}" if m else "" for m in known]),
        points("times usual", [f"{m.strength:.1f}" if m else "" for m in known]),
        words("recorded", [_percent(m.whole) if m else "" for m in known]),
    )
    out.line()
    out.command("next: ", _following(arguments, found))
    source = options.source_arguments([arguments.flight], arguments.mapping)
    informed = ["stoop", "maneuvers", *source, "--vehicle", "V.toml", "-o", "windows"]
    out.command("or, chosen by their information: ", informed)
    out.command("V.toml is drafted by: ", ["stoop", "vehicle", "new", *source, "-o", "V.toml"])


def _show_sources(out: Page, rows: Sequence[ChannelRow]) -> None:
    """Print the streams of a log with their rates and gaps."""
    recorded: dict[tuple[str, float, int, float], list[str]] = {}
    for row in rows:
        recorded.setdefault((row.source, row.rate, row.gaps, row.longest_gap), []).append(row.variable)
    if not recorded:
        return
    out.heading("Sources")
    sources, rates, gaps, longest = zip(*recorded, strict=True)
    names = [" ".join(group) for group in recorded.values()]
    out.table(
        words("source", sources),
        fixed("Hz", rates, 1),
        fixed("gaps", gaps, 0),
        fixed("longest s", longest, 3),
        words("channels", names, wraps=True),
    )


def _show_channels(out: Page, rows: Sequence[ChannelRow]) -> None:
    """Print the range of each channel."""
    if not rows:
        return
    out.heading("Channels")
    low, middle, high = zip(*(alike((r.minimum, r.median, r.maximum)) for r in rows), strict=True)
    out.table(
        words("", [row.variable for row in rows]),
        words("unit", [shown_unit(row.unit) for row in rows]),
        points("lowest", low),
        points("median", middle),
        points("highest", high),
        words("missing", [_percent(row.missing) for row in rows]),
        words("meaning", [row.meaning for row in rows]),
    )


def look(arguments: argparse.Namespace) -> int:
    """Write the page of a flight."""
    seen = _overview(arguments)
    _write_page(arguments, seen)
    out = page()
    out.line(f"wrote {arguments.output}")
    out.bullets([fault.notice for fault in seen.summary.flight.faults], "Suspected faults")
    if seen.found.windows:
        out.line()
        out.command("next: ", _following(arguments, seen.found))
    return 0


def _overview(arguments: argparse.Namespace) -> Overview:
    from stoop.flight import load_flight
    from stoop.flight.windows import overview

    with LiveLine("reading the log"):
        return overview(load_flight(arguments.flight, arguments.mapping))


def _write_page(arguments: argparse.Namespace, seen: Overview) -> None:
    from stoop.report.flight import flight_sheet
    from stoop.report.sheet import write_sheet

    with LiveLine("drawing"):
        following = _following(arguments, seen.found)
        write_sheet(flight_sheet(seen, options.command_line(), following), arguments.output)


def _following(arguments: argparse.Namespace, found: Found) -> list[str]:
    """Return the command that fits the windows."""
    return options.identify_command(arguments, "result", **options.windows_of(found))


def compatibility(arguments: argparse.Namespace) -> int:
    """Check whether the sensors agree, write where asked to, and print what was found."""
    from stoop.flight import load_flight
    from stoop.problem.windows import spans
    from stoop.reconstruction.compatibility import Compatibility, corrected_flight
    from stoop.workflow.reconstruction import COMPATIBILITY, write_compatibility

    folder, others = arguments.output, options.given_paths(arguments.mapping)
    if folder is not None:
        check_targets(folder, COMPATIBILITY, arguments.overwrite)
    with LiveLine("reading the log"):
        flight = load_flight(arguments.flight, arguments.mapping)
    with LiveLine("integrating and comparing"):
        result, found = Compatibility.of(flight, spans(arguments.window, flight))
        corrected = corrected_flight(found)
    out = page()
    out.heading("Sensors")
    rows = []
    for name, one in result.findings.items():
        factor, unit = factor_and_unit(one.unit)
        value, error = rounded_to_error(factor * one.estimate, factor * one.std_error)
        rows.append((name, value, error, unit, "" if one.identifiable else str(one.reason), one.meaning))
    heads = ("", "estimate", "std error", "unit", "not identifiable", "meaning")
    out.table(*(words(head, column) for head, column in zip(heads, zip(*rows, strict=True), strict=True)))
    out.heading("Measured minus reconstructed, rms")
    for name, left in result.channels.items():
        factor, unit = factor_and_unit(left.unit)
        rms, movement = number(factor * left.rms, 3), number(factor * left.movement, 3)
        out.line(f"{name:16}{rms:>8} {unit:6} of {movement:>8} {unit} movement")
    out.bullets(of_severity(result.notices, "warning") or ("nothing evident",), "What is inconsistent")
    out.bullets(of_severity(result.notices, "info"), "Notes")
    if folder is not None:
        write_compatibility(result, flight, corrected, folder, options.command_line(), others)
        out.line(f"page: {folder / COMPATIBILITY[0]}; corrected flight: {folder / COMPATIBILITY[1]}")
    return 0


def info_document(summary: FlightSummary, found: Found) -> dict[str, Any]:
    """Return what is known of a flight for JSON, SI and rad; time histories and notes of its air data stand elsewhere."""
    from stoop.base.packages import hooks

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
        "control_laws": [t for titles in hooks("control_laws", list[str]) for t in titles(flight.parameters)],
        "faults": [fault.to_dict() for fault in flight.faults],
        "maneuvers": [asdict(maneuver) for maneuver in summary.maneuvers],
        "windows": [
            {"start": w.start, "stop": w.stop, "axis": w.axis, "use": w.use, "accept": w.accept}
            for w in found.windows
        ],
        "air": air,
        "unmapped": flight.unmapped,
        "notes": [str(found) for found in summary.notices],
    }


def unmapped_lines(unmapped: Mapping[str, Sequence[str]]) -> list[str]:
    """Return which columns no mapping names, and which streams were not looked into; long lists are cut."""

    def some(names: Sequence[str]) -> str:
        names = _as_arrays(names)
        more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
        return " ".join(names[:MAX_NAMES]) + more

    lines = [f"{stream}: {some(columns)}" for stream, columns in unmapped.items() if columns]
    whole = [stream for stream, columns in unmapped.items() if not columns]
    if len(lines) > MAX_STREAMS:
        lines[MAX_STREAMS:] = [f"and {len(lines) - MAX_STREAMS} more"]
    return lines + ([f"not read: {some(whole)}"] if whole else [])


def _as_arrays(names: Sequence[str]) -> list[str]:
    """Write elements of an array that follow one another, a[0] a[1] a[2], as a[0..2]."""

    def run(numbered: tuple[int, str]) -> tuple[str, int]:
        array, _, index = numbered[1].removesuffix("]").rpartition("[")
        return (array, int(index) - numbered[0]) if array and _INDEX.fullmatch(index) else numbered[::-1]

    out = []
    for _, group in groupby(enumerate(names), run):
        (_, first), *rest = group
        out.append(f"{first[:-1]}..{rest[-1][1].rpartition('[')[2]}" if rest else first)
    return out


def _percent(share: float) -> str:
    return f"{100.0 * share:5.1f} %" if share > 0.0 else ""

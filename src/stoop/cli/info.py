"""`stoop info`: what a flight log holds."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.cli.arguments import add_flight
from stoop.cli.page import Page, busy, page, print_json
from stoop.cli.tables import alike, fixed, numbers, points, shown_unit, words

if TYPE_CHECKING:
    from stoop.flight import ChannelRow, FlightSummary, Maneuver

FORMAT = "stoop-info/1"
MAX_STREAMS, MAX_NAMES = 12, 24  #: lines and names shown of what is not mapped; JSON holds all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add_flight(parser)
    parser.add_argument("--json", action="store_true", help="print JSON (SI units, rad) instead of tables")


def run(arguments: argparse.Namespace) -> int:
    """Read, describe, print."""
    from stoop.flight import describe, load

    with busy("reading the log"):
        summary = describe(load(arguments.flight, arguments.mapping))
    if arguments.json:
        print_json(info_document(summary))
    else:
        _print(page(), summary, source_arguments(arguments.flight, arguments.mapping))
    return 0


def source_arguments(flight: Path, mapping: Path | None) -> list[str]:
    """Return the arguments by which another verb reads the same flight."""
    return [str(flight)] if mapping is None else [str(flight), "--mapping", str(mapping)]


def info_document(summary: FlightSummary) -> dict[str, Any]:
    """Return what is known of a flight for JSON, SI and rad."""
    flight = summary.flight
    return {
        "format": FORMAT,
        "name": flight.name,
        "path": None if flight.path is None else str(flight.path),
        "start": float(flight.time[0]),
        "stop": float(flight.time[-1]),
        "rate": flight.rate,
        "channels": [asdict(row) for row in summary.rows],
        "faults": [fault.to_dict() for fault in flight.faults],
        "maneuvers": [asdict(maneuver) for maneuver in summary.maneuvers],
        "air": None if flight.air is None else _numbers_of(flight.air),
        "unmapped": flight.unmapped,
        "notes": [str(found) for found in summary.notices],
    }


def _numbers_of(air: Any) -> dict[str, Any]:
    """Return all of the reconstruction but its time histories and its notes, which stand elsewhere."""
    return {name: value for name, value in vars(air).items() if name not in ("traces", "notices")}


def _print(out: Page, summary: FlightSummary, source: Sequence[str]) -> None:
    flight = summary.flight
    start, stop = float(flight.time[0]), float(flight.time[-1])
    out.line(source[0])
    span = f"{start:.2f} to {stop:.2f} s on the log's own clock ({stop - start:.2f} s)"
    out.line(f"{span}, {flight.rate:g} Hz grid")
    full = [row for row in summary.rows if row.missing < 1.0]
    if full:
        out.heading("Sources")
        _print_sources(out, full)
        out.heading("Channels")
        _print_channels(out, full)
    empty = [row.variable for row in summary.rows if row not in full]
    if empty:
        out.heading(f"Without any value: {' '.join(empty)}")
    out.heading("Suspected faults")
    faults = [fault.notice for fault in flight.faults]
    out.bullets(map(str, faults) if faults else ["none found"])
    out.heading("Candidate maneuvers")
    _print_maneuvers(out, summary, source)
    notes = [str(found) for found in summary.notices if found not in faults]
    if notes:
        out.heading("Notes")
        out.bullets(notes)
    if flight.unmapped:
        out.heading("Not mapped")
        out.bullets(unmapped_lines(flight.unmapped))


def unmapped_lines(unmapped: Mapping[str, Sequence[str]]) -> list[str]:
    """Say which columns no mapping names, and which streams were not looked into; long lists are cut."""
    lines = [f"{stream}: {_some(columns)}" for stream, columns in unmapped.items() if columns]
    whole = [stream for stream, columns in unmapped.items() if not columns]
    lines = lines[:MAX_STREAMS] + (
        [f"and {len(lines) - MAX_STREAMS} more"] if len(lines) > MAX_STREAMS else []
    )
    return lines + ([f"not read: {_some(whole)}"] if whole else [])


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return " ".join(names[:MAX_NAMES]) + more


@dataclass(frozen=True)
class _Source:
    """Channels that were recorded alike."""

    name: str
    rate: float
    gaps: int
    longest_gap: float


def _by_source(rows: Iterable[ChannelRow]) -> Mapping[_Source, list[str]]:
    found: dict[_Source, list[str]] = {}
    for row in rows:
        found.setdefault(_Source(row.source, row.rate, row.gaps, row.longest_gap), []).append(row.variable)
    return found


def _print_sources(out: Page, rows: Sequence[ChannelRow]) -> None:
    sources = _by_source(rows)
    out.table(
        [
            words("source", [source.name for source in sources]),
            fixed("Hz", [source.rate for source in sources], 1),
            fixed("gaps", [source.gaps for source in sources], 0),
            fixed("longest s", [source.longest_gap for source in sources], 3),
            words("channels", [" ".join(names) for names in sources.values()], wraps=True),
        ]
    )


def _print_channels(out: Page, rows: Sequence[ChannelRow]) -> None:
    spans = [alike((row.minimum, row.median, row.maximum)) for row in rows]
    out.table(
        [
            words("", [row.variable for row in rows]),
            words("unit", [shown_unit(row.unit) for row in rows]),
            points("lowest", [low for low, _, _ in spans]),
            points("median", [middle for _, middle, _ in spans]),
            points("highest", [high for _, _, high in spans]),
            words("missing", [_percent(row.missing) for row in rows]),
            words("meaning", [row.meaning for row in rows]),
        ]
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:5.1f} %" if share > 0.0 else ""


def _print_maneuvers(out: Page, summary: FlightSummary, source: Sequence[str]) -> None:
    found = summary.maneuvers
    if not found:
        out.bullets(
            ["none found: no control stands out from how it is usually moved here, or none was recorded"]
        )
        return
    out.table(
        [
            words("window s", map(_window, found)),
            words("axis", [m.axis for m in found]),
            words("by", [m.variable for m in found]),
            numbers("amplitude", [m.amplitude for m in found]),
            fixed("swings", [m.swings for m in found], 0),
            points("times usual", [_times(m.strength) for m in found]),
            words("recorded", [_percent(m.whole) for m in found]),
        ]
    )
    out.line()
    out.command("next: ", _next_command(source, found))
    out.command(
        "or, chosen by their information: ",
        ["stoop", "maneuvers", *source, "--vehicle", "V.toml", "-o", "windows"],
    )


def _times(strength: float) -> str:
    return f"{strength:.1f}" if strength < 100.0 else ">100"


def _next_command(source: Sequence[str], found: Sequence[Maneuver]) -> list[str]:
    """Fit the most completely recorded maneuver of each axis; the others are there to be predicted."""
    apart = _apart(found)
    best = {m.axis: m for m in sorted(apart, key=lambda m: m.whole)}
    fitted = [_window(m) for m in apart if m is best[m.axis]]
    predicted = [_window(m) for m in apart if m is not best[m.axis]]
    windows = ["--maneuver", *fitted, *(["--validate", *predicted] if predicted else [])]
    return ["stoop", "identify", *source, "--vehicle", "V.toml", *windows, "-o", "result"]


def _apart(found: Sequence[Maneuver]) -> list[Maneuver]:
    """Cut windows that overlap (one's calm end is the next one's beginning) in the middle, in order of time."""
    out = list(found)
    for i, (one, following) in enumerate(pairwise(found)):
        if following.start < one.stop:
            middle = 0.5 * (following.start + one.stop)
            out[i] = replace(out[i], stop=middle)
            out[i + 1] = replace(following, start=middle)
    return out


def _window(maneuver: Maneuver) -> str:
    """Return START:STOP as `stoop identify --maneuver` takes it."""
    return f"{maneuver.start:.1f}:{maneuver.stop:.1f}"

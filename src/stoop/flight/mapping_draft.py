"""A mapping drafted for any log: by names, by units that the file states, and by the size of the numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from stoop import logs
from stoop.base.arrays import FloatArray
from stoop.base.toml import quoted, quoted_key
from stoop.base.units import FACTORS
from stoop.base.variables import OUTPUT_PINS, VARIABLES
from stoop.checks.draft import DraftLine, with_units
from stoop.checks.units import PAIRS, STATISTICS, growth
from stoop.errors import LogError, one_line
from stoop.flight.apply_mapping import Mapped, apply_mapping
from stoop.flight.column_names import Guess, recognized, without_unit
from stoop.flight.mapping import READY, ready, with_other_form
from stoop.flight.mapping_draft_outputs import Outputs, place
from stoop.flight.time_delay import Signal
from stoop.logs import Recording
from stoop.logs.csv_tables import guess_clock, read_px4_folder, read_raw_csv
from stoop.logs.read import is_bag_folder, kind, read_as

CLOCK_STEPS: Final = (
    ("s", 5e-5, 2.0),
    ("ms", 2.0, 1.5e3),
    ("us", 1.5e3, 1.5e6),
    ("ns", 1.5e6, np.inf),
)  #: unit -> least and largest steps of a clock per sample
_COMPONENT: Final = re.compile(r"(?:.*\.)?(xyz\[\d\]|[xyz])")
MAX_LINES: Final = 400
MAX_COMPARED: Final = 60  #: columns without a known name, that are compared with the angles
MAX_NAMES: Final = 30


@dataclass(frozen=True)
class Draft:
    """A mapping that was drafted.

    Attributes
    ----------
    text : TOML
    mapped : how many variables it names
    unsure : how many of them are marked
    """

    text: str
    mapped: int
    unsure: int


def draft(path: Path) -> Draft:
    """Draft a mapping for a log.

    Parameters
    ----------
    path : log of any kind that stoop reads, or a folder of CSV files

    Raises
    ------
    LogError
        When the log cannot be read.
    """
    return draft_of(_recording(path))


def draft_of(recording: Recording) -> Draft:
    """Draft a mapping for a log that was read, with all its columns as they stand there."""
    return _of_ready(recording) if recording.format in READY else _of_any(recording)


def _recording(path: Path) -> Recording:
    """Read a log without any mapping."""
    if path.is_dir() and not is_bag_folder(path):
        try:
            return read_px4_folder(path)
        except LogError:
            return read_raw_csv(path)
    if path.is_file() and (known := kind(path)):
        return read_as(known, path)
    table = path.is_file() and path.name.lower().endswith((".csv", ".csv.gz", ".txt"))
    return read_raw_csv(path) if table else logs.read(path)


def _of_ready(recording: Recording) -> Draft:
    """Start from the ready mapping: say what it takes, and what else looks as if it were of use."""
    name = READY[recording.format]
    found = apply_mapping(ready(name), recording)
    taken = {variable for group in found.channels for variable in group.values}
    rest = replace(recording, streams={s: recording.streams[s] for s in found.unmapped})
    lines = [
        line
        for line in _lines(rest)
        if line.variable not in with_other_form(taken) and line.column in found.unmapped[line.stream]
    ]
    best = with_units(_best(lines), {line.variable: _signal(rest, line) for line in lines})
    out = [f"# Drafted by stoop map for {quoted(recording.path.name)}.", f'extends = "{name}"', ""]
    out += ["# The ready mapping takes:"]
    out += [
        f"#   {' '.join(group.values)} from {group.source} ({group.rate:.4g} Hz)" for group in found.channels
    ]
    outputs = _outputs_of_ready(recording, found)
    motors = outputs.motor_lines()
    out += ["", "[variables]"] if best or motors else []
    out += motors
    if best:
        out += ["# It does not take these, which look as if they were of use:"]
        out += [f"# {_toml(line)}" for line in best[:MAX_LINES]]
    out += outputs.surface_lines()
    unsure = sum("# unsure" in line for line in motors)
    return Draft("\n".join([*out, ""]), len(taken) + len(motors), unsure)


def _outputs_of_ready(recording: Recording, found: Mapped) -> Outputs:
    signals = {name: (group.time, x) for group in found.channels for name, x in group.values.items()}
    there = set(recording.streams["RCOU"].columns) if "RCOU" in recording.streams else set()
    columns = ((f"pwm_{n}", name) for n in range(1, OUTPUT_PINS + 1) for name in (f"C{n}", f"Ch{n}"))
    places = {pulse: place(name, "RCOU") for pulse, name in columns if pulse in signals and name in there}
    mapped = tuple(variable for variable in VARIABLES if variable in signals)
    return Outputs(mapped, places, signals, recording.parameters)


def _outputs_of_any(timed: Recording, lines: Sequence[DraftLine]) -> Outputs:
    several = len(timed.streams) > 1
    signals = {}
    for line in lines:
        t, x = _signal(timed, line)
        signals[line.variable] = t, line.values(x)
    places = {line.variable: place(line.column, line.stream if several else "") for line in lines}
    called = tuple(line.variable for line in lines if line.variable.startswith("pwm_") and _says_motor(line))
    return Outputs(tuple(line.variable for line in lines), places, signals, timed.parameters, called)


def _says_motor(line: DraftLine) -> bool:
    guess = _guessed(line.stream, line.column, "")
    return guess is not None and guess.variable.startswith("motor_")


def _of_any(recording: Recording) -> Draft:
    clock, timed = _clocks(recording)
    clocks = _clock_columns(recording)
    best = _best([line for line in _lines(timed) if (line.stream, line.column) not in clocks])
    samples = {line.variable: _signal(timed, line) for line in best}
    lines = _as_siblings(with_units(best, samples))
    lines += _derivatives(timed, lines)
    lines = sorted(lines, key=lambda line: list(VARIABLES).index(line.variable))[:MAX_LINES]
    named = {(line.stream, line.column) for line in lines} | _clock_columns(recording)
    outputs = _outputs_of_any(timed, lines)
    motors = outputs.motor_lines()
    out = [
        f"# Drafted by stoop map for {quoted(recording.path.name)}: correct what is marked, remove what is wrong.",
        *clock,
        "",
        "[variables]",
        *(_toml(line, len(timed.streams) > 1) for line in lines),
        *motors,
        *outputs.surface_lines(),
        *_left(timed, named),
        "",
    ]
    unsure = sum(bool(line.doubts) for line in lines) + sum("# unsure" in line for line in motors)
    return Draft("\n".join(out), len(lines) + len(motors), unsure)


def _lines(recording: Recording) -> list[DraftLine]:
    return [line for stream in recording.streams for line in _of_stream(recording, stream)]


def _of_stream(recording: Recording, stream: str) -> Iterator[DraftLine]:
    stated = recording.units.get(stream, {})
    columns = recording.streams[stream].columns
    bodily = {"u", "w"} <= {without_unit(column)[0].lower() for column in columns}
    for column in columns:
        guess = _guessed(stream, column, stated.get(column, ""))
        if guess is None or (bodily and without_unit(column)[0].lower() == "v"):
            continue  # u, v, w are the velocity along the body axes
        if guess.variable.partition("_")[2].isdigit() and not np.nan_to_num(columns[column]).any():
            continue  # an output that is not there
        doubts = (guess.doubt.removeprefix("unsure: "),) if guess.doubt else ()
        yield DraftLine(guess.variable, stream, column, guess.unit, guess.scale, bool(guess.unit), doubts)


def _guessed(stream: str, column: str, stated: str) -> Guess | None:
    """Recognize a column; where it is a bare x, y or z, the stream says of what."""
    known = recognized(column, stated)
    component = _COMPONENT.fullmatch(column)
    if component is None or (known is not None and "." in column):
        return known
    return recognized(f"{re.sub(r'/[0-9]+$', '', stream)} {component.group(1)}", stated) or known


def _best(lines: Sequence[DraftLine]) -> list[DraftLine]:
    """Keep one line for each variable: one without a doubt, else the first; the others become doubts."""
    by_name: dict[str, list[DraftLine]] = {}
    for line in lines:
        by_name.setdefault(line.variable, []).append(line)
    best = []
    for several in by_name.values():
        first, *others = sorted(several, key=lambda line: len(line.doubts))
        names = ", ".join(f"{line.stream} {line.column}" for line in others[:3])
        best.append(first.doubted(f"or {names}") if others else first)
    return best


def _as_siblings(lines: Sequence[DraftLine]) -> list[DraftLine]:
    """Give motors (servos) whose size says nothing the percents of the others: one may have run at idle throughout."""
    stems = {
        stem
        for line in lines
        if line.unit == "percent"
        for stem in ("motor_", "servo_")
        if stem in line.variable
    }
    return [
        replace(line, unit="percent").doubted("percent as the others")
        if line.variable.startswith(tuple(stems)) and line.unit == "1" and not (line.stated or line.doubts)
        else line
        for line in lines
    ]


def _signal(recording: Recording, line: DraftLine) -> Signal:
    stream = recording.streams[line.stream]
    return stream.time, stream.columns[line.column]


def _clocks(recording: Recording) -> tuple[list[str], Recording]:
    """Return the tables that name the clocks, and the recording on them."""
    if recording.format != "table":
        names = [
            one_line(f"# {key}: {text}")
            for key, text in recording.info.items()
            if key.startswith("clock of ")
        ]
        return names, recording
    lines: list[str] = []
    written: set[tuple[str, str]] = set()
    streams = {}
    for i, (name, stream) in enumerate(recording.streams.items()):
        column = recording.info[f"clock of {name}"]
        _, unit = guess_clock([column])
        factor, mark = FACTORS[unit], ""
        if without_unit(column)[1] != unit:
            unit, mark = _by_steps(stream.columns[column])
        if (column, unit) not in written:
            where = "time" if i == 0 else f"clock.{quoted_key(name)}"
            lines += ["", f"[{where}]", f"column = {quoted(column)}", f'unit = "{unit}"{mark}']
        written |= {(column, unit)} if i == 0 else set()
        streams[name] = replace(stream, time=stream.time * (FACTORS[unit] / factor))
    return lines, replace(recording, streams=streams)


def _clock_columns(recording: Recording) -> set[tuple[str, str]]:
    return {(name, recording.info.get(f"clock of {name}", "")) for name in recording.streams}


def _by_steps(clock: FloatArray) -> tuple[str, str]:
    """Tell the unit of a clock by its steps: logs are written at 0.5 Hz to 20 kHz."""
    step = float(np.median(np.diff(clock)))
    unit = next((unit for unit, low, high in CLOCK_STEPS if low <= step < high), "s")
    return unit, f"  # unsure: its steps are {step:.4g}, which are {step * FACTORS[unit]:.4g} s then"


def _derivatives(recording: Recording, lines: Sequence[DraftLine]) -> list[DraftLine]:
    """Find columns without a known name that are the derivative of an angle."""
    known = {line.variable: line for line in lines}
    named = {(line.stream, line.column) for line in lines}
    found = []
    for angle, rate in PAIRS[:3]:
        if angle not in known or rate in known:
            continue
        t, x = _signal(recording, known[angle])
        turned = t, known[angle].values(x)
        best = max(_compared(recording, turned, named), key=lambda one: abs(one[1]), default=None)
        if best is not None and abs(best[1]) > STATISTICS.likeness:
            found.append(_rate_line(rate, angle, *best))
    return found


def _compared(
    recording: Recording, angle: Signal, named: set[tuple[str, str]]
) -> Iterator[tuple[float, float, str, str]]:
    left = [(s, c) for s, stream in recording.streams.items() for c in stream.columns if (s, c) not in named]
    for stream, column in left[:MAX_COMPARED]:
        values = recording.streams[stream].columns[column]
        yield (*growth(angle, (recording.streams[stream].time, values)), stream, column)


def _rate_line(rate: str, angle: str, ratio: float, likeness: float, stream: str, column: str) -> DraftLine:
    unit = "deg/s" if abs(ratio) < 0.1 else "rad/s"
    doubt = f"by its numbers only: the derivative of {angle} (correlation {abs(likeness):.2f})"
    return DraftLine(rate, stream, column, unit, 1.0 if ratio > 0.0 else -1.0, doubts=(doubt,))


def _toml(line: DraftLine, with_stream: bool = True) -> str:
    parts = [f"stream = {quoted(line.stream)}"] if with_stream else []
    parts += [f"column = {quoted(line.column)}", f'unit = "{line.unit or VARIABLES[line.variable].unit}"']
    parts += [f"scale = {line.scale!r}"] if line.scale != 1.0 else []
    words = [f"unsure: {doubt}" for doubt in line.doubts] or list(line.remarks)
    comment = f"  # {'; '.join(words)}" if words else ""
    return f"{line.variable} = {{{', '.join(parts)}}}{one_line(comment)}"


def _left(recording: Recording, named: set[tuple[str, str]]) -> list[str]:
    out = []
    for name, stream in recording.streams.items():
        rest = [column for column in stream.columns if (name, column) not in named]
        if rest:
            more = f" and {len(rest) - MAX_NAMES} more" if len(rest) > MAX_NAMES else ""
            out.append(
                f"# not recognized in {quoted(name)}: {' '.join(quoted(c) for c in rest[:MAX_NAMES])}{more}"
            )
    return ["", *out] if out else []

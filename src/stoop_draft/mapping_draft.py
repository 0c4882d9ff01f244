"""A mapping drafted for any log: by names, by units that the file states, and by the size of the numbers.

Outputs: which pulses are motors, which move a surface, and over which range. ArduPilot's parameters tell for certain:
SERVOn_FUNCTION of motor 1 is 33 (Copter and QuadPlane, "Connecting outputs").
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
import tomlkit

from stoop.extend import flights, variables
from stoop.extend.files import toml
from stoop.extend.recordings import Recording, Stream, guess_clock, read_unmapped
from stoop.extend.text import printable
from stoop.extend.units import UNITS
from stoop_draft.checks.lines import Signal
from stoop_draft.checks.units import PAIRS, STATISTICS, growth, largest_size
from stoop_draft.column_guesses import DraftLine, recognized, with_units, without_unit

LARGEST: Final = 1e30  #: of plausible numbers in a log
CLOCK_STEPS: Final = (
    ("s", 5e-5, 2.0),
    ("ms", 2.0, 1.5e3),
    ("us", 1.5e3, 1.5e6),
    ("ns", 1.5e6, np.inf),
)  #: unit -> least and largest steps of a clock per sample: logs are written at 0.5 Hz to 20 kHz
FUNCTIONS: Final[dict[float, str]] = {
    **{function: f"motor_{number}" for function, number in variables.ARDUPILOT.motors.items()},
    2: "flap",
    3: "flap",
    4: "aileron",
    19: "elevator",
    21: "rudder",
}  #: SERVOn_FUNCTION, a whole number, -> what the output does
RANGES: Final = (("MOT_PWM_MIN", "MOT_PWM_MAX"), ("Q_M_PWM_MIN", "Q_M_PWM_MAX"))  #: us; 0 where not set
DEFAULT_RANGE: Final = (1000.0, 2000.0)  #: us
#: variables -> name of their group, and the frames that turn them
GROUPS: Final = {
    variables.FAMILIES["quaternion"]: ("attitude", "body", "world"), variables.FAMILIES["rates"]: ("rates", "body"),
    variables.FAMILIES["specific force"]: ("specific_force", "body"),
    variables.FAMILIES["velocity"]: ("velocity", "world"), variables.FAMILIES["position"]: ("position", "world"),
}  # fmt: skip
_NUMBERED: Final = re.compile(r"(.*?)[\W_]*\d{1,2}\]?")  #: stem of a name that ends in a number
_DRIVEN: Final = re.compile(r"(motor|rotor|pwm|servo)_")
_COMPONENT: Final = re.compile(r"(?:.*\.)?(xyz\[\d\]|data\[\d{1,2}\]|[xyz])")


@dataclass(frozen=True)
class Limits:
    """How much is drafted and compared."""

    lines: int = 400  #: of a draft
    compared: int = 60  #: columns without a known name, that are compared with the angles
    names: int = 30  #: listed of those that were not recognized
    throw: float = 0.4  #: rad to each side, to start a calibration from
    outputs: int = 4  #: for which a calibration is drafted
    rate: float = 200.0  #: Hz at which pulses are compared with rates
    delays: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.4)  #: s by which a motor may follow what was recorded
    samples: tuple[int, int] = (100, 400_000)  #: of that comparison


LIMITS: Final = Limits()


@dataclass(frozen=True)
class Draft:
    """A mapping that was drafted."""

    text: str  #: TOML
    mapped: int  #: how many variables it names
    unsure: int  #: how many of them are marked
    unknown: tuple[str, ...] = ()  #: columns that were not recognized


def draft(path: Path) -> Draft:
    """Draft a mapping for a log of any kind that stoop reads, or for a folder of CSV files.

    Raises
    ------
    LogError
        When the log cannot be read.
    """
    return draft_of(read_unmapped(path))


def draft_of(recording: Recording) -> Draft:
    """Draft a mapping for a log that was read, with all its columns as they stand there."""
    streams = {
        name: replace(
            stream, columns={n: np.where(np.abs(x) > LARGEST, np.nan, x) for n, x in stream.columns.items()}
        )
        for name, stream in recording.streams.items()
    }
    recording = replace(recording, streams=streams)
    return _of_ready(recording) if recording.format in flights.FlightMapping.READY else _of_any(recording)


def _of_ready(recording: Recording) -> Draft:
    """Start from the ready mapping: say what it takes, and what else looks as if it were of use."""
    name = flights.FlightMapping.READY[recording.format]
    found = flights.Mapped.of(flights.FlightMapping.ready(name), recording)
    signals = {variable: (group.time, x) for group in found.channels for variable, x in group.values.items()}
    rest = replace(recording, streams={s: recording.streams[s] for s in found.unmapped})
    taken = flights.with_other_form(signals.keys())
    lines = [
        line
        for line in _lines(rest)
        if line.variable not in taken and line.column in found.unmapped[line.stream]
    ]
    best = with_units(_best(lines), {line.variable: _signal(rest, line) for line in lines})
    there = recording.streams["RCOU"].columns if "RCOU" in recording.streams else {}
    columns = (
        (pulse, column)
        for n, pulse in enumerate(variables.FAMILIES["pwm"], 1)
        for column in (f"C{n}", f"Ch{n}")
    )
    places = {
        pulse: _place(column, "RCOU") for pulse, column in columns if pulse in signals and column in there
    }
    mapped = tuple(variable for variable in variables.VARIABLES if variable in signals)
    outputs = Outputs(mapped, places, signals, recording.parameters)
    motors = outputs.motor_lines()
    out = [
        f"# Drafted by stoop map for {toml.quoted(recording.path.name)}.",
        f'extends = "{name}"',
        "",
        "# The ready mapping takes:",
        *(f"#   {' '.join(g.values)} from {g.source} ({g.rate:.4g} Hz)" for g in found.channels),
        *(("", "[variables]") if best or motors else ()),
        *motors,
        *(["# It does not take these, which look as if they were of use:"] if best else ()),
        *(f"# {_toml(line)}" for line in best[: LIMITS.lines]),
        *outputs.surface_lines(),
        "",
    ]
    unsure = sum("# unsure" in line for line in motors)
    return Draft("\n".join(out), len(signals) + len(motors), unsure)


def _of_any(recording: Recording, framed: bool = True) -> Draft:
    """Draft by names, sizes and, unless what the columns show speaks against it, in the axes that the format has."""
    clock, timed = _clocks(recording)
    clocks = {(name, recording.info.get(f"clock of {name}", "")) for name in recording.streams}
    known = [line for line in _lines(timed) if (line.stream, line.column) not in clocks]
    known = _following(timed, known)
    best = _best(known)
    groups = _groups(timed, best) if framed else []
    own = _in_our_axes(timed, groups)
    read = {line.variable: own.get(line.variable) or _signal(timed, line) for line in best}
    lines = with_units(best, read)
    ours = [line for line in lines if line.variable in own]
    if any(line.scale != 1.0 or line.unit != variables.VARIABLES[line.variable].unit for line in ours):
        return _of_any(recording, framed=False)
    lines = [replace(line, doubts=()) if line.variable in own else line for line in lines]
    # motors (servos) whose size says nothing are in percent as the others: one may have run at idle throughout
    percents = {line.variable.rpartition("_")[0] for line in lines if line.unit == "percent"}
    percents &= {"motor", "servo"}
    for i, line in enumerate(lines):
        idle = line.unit == "1" and not (line.stated or line.doubts)
        if idle and line.variable.rpartition("_")[0] in percents:
            lines[i] = replace(line, unit="percent").doubted("percent as the others")
    lines += [*_derivatives(timed, lines), *_motors(timed, [*lines, *known])]
    lines = sorted(lines, key=lambda line: list(variables.VARIABLES).index(line.variable))[: LIMITS.lines]
    several = len(timed.streams) > 1
    signals, called = {}, []
    for line in lines:
        t, x = _signal(timed, line)
        signals[line.variable] = own.get(line.variable) or (t, line.values(x))
        guess = _guessed(line.stream, line.column, "")
        if line.variable.startswith("pwm_") and guess is not None and guess.variable.startswith("motor_"):
            called.append(line.variable)
    places = {line.variable: _place(line.column, line.stream if several else "") for line in lines}
    outputs = Outputs(tuple(signals), places, signals, timed.parameters, tuple(called))
    motors = outputs.motor_lines()
    named = {(line.stream, line.column) for line in (*lines, *known)} | clocks
    unknown = {
        name: [column for column in stream.columns if (name, column) not in named]
        for name, stream in timed.streams.items()
    }
    left = [
        row
        for name, columns in unknown.items()
        for row in _offered(name, timed.streams[name], columns, several)
    ]
    out = [
        f"# Drafted by stoop map for {toml.quoted(recording.path.name)}: correct what is marked, remove what is wrong.",
        *clock,
        "",
        "[variables]",
        *(_toml(line, several) for line in lines if line.variable not in own),
        *motors,
        *outputs.surface_lines(),
        *(["", *left] if left else ()),
        *(text for group in groups for text in group.text(several)),
        "",
    ]
    unsure = sum(bool(line.doubts) for line in lines) + sum("# unsure" in line for line in motors)
    every = tuple(column for columns in unknown.values() for column in columns)
    return Draft("\n".join(out), len(lines) + len(motors), unsure, every)


@dataclass(frozen=True)
class Group:
    """A vector or an attitude of one stream, in the axes of its format: lines in the order of their columns."""

    lines: tuple[DraftLine, ...]
    frame: tuple[str, ...]

    def text(self, several: bool) -> list[str]:
        """Return the table of a mapping."""
        mapped = tuple(line.variable for line in self.lines)
        names, columns = (
            ", ".join(map(toml.quoted, x)) for x in (mapped, (line.column for line in self.lines))
        )
        stream = f"stream = {toml.quoted(self.lines[0].stream)}, " if several else ""
        frame = (
            f"[{', '.join(map(toml.quoted, self.frame))}]"
            if len(self.frame) > 1
            else toml.quoted(self.frame[0])
        )
        return [
            "", f"[group.{GROUPS[mapped][0]}]  # in the axes that are usual of the format; else remove or correct frame",
            f"variables = [{names}]", f"frame = {frame}", f"sources = [{{ {stream}columns = [{columns}] }}]",
        ]  # fmt: skip


def _groups(recording: Recording, lines: Sequence[DraftLine]) -> list[Group]:
    """Return the vectors and attitudes that one stream holds whole, in SI, where a format has axes of its own."""
    by_name = {line.variable: line for line in lines}
    groups = []
    for names, (_, *kinds) in GROUPS.items():
        frame = tuple(recording.info.get(f"{kind} frame", "") for kind in kinds)
        own = tuple(by_name[name] for name in names if name in by_name)
        plain = all(
            line.scale == 1.0 and line.unit in ("", variables.VARIABLES[line.variable].unit) for line in own
        )
        if all(frame) and plain and len(own) == len(names) and len({line.stream for line in own}) == 1:
            groups.append(Group(own, frame))
    return groups


def _in_our_axes(recording: Recording, groups: Sequence[Group]) -> dict[str, Signal]:
    """Return the signals of groups, turned."""
    out: dict[str, Signal] = {}
    for group in groups:
        signals = {line.variable: _signal(recording, line) for line in group.lines}
        turned = flights.rotate_axes({name: x for name, (_, x) in signals.items()}, group.frame)
        out |= {name: (signals[name][0], x) for name, x in turned.items()}
    return out


def _offered(name: str, stream: Stream, columns: Sequence[str], several: bool) -> list[str]:
    """Return columns that were not recognized as lines that wait for the name of a variable, with what they read."""
    if not columns:
        return []
    more = f"; {len(columns) - LIMITS.names} more are not listed" if len(columns) > LIMITS.names else ""
    rows = [f"# not recognized in {toml.quoted(name)}: write a variable for NAME, and its unit{more}"]
    along = [column for column in columns if without_unit(column)[0].lower() in ("u", "v", "w")]
    if len(along) == len("uvw"):  # what they measure is known, and what stands for it in a mapping
        rows.append(
            f"# {', '.join(along)} look like the velocity along the body axes, which a mapping cannot name: add columns "
            "V = sqrt(u^2 + v^2 + w^2),"
        )
        rows.append(
            "# alpha = atan2(w, u) and beta = asin(v / V) to the log, or vn, ve and vd of them and the attitude"
        )
    for column in columns[: LIMITS.names]:
        x = stream.columns[column]
        known = x[np.isfinite(x)]
        ends = f"{known.min():.4g} to {known.max():.4g}" if known.size else "no number"
        rows.append(
            printable(f'# NAME = {{{_place(column, name if several else "")}, unit = "1"}}  # {ends}')
        )
    return rows


def _lines(recording: Recording) -> list[DraftLine]:
    lines = []
    for name, stream in recording.streams.items():
        bodily = {"u", "w"} <= {without_unit(column)[0].lower() for column in stream.columns}
        for column, x in stream.columns.items():
            line = _guessed(name, column, recording.units.get(name, {}).get(column, ""))
            if line is None or (bodily and without_unit(column)[0].lower() == "v"):
                continue  # u, v, w are the velocity along the body axes
            if line.variable.partition("_")[2].isdigit() and not np.nan_to_num(x).any():
                continue  # an output that is not there
            lines.append(line)
    return lines


def _guessed(stream: str, column: str, stated: str) -> DraftLine | None:
    """Recognize a column; where it is a bare x, y or z, or an element of bare data, the stream says of what."""
    known = recognized(column, stated, stream)
    component = _COMPONENT.fullmatch(column)
    if component is None or (known is not None and "." in column):
        return known
    stem = re.sub(r"/[0-9]+$", "", stream)
    whole = recognized(f"{stem} {component.group(1).removeprefix('data')}", stated, stream)
    return known if whole is None else replace(whole, column=column)


def _best(lines: Sequence[DraftLine]) -> list[DraftLine]:
    """Keep one line for each variable: one without a doubt, else the first; the others become doubts."""
    by_name: dict[str, list[DraftLine]] = {}
    for line in lines:
        by_name.setdefault(line.variable, []).append(line)
    best = []
    for several in by_name.values():
        first, *others = sorted(several, key=lambda line: (len(line.doubts), line.commanded))
        names = ", ".join(f"{line.stream} {line.column}" for line in others[:3])
        best.append(first.doubted(f"or {names}") if others else first)
    return best


def _signal(recording: Recording, line: DraftLine) -> Signal:
    stream = recording.streams[line.stream]
    return stream.time, stream.columns[line.column]


def _clocks(recording: Recording) -> tuple[list[str], Recording]:
    """Return the tables that name the clocks, and the recording on them."""
    if recording.format != "table":
        info = recording.info.items()
        return [printable(f"# {key}: {text}") for key, text in info if key.startswith("clock of ")], recording
    lines: list[str] = []
    written: set[tuple[str, str]] = set()
    streams = {}
    for i, (name, stream) in enumerate(recording.streams.items()):
        column = recording.info[f"clock of {name}"]
        _, unit = guess_clock([column])
        factor, mark = UNITS[unit].factor, ""
        if without_unit(column)[1] != unit:  # its steps tell
            step = float(np.median(np.diff(stream.columns[column])))
            unit = next((unit for unit, low, high in CLOCK_STEPS if low <= step < high), "s")
            mark = f"  # unsure: its steps are {step:.4g}, which are {step * UNITS[unit].factor:.4g} s then"
        if (column, unit) not in written:
            where = "time" if i == 0 else f"clock.{tomlkit.key(name).as_string()}"
            lines += ["", f"[{where}]", f"column = {toml.quoted(column)}", f'unit = "{unit}"{mark}']
        written |= {(column, unit)} if i == 0 else set()
        streams[name] = replace(stream, time=stream.time * (UNITS[unit].factor / factor))
    return lines, replace(recording, streams=streams)


def _following(recording: Recording, lines: Sequence[DraftLine]) -> list[DraftLine]:
    """Leave out angles that do not turn as their rates do where another does; of those that do, the most alike comes first."""
    out = list(lines)
    for angle, rate in PAIRS[:3]:
        rates = [line for line in _best(lines) if line.variable == rate]
        candidates = [line for line in lines if line.variable == angle]
        if not rates or len(candidates) < 2:
            continue
        turned = _signal(recording, rates[0])
        alike = {line.column: abs(growth(_signal(recording, line), turned)[1]) for line in candidates}
        follow = sorted((c for c in candidates if alike[c.column]), key=lambda line: -alike[line.column])
        if follow:
            out = [*follow, *(line for line in out if line.variable != angle)]
    return out


def _derivatives(recording: Recording, lines: Sequence[DraftLine]) -> list[DraftLine]:
    """Find columns without a known name that are the derivative of an angle."""
    known = {line.variable: line for line in lines}
    named = {(line.stream, line.column) for line in lines}
    left = [(s, c) for s, stream in recording.streams.items() for c in stream.columns if (s, c) not in named]
    found = []
    for angle, rate in PAIRS[:3]:
        if angle not in known or rate in known:
            continue
        t, x = _signal(recording, known[angle])
        turned, best = (t, known[angle].values(x)), (0.0, 0.0, "", "")
        for name, column in left[: LIMITS.compared]:
            stream = recording.streams[name]
            ratio, likeness = growth(turned, (stream.time, stream.columns[column]))
            if abs(likeness) > max(abs(best[1]), STATISTICS.likeness):
                best = ratio, likeness, name, column
        ratio, likeness, name, column = best
        if column:
            unit = "deg/s" if abs(ratio) < 0.1 else "rad/s"
            doubt = f"by its numbers only: the derivative of {angle} (correlation {abs(likeness):.2f})"
            found.append(DraftLine(rate, name, column, unit, 1.0 if ratio > 0.0 else -1.0, doubts=(doubt,)))
    return found


def _motors(recording: Recording, lines: Sequence[DraftLine]) -> list[DraftLine]:
    """Find numbered columns without a known name that turn the vehicle as motors do."""
    signals = {line.variable: _signal(recording, line) for line in lines if line.variable in ("p", "q")}
    named, series = {(line.stream, line.column) for line in lines}, dict[tuple[str, str], list[DraftLine]]()
    for name, stream in recording.streams.items():
        for column in (c for c in stream.columns if (name, c) not in named):
            if (found := _NUMBERED.fullmatch(column)) is not None:
                own = series.setdefault((name, found.group(1)), [])
                own.append(DraftLine(f"motor_{len(own) + 1}", name, column))
    for own in [] if any(_DRIVEN.match(line.variable) for line in lines) else series.values():
        columns = {line.variable: _signal(recording, line) for line in own}
        most = max(largest_size(x) for _, x in columns.values())
        for late in LIMITS.delays if most > 0.0 else ():
            pulses = {
                f"pwm_{n}": (t + late, 1e3 + 1e3 * x / most) for n, (t, x) in enumerate(columns.values(), 1)
            }
            if len(Outputs((*pulses,), {}, {**signals, **pulses}, {}).motors) == len(own):
                doubt = "a motor by what it turns, check its number"
                return [line.doubted(doubt) for line in with_units(own, columns)]
    return []


def _place(column: str, stream: str = "") -> str:
    """Return where a column lies, as a line of a mapping says it."""
    return f"{f'stream = {toml.quoted(stream)}, ' if stream else ''}column = {toml.quoted(column)}"


def _toml(line: DraftLine, with_stream: bool = True) -> str:
    unit = line.unit or variables.VARIABLES[line.variable].unit
    scale = f", scale = {line.scale!r}" if line.scale != 1.0 else ""
    scale += f", offset = {line.offset:.12g}" if line.offset != 0.0 else ""
    words = [f"unsure: {doubt}" for doubt in line.doubts] or list(line.remarks)
    comment = f"  # {'; '.join(words)}" if words else ""
    place = _place(line.column, line.stream if with_stream else "")
    return f'{line.variable} = {{{place}, unit = "{unit}"{scale}}}{printable(comment)}'


@dataclass(frozen=True)
class Outputs:
    """The outputs of a log."""

    mapped: tuple[str, ...]  #: their variables, in order
    places: Mapping[str, str]  #: pulses -> where they are recorded, as the mapping writes it
    signals: Mapping[str, Signal]  #: variable -> samples, of pulses and rates
    parameters: Mapping[str, float]  #: of the autopilot
    called: tuple[str, ...] = ()  #: pulses whose columns are called motors

    def motor_lines(self) -> list[str]:
        """Return lines for [variables] that make commands from 0 to 1 of the pulses of motors."""
        lines = []
        for pulse, motor in self.motors.items():
            if pulse not in self.places:
                continue
            number = pulse.removeprefix("pwm_")
            low, high, said = *DEFAULT_RANGE, ""
            for first, last in (*RANGES, (f"SERVO{number}_MIN", f"SERVO{number}_MAX")):
                idle, full = self.parameters.get(first, 0.0), self.parameters.get(last, 0.0)
                if 500.0 <= idle < full <= 2500.0:
                    low, high, said = idle, full, f"by {first} and {last}"
                    break
            doubt = "" if self.functions or self.called else "a motor by what it turns, check its number; "
            sure = not doubt and said.startswith(tuple(f"by {first}" for first, _ in RANGES))
            scale, offset = 1.0 / (high - low), -low / (high - low)
            lines.append(
                f'{motor} = {{{self.places[pulse]}, unit = "1", scale = {scale:.10g}, offset = {offset:.10g}}}  # '
                f"{'' if sure else f'unsure: {doubt}'}0 at {low:g} us, 1 at {high:g} us, "
                f"{said or 'as is usual: write your own'}"
            )
        return lines

    @cached_property
    def motors(self) -> dict[str, str]:
        """Return which pulse is which motor, by the parameters, by a column's name, or by what the pulses turn.

        None where motors are known.
        """
        if any(name.startswith(("motor_", "rotor_")) for name in self.mapped):
            return {}
        if self.functions:
            return {pulse: use for pulse, use in self.functions.items() if use.startswith("motor_")}
        return {pulse: pulse.replace("pwm", "motor") for pulse in self.called or self._turning()}

    @cached_property
    def functions(self) -> dict[str, str]:
        """Return what the parameters say that each pulse does, as far as the registry knows it."""
        pulses = [name for name in self.mapped if name.startswith("pwm_")]
        uses = {p: FUNCTIONS.get(self.parameters.get(f"SERVO{p[4:]}_FUNCTION", 0.0), "") for p in pulses}
        return {pulse: use for pulse, use in uses.items() if use in variables.VARIABLES}

    def _turning(self) -> list[str]:
        """Return pulses that turn the vehicle as motors do, each signal on its own clock."""
        used = {n: s for n, s in self.signals.items() if n in ("p", "q") or n.startswith("pwm_")}
        least, most = LIMITS.samples
        if not {"p", "q"} <= set(used) or min(t.size for t, _ in used.values()) < least:
            return []
        start, stop = max(float(t[0]) for t, _ in used.values()), min(float(t[-1]) for t, _ in used.values())
        count = int(min(max(stop - start, 0.0) * LIMITS.rate, most))
        if count < least:
            return []
        time = np.arange(count) / LIMITS.rate
        columns = {name: np.interp(start + time, t, x) for name, (t, x) in used.items()}
        return flights.from_columns("drafted", time, columns).rotor_pulses()

    def surface_lines(self) -> list[str]:
        """Give outputs that may move a surface something to start a calibration from, as comments."""
        motors, uses = self.motors, self.functions
        named = {p: use for p, use in uses.items() if p not in motors and not use.startswith("motor_")}
        rest = [n for n in self.mapped if n.startswith(("pwm_", "servo_")) and n not in motors]
        if not (named or (rest and not motors)):
            if set(motors) <= set(self.places):
                return []
            idle, full = DEFAULT_RANGE  # pulses of motors that the ready mapping takes
            return [
                "",
                f"# {' '.join(motors)} turn the vehicle against one another, as motors do: name each as the channel of its "
                "rotor in",
                f"# the vehicle file, with gain = {1.0 / (full - idle):g} and idle = {idle:g} (yours) under [rotors].",
            ]
        surfaces = {s: [p for p in named if named[p] == s] for s in named.values()}
        out = [
            "",
            "# Outputs that move a surface: measure its deflection (trailing edge down is positive), and mix them.",
        ]
        for name in named or rest[: LIMITS.outputs]:
            points = [f"[-1, {-LIMITS.throw}]", f"[1, {LIMITS.throw}]"]
            if not name.startswith("servo"):
                ends = [self.parameters.get(f"SERVO{name[4:]}_{end}", 0.0) for end in ("MIN", "TRIM", "MAX")]
                if not 500.0 <= ends[0] < ends[1] < ends[2] <= 2500.0:
                    ends = [1100.0, 1500.0, 1900.0]
                throws = (-LIMITS.throw, 0.0, LIMITS.throw)
                points = [f"[{us:g}, {x}]" for us, x in zip(ends, throws, strict=True)]
            out += [f"# [calibration.{name}]", f"# points = [{', '.join(points)}]"]
        for surface, names in (surfaces or {"elevator": rest[:1]}).items():
            share = round(1.0 / len(names), 3)
            out += [f"# [surface.{surface}]", f"# from = {{{', '.join(f'{n} = {share!r}' for n in names)}}}"]
        return out

"""What a column of any log may hold: which variable by its name, which unit and sign by what it reads.

The names are in ``column_names.toml``. Numbers are judged by the edits of `stoop_draft.checks.units`, applied to a guess.
"""

from __future__ import annotations

import functools
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Final, NamedTuple

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.flights import Channels, at_own_rates, from_columns
from stoop.extend.text import enumerated
from stoop.extend.units import UNITS
from stoop.extend.variables import VARIABLES
from stoop_draft.checks.engine import LIMITS, Edit, Finding, Range, not_excluded, search
from stoop_draft.checks.entries import Line
from stoop_draft.checks.lines import EAST, EULER, RATES, SPECIFIC_FORCE, SURFACES, VANES, Assignment, Signal
from stoop_draft.checks.mapping import SHOWN, Model, on_grid
from stoop_draft.checks.units import LARGEST, MEDIANS, MIN_ANGLE, PULSES, largest_size, median_size

WRITTEN: Final = {text: symbol for symbol, unit in UNITS.items() for text in unit.written}
LONGEST_NAME: Final = 200  #: letters; no longer name tells anything, and matching takes the square of it
#: command by which pulses of what moves a surface are recorded
_OF_PULSES: Final = {
    "elevator": "control_pitch", "aileron": "control_roll", "rudder": "control_yaw", "throttle": "control_throttle",
    **{name: name for name in ("control_pitch", "control_roll", "control_yaw", "control_throttle")},
}  # fmt: skip
#: unit -> what turns by a name, and what it is then: speeds are of rotors, pulses of motors
_DRIVEN: Final = {"rpm": ("motor_", "rotor_"), "us": ("rotor_", "motor_")}
#: factor (1/us) and offset: of a throttle from 1000 to 2000 us, of others about 1500 us
_PULSE: Final = {True: (1e-3, -1.0), False: (2e-3, -3.0)}
_BRACKETS: Final = re.compile(r"\s*[(\[]\s*([^)\]]*?)\s*[)\]]\s*$")
#: what was asked for, or left over: not what was measured
_ASKED: Final = re.compile(
    r"\b(des|desired|sp|setpoint|target|ref|reference|demand|dem|nav|raw|err|error|bias|std|var|cov)\b"
    r"|delta (?:heading|q|v|x|z|angle)"
)
#: of two frames and of axes, as in w_RS_S_x
_SUBSCRIPT: Final = re.compile(r"_[A-Z]{2}(?:_[A-Z])?_")
_AXES: Final = (("x", "0", "r(?:oll)?"), ("y", "1", "p(?:itch)?"), ("z", "2", "y(?:aw)?"))
GRID_RATE: Final = 50.0  #: Hz, at which the columns of a draft are compared
MAX_SPAN: Final = 1e5  #: s, of a flight; more is a clock in another unit


@dataclass(frozen=True)
class DraftLine:
    """One line of a drafted mapping: what is found where."""

    variable: str
    stream: str
    column: str
    unit: str = ""  #: empty while it is not known
    scale: float = 1.0  #: factor, for example -1
    stated: bool = False  #: whether name or file state the unit
    doubts: tuple[str, ...] = ()  #: why it may be wrong
    remarks: tuple[str, ...] = ()  #: what the numbers show
    commanded: bool = (
        False  #: whether the name says that it is what was asked of an actuator, not where it was
    )
    offset: float = 0.0  #: added after unit and factor, SI

    def doubted(self, why: str) -> DraftLine:
        """Return the line with one more doubt."""
        return self if why in self.doubts else replace(self, doubts=(*self.doubts, why))

    def remarked(self, what: str) -> DraftLine:
        """Return the line with one more remark."""
        return self if what in self.remarks else replace(self, remarks=(*self.remarks, what))

    def turned(self, why: str) -> DraftLine:
        """Return the line with the other sign; what was turned before is turned back."""
        rest = tuple(one for one in self.remarks if not one.startswith("turned"))
        remarks = rest if rest != self.remarks else (*rest, f"turned{why}")
        return replace(self, scale=-self.scale, remarks=remarks)

    def changes(self, other: DraftLine) -> bool:
        """Whether another line reads its column otherwise."""
        return any(getattr(self, key) != getattr(other, key) for key in ("column", "unit", "scale", "offset"))

    @property
    def is_sure(self) -> bool:
        """Whether there is a reason for the unit, or a doubt already."""
        return self.stated or bool(self.remarks) or bool(self.doubts)

    def values(self, x: FloatArray) -> FloatArray:
        """Return a column as the line maps it: SI."""
        unit = UNITS[self.unit or "1"]
        factor = VARIABLES[self.variable].units.get(self.unit, unit.factor)  # of pulses: us
        return x * factor * self.scale + unit.zero + self.offset


class _Rule(NamedTuple):
    variable: str
    pattern: re.Pattern[str]
    scale: float
    doubts: tuple[str, ...]


class _Guess(NamedTuple):
    variable: str
    scale: float = 1.0
    doubts: tuple[str, ...] = ()
    commanded: bool = False


class _Names(NamedTuple):
    suffix: re.Pattern[str]
    title: re.Pattern[str]  #: of a unit as the last of joined words, as in ElevatorDeg
    rules: tuple[_Rule, ...]
    qualifiers: Mapping[str, frozenset[str]]  #: device, position, command, panel -> words


@functools.cache
def _names() -> _Names:
    """Read the names."""
    content = tomllib.loads((files("stoop_draft") / "column_names.toml").read_text("utf-8"))
    units = WRITTEN.keys() - {"1", "-"}  # motor_1 is a number
    longest = sorted(map(re.escape, units), key=len, reverse=True)
    rules = []
    for row in content["rules"]:
        scale, doubts = row.get("scale", 1.0), (row["doubt"],) if "doubt" in row else ()
        start = "^" if row.get("alone") else "(?:^| )"
        what = f"(?:{row['words']})"
        patterns = [[f"{start}{what}$"]]
        if len(row["variables"]) > 1:
            after = [rf"(?:^| )(?:{what}(?: xyz)? ?(?:{x}|{turn}|at {i}))$" for x, i, turn in _AXES]
            before = [rf"(?:^| )(?:(?:{x}|{turn}) {what})$" for x, _, turn in _AXES]
            patterns = [[*both] for both in zip(after, before, strict=True)]
        for variable, texts in zip(row["variables"], patterns, strict=True):
            rules += [_Rule(variable, re.compile(text), scale, doubts) for text in texts]
    suffix = re.compile(rf"[-_ .,]({'|'.join(longest)})(\[\d+\])?$", re.IGNORECASE)
    words = "|".join(text.title() for text in longest if text.isalpha() and len(text) > 1)
    title = re.compile(rf"(?<=[a-z])({words})(\d*)$")
    qualifiers = {kind: frozenset(words.split("|")) for kind, words in content["qualifiers"].items()}
    return _Names(suffix, title, tuple(rules), qualifiers)


def recognized(column: str, stated: str = "", stream: str = "") -> DraftLine | None:
    """Return what a column holds by its name and the unit that the file states; None where the name tells nothing."""
    if len(column) > LONGEST_NAME:
        return None
    bare, ending = without_unit(column)
    said = WRITTEN.get(stated.strip().lower(), "")
    # an ending of one letter may be no unit; one of several may name the quantity, as rpm does
    for name, unit in ((bare, said or ending), (column, said or (ending if len(ending) > 1 else ""))):
        found = _by_words(name)
        if found is None:
            continue
        variable = found.variable.replace(*_DRIVEN.get(unit, ("", "")))
        kind, known = UNITS[unit or "1"].kind, UNITS[VARIABLES[variable].unit].kind
        if (kind, known) == ("an angle", "a rate of turn"):
            short, kind = f"{unit}/s", known  # written short, as gyro_rad is
        else:
            short = unit
        if short == "us" and VARIABLES[variable].kind == "command":
            short, kind = "", known  # pulses, which `_command` tells by their size
        if kind in (known, UNITS["1"].kind):
            line = DraftLine(variable, stream, column, short, found.scale, bool(short), found.doubts)
            return replace(line, commanded=found.commanded)
    return None


def _by_words(name: str) -> _Guess | None:
    """Find variable, scale and doubts by the plain words of a name."""
    text = re.sub(r"\[(\d+)\]", r" at \1 ", _SUBSCRIPT.sub("_", name))
    for pattern in (r"([a-z])([A-Z])", r"([A-Za-z])(\d)", r"(\d)([A-Za-z])"):
        text = re.sub(pattern, r"\1 \2", text)
    text = " ".join(re.findall(r"[a-z]+|\d+", text.lower()))
    if _ASKED.search(text):
        return None
    qualifiers, words = _names().qualifiers, text.split()
    bare = [word for word in words if word not in qualifiers["device"]]
    roles = qualifiers["position"] | qualifiers["command"] | qualifiers["panel"]
    rest = [word for word in bare if word not in roles and not word.isdecimal()]
    found = _by_rules(text) or (_Guess(name) if name in VARIABLES else _by_rules(" ".join(bare)))
    if found is None:
        found = _by_rules(" ".join(rest))
        # a desired attitude is no attitude: the role is left out of what moves an actuator only
        if found is None or VARIABLES[found.variable].kind != "command":
            return None
    if VARIABLES[found.variable].frame != "surface":
        return found
    panel = ("one panel of several",) if qualifiers["panel"] & set(words) else ()
    return found._replace(doubts=found.doubts + panel, commanded=bool(qualifiers["command"] & set(words)))


def _by_rules(text: str) -> _Guess | None:
    """Return what the first rule says that fits plain words."""
    for rule in _names().rules:
        found = rule.pattern.search(text)
        if found is None:
            continue
        if "{n}" not in rule.variable:
            return _Guess(rule.variable, rule.scale, rule.doubts)
        number = next((int(n) for n in found.groups() if n is not None and n.isdecimal()), None)
        # elements of arrays count from zero, names from one
        variable = rule.variable.format(n=(number or 0) + (" at " in text or number == 0))
        known = number is not None and variable in VARIABLES
        return _Guess(variable, rule.scale, rule.doubts) if known else None
    return None


def without_unit(column: str) -> tuple[str, str]:
    """Split a unit off a name, whether in brackets or as an ending; the unit is empty when there is none."""
    if len(column) > LONGEST_NAME:
        return column, ""
    found = _BRACKETS.search(column)
    if found and not found.group(1).isdigit() and found.group(1).lower() in {"", *WRITTEN}:
        return column[: found.start()], WRITTEN.get(found.group(1).lower(), "")
    found = _names().title.search(column) or _names().suffix.search(column)
    if found and found.start() > 0:
        return column[: found.start()] + (found.group(2) or ""), WRITTEN[found.group(1).lower()]
    return column, ""


def with_units(lines: Sequence[DraftLine], columns: Mapping[str, Signal]) -> list[DraftLine]:
    """Choose units, and turn signs, of lines, one for each variable, by what their columns read, as recorded.

    The draft is judged as a whole, by the search that judges any mapping; what the numbers cannot confirm is doubted.
    """
    columns = _at_own_rates(columns)
    known: dict[str, DraftLine] = {}
    for line in lines:
        new = line
        if VARIABLES[line.variable].kind == "command":
            new = _command(line, columns[line.variable][1])
        elif not line.unit and not line.variable.startswith("rotor_"):
            new = replace(line, unit=VARIABLES[line.variable].unit)
        known.setdefault(new.variable, new)
    known, columns = _searched(known, columns)
    known |= {line.variable: line for line in _rotors(known, columns)}
    model = _model(known, columns)
    known = {**known, **{line.variable: line for line in _agreeing(known, model, columns)}}
    for name in (*EULER, *RATES, *VANES):
        if name in known and not known[name].is_sure:
            size = largest_size(columns[name][1])
            known[name] = known[name].doubted(f"{known[name].unit} by its size only: up to {size:.3g}")
    for key, doubt in model.sizes({}, None).items():
        if isinstance(doubt, Range) and doubt.violated and key[0] in ("size", "median", "growth"):
            name = key[1]
            size = median_size(columns[name][1]) if key[0] == "median" else largest_size(columns[name][1])
            known[name] = known[name].doubted(f"{size:.3g} is no {name} in {known[name].unit}")
    return list({**known, **{line.variable: line for line in _unconfirmed(known, model)}}.values())


def _searched(
    known: dict[str, DraftLine], columns: Mapping[str, Signal]
) -> tuple[dict[str, DraftLine], Mapping[str, Signal]]:
    """Return lines with the edits that their numbers show, each judged by what the one before it has shown, and their columns."""
    state = _AS_MAPPED  # with what is told, and not changed
    for _ in range(LIMITS.rounds):
        model = _model(known, columns)
        found, after = search(state, functools.partial(_edits, known, model), model, _ONE)
        if not found:
            break
        evidence = model.sizes({}, None).items()
        violated = [key[1:] for key, one in evidence if isinstance(one, Range) and one.violated]
        alike = [
            pair for pair in model.sizes.pairs if model.sizes.growth({}, *pair)
        ]  # what one shows, the other does
        violated += [pair for pair in alike if any(pair[0] in names for names in violated)]
        contradicted = frozenset(name for names in violated for name in names)
        told = {line.variable: line for line in _applied(known, found[0], contradicted)}
        if not any(line.changes(known[name]) for name, line in told.items()):
            state = after
        known = {**known, **told}
        if found[0].best.kind == "frame":
            taken = {name: column for name, (column, _) in found[0].best.apply(_AS_MAPPED).items()}
            columns = {**columns, **{n: columns[taken[n]] for n in taken if taken[n] in columns}}
    return known, columns


def _rotors(known: Mapping[str, DraftLine], columns: Mapping[str, Signal]) -> Iterator[DraftLine]:
    """Yield rotors without a unit: no flight shows it, but who writes rates in rad/s writes rotors so."""
    rates = next((known[name].unit for name in RATES if name in known), "rad/s")
    for name, line in known.items():
        if not line.unit:
            fast = median_size(columns[name][1]) > MEDIANS[name][1]
            unit = "rad/s" if rates == "rad/s" and not fast else "rpm"
            yield replace(line, unit=unit).doubted("rpm or rad/s: nothing shows which")


def _at_own_rates(columns: Mapping[str, Signal]) -> dict[str, Signal]:
    """Return columns at the rows in which they were read."""
    clocks: dict[int, tuple[FloatArray, dict[str, FloatArray]]] = {}
    for name, (t, x) in columns.items():
        clocks.setdefault(id(t), (t, {}))[1][name] = x
    groups = (one for t, values in clocks.values() for one in at_own_rates(Channels("", t, values))[0])
    return {name: (group.time, x) for group in groups for name, x in group.values.items()}


def _unconfirmed(given: Mapping[str, DraftLine], model: Model) -> Iterator[DraftLine]:
    """Yield lines whose unit or sign other edits would explain as well, with that doubt."""
    known = dict(given)
    for edit in not_excluded(_AS_MAPPED, _edits(known, model, _AS_MAPPED), model):
        name, line = edit.lines[0], known[edit.lines[0]]
        upward = "az" in known and known["az"].scale < 0.0
        if edit.kind == "unit":
            for one, unit in zip(edit.lines, edit.units, strict=True):
                if not known[one].is_sure:
                    together = (
                        f", with {enumerated([n for n in edit.lines if n != one])}" if edit.lines[1:] else ""
                    )
                    doubt = f"{known[one].unit} by its name only: nothing excludes {unit}{together}"
                    known[one] = known[one].doubted(doubt)
        elif len(edit.lines) > 1:
            continue
        elif edit.kind == "sign" and name in SURFACES and not line.doubts:
            known[name] = line.doubted("its sign by its name only")
        elif edit.kind == "sign" and name in ("ay", "q", "r") and upward:
            known[name] = line.doubted("z points up, so y may point to the left: then scale = -1")
    yield from known.values()


_AS_MAPPED: Final[Assignment] = {}
_ONE: Final = replace(LIMITS, rounds=1)


def _edits(known: Mapping[str, DraftLine], model: Model, state: Assignment) -> Iterable[Edit[Assignment]]:
    """Return the edits of a draft, whose lines are all its own."""
    return model.edits(state, {name: Line("", name, known[name].unit) for name in model.signals})


def _model(known: Mapping[str, DraftLine], columns: Mapping[str, Signal]) -> Model:
    """Return the residuals of the draft in flight: of what was measured, and of deflections."""
    judged = [
        n
        for n in known
        if n in columns
        and (VARIABLES[n].kind != "command" or (n in SURFACES and UNITS[known[n].unit].kind == "an angle"))
    ]
    signals = {n: (columns[n][0], known[n].values(columns[n][1])) for n in judged}
    timed = {n: s for n, s in signals.items() if s[0].size > 1 and np.all(np.diff(s[0]) > 0.0)}
    span = max((float(t[-1] - t[0]) for t, _ in timed.values()), default=0.0)
    if not 1.0 < span < MAX_SPAN:
        return Model(signals, {}, GRID_RATE)
    time, data = on_grid(timed, GRID_RATE)
    up = from_columns("drafted", time, data).in_flight()
    return Model(signals, {n: np.where(up, x, np.nan) for n, x in data.items()}, GRID_RATE)


def _applied(
    known: Mapping[str, DraftLine], found: Finding[Assignment], contradicted: frozenset[str]
) -> Iterator[DraftLine]:
    """Yield the lines with an edit, and why; `contradicted` are variables whose own numbers speak against their lines."""
    edit, key = found.best, found.edits[0].channel
    if edit.kind == "sign":
        line = known[edit.lines[0]]
        name = line.variable
        others = [enumerated(one.edit.lines) for one in found.edits[1:]]
        if name == "az" and key[0] == "up":
            yield line.turned(": its z points up")
        elif others:
            yield replace(line, scale=-line.scale).doubted(
                f"turned; or is it {' or '.join(others)} that is to be turned?"
            )
        else:
            by = (
                f"as {key[1] if name == key[-1] else key[-1]} changes against it" if key[0] == "turns" else ""
            )
            yield line.turned(f", {by or SHOWN.get(key[0], 'as other channels show')}")
        return
    if edit.kind == "frame":
        why = f": {edit.value} axes, as other channels show"
        # what the heading counts from follows from where the velocity goes, unless both are turned
        open_north = "psi" in edit.lines and bool({"vn", "pn"} & set(edit.lines))
        for name, (column, factor) in edit.apply(_AS_MAPPED).items():
            line = known[name]
            if column == name:
                yield line.turned(why) if factor < 0.0 else line
                continue
            if column == EAST:
                moved = replace(line, scale=-line.scale, offset=0.5 * math.pi - line.offset)
                moved = moved.remarked(f"counted from east{why}")
            else:
                moved = replace(known[column], variable=name, scale=factor * known[column].scale)
                moved = moved.remarked(f"in place of {line.column}{why}")
            yield moved.doubted("nothing shows where north is") if open_north else moved
        return
    if edit.kind != "unit" or any(
        known[name].stated for name in edit.lines
    ):  # what a file states is not changed
        for name in edit.lines:
            what = f"{enumerated(edit.lines)} look exchanged" if edit.kind == "exchange" else edit.fix
            yield known[name].doubted(f"{what}, as other channels show")
        return
    shown = [name for name in edit.lines if name in contradicted or name in SPECIFIC_FORCE]
    shown = shown or list(edit.lines)
    for name, unit in zip(edit.lines, edit.units, strict=True):
        line = replace(known[name], unit=unit)
        line = replace(line, remarks=tuple(one for one in line.remarks if " by " not in one))
        by = f"{unit} by {SHOWN.get(key[0], 'other channels')}"
        yield line.remarked(by) if name in shown else line.doubted(f"{unit} as {enumerated(shown)}")


def _agreeing(
    given: Mapping[str, DraftLine], model: Model, columns: Mapping[str, Signal]
) -> Iterator[DraftLine]:
    """Yield lines that others confirm: a rate that is the derivative of its angle, gravity, the altitude."""
    known = dict(given)
    for angle, rate in model.sizes.pairs:
        factor = model.sizes.growth({}, angle, rate)
        x = columns[angle][1]
        small = float(np.max(np.abs(x), where=np.isfinite(x), initial=0.0))
        if not factor or (not (known[angle].is_sure or known[rate].is_sure) and small < MIN_ANGLE):
            continue  # both may be in degrees
        if 0.5 < abs(factor) < 2.0:
            known[angle] = known[angle].remarked(f"{rate} is its derivative")
            known[rate] = known[rate].remarked(f"the derivative of {angle}")
        else:
            known[angle] = known[angle].doubted(f"changes {abs(factor):.3g} times as fast as {rate} says")
    force = [name for name in SPECIFIC_FORCE if name in known and name in columns]
    weight = model.sizes.weight({}) if "az" in force else 0.0
    for name in force:
        line = known[name]
        if "az" not in force:
            doubt = "m/s2 or g: without az gravity does not show it"
            known[name] = line if line.stated else line.doubted(doubt)
            continue
        text = f"gravity reads {weight / UNITS[known['az'].unit].factor:.3g}"
        if MEDIANS["az"][0] <= weight <= MEDIANS["az"][1]:
            known[name] = replace(line, remarks=(text, *(r for r in line.remarks if " by " not in r)))
        else:
            known[name] = line.doubted(f"{text}: no weight; gravity left out?")
    yield from known.values()


def _command(line: DraftLine, x: FloatArray) -> DraftLine:
    """Tell pulses, percents, normalized commands and deflections apart."""
    name, size, middle = line.variable, largest_size(x), median_size(x)
    if VARIABLES[name].unit == "N":
        doubt = "N by its name only: nothing shows the size of a force"
        return line if line.stated else replace(line, unit="N").doubted(doubt)
    stem, _, number = name.partition("_")
    if stem == "pwm":
        if line.unit in VARIABLES[name].units:
            return line
        units = [unit for unit, us in VARIABLES[name].units.items() if PULSES[0] <= middle * us <= PULSES[1]]
        if units:
            return replace(line, unit=units[0])
        servo = replace(line, variable=f"servo_{number}", unit="1")
        if middle <= 1.5:
            return servo.doubted("no pulses, rather normalized: servo or motor?")
        return replace(line, unit="us").doubted(f"{middle:.3g} in the median is no pulse in us")
    if PULSES[0] <= middle <= PULSES[1]:
        if number.isdigit():
            return replace(line, variable=f"pwm_{number}", unit="us").remarked("pulses")
        if name in _OF_PULSES:
            variable, (scale, offset) = _OF_PULSES[name], _PULSE[name.endswith("throttle")]
            normalized = replace(line, variable=variable, unit="1", scale=scale, offset=offset, doubts=())
            return normalized.remarked("pulses, normalized")
        return replace(line, unit="1").doubted("these are pulses: name them pwm_N and add a calibration")
    if stem in ("elevator", "aileron", "rudder", "flap"):
        return _surface(line, size)
    if size > 2500.0:
        return replace(line, unit="1", scale=1.0 / 65535.0).doubted(f"up to {size:.5g}: 16 bits?")
    if size > 1.5 and not line.unit:
        return replace(line, unit="percent").remarked(f"up to {size:.3g}: percent")
    return replace(line, unit=line.unit or VARIABLES[name].unit)


def _surface(line: DraftLine, size: float) -> DraftLine:
    if line.unit and UNITS[line.unit].kind == "an angle":
        return line
    if line.unit or 0.8 < size <= 1.01:
        plain = replace(line, unit=line.unit or "1")
        return plain.doubted("normalized, no angle: name it servo_N and add a calibration")
    if size > LARGEST.get(line.variable, math.inf):
        return replace(line, unit="deg").remarked(f"up to {size:.3g}: degrees")
    return replace(line, unit="rad").doubted(f"up to {size:.3g}: rad, or a normalized command?")

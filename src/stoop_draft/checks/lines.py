"""Single edits of the lines of a mapping: another sign, unit or scale, or two exchanged columns.

The state of the search says which column each variable takes and by what that is multiplied, so that an edit costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.units import UNITS
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop_draft.checks.engine import Edit
from stoop_draft.checks.entries import TABLE, Change, Lines, told, where

Signal: TypeAlias = tuple[FloatArray, FloatArray]  #: time (n,) s and values (n,)
#: variable -> variable whose column it takes, and by what that is multiplied; as mapped where it is not named
Assignment: TypeAlias = Mapping[str, tuple[str, float]]

AIRSPEEDS: Final = ("V", "airspeed_pitot", "airspeed_equivalent")
VANES: Final = ("alpha", "beta")
EAST: Final = "psi from east"  #: column of headings that were counted from east to north
SURFACES: Final = ("elevator", "aileron", "rudder")
RATES, EULER, QUATERNION, SPECIFIC_FORCE, VELOCITY, POSITION = (
    FAMILIES[n] for n in ("rates", "euler", "quaternion", "specific force", "velocity", "position")
)
TWICE: Final = (
    math.radians(1.0),
    math.degrees(1.0),
)  #: factors of what was converted twice: no numbers that are fitted
SENSORS: Final = (EULER, RATES, SPECIFIC_FORCE, VELOCITY, POSITION, VANES, SURFACES)  #: what shares a unit
#: whose sign the residuals can show
SIGNED: Final[tuple[str, ...]] = (
    *RATES,
    *EULER,
    *SPECIFIC_FORCE,
    *VELOCITY,
    *POSITION,
    "altitude",
    *VANES,
    *SURFACES,
)
EXCHANGED: Final = (
    ("vn", "ve"), ("pn", "pe"), ("p", "q"), ("q", "r"), ("p", "r"), ("phi", "theta"), ("ax", "ay"), VANES,
    ("elevator", "aileron"), ("elevator", "rudder"), ("aileron", "rudder"),
)  # fmt: skip
_EVERY_SPEED: Final = ((VELOCITY[:2],), (VELOCITY[:2], AIRSPEEDS), (VELOCITY, AIRSPEEDS))
_HEIGHT: Final = (("altitude", "vd"),)
#: units of a recorder by SI unit or by variable, and the sensors that it may have written all in these
SYSTEMS: Final[tuple[tuple[Mapping[str, str], tuple[tuple[tuple[str, ...], ...], ...]], ...]] = (
    ({"rad": "deg", "rad/s": "deg/s"}, ((EULER, RATES),)),
    ({"rad": "rad", "rad/s": "rad/s"}, ((EULER, RATES),)),
    ({"m/s": "kt"}, _EVERY_SPEED),
    ({"m/s": "km/h"}, _EVERY_SPEED),
    ({"m/s": "ft/s"}, _EVERY_SPEED),
    ({"m": "ft", "vd": "ft/min"}, (_HEIGHT,)),
    ({"m": "ft", "m/s": "ft/s"}, (_HEIGHT, (*_HEIGHT, VELOCITY[:2], POSITION), (*_HEIGHT, VELOCITY[:2], AIRSPEEDS))),
    ({"m": "ft", "vd": "ft/min", "m/s": "kt"}, ((*_HEIGHT, AIRSPEEDS), (*_HEIGHT, VELOCITY[:2], AIRSPEEDS))),
)  # fmt: skip
#: units that logs use, the most usual first; those in one text are as usual
USUAL: Final[Mapping[str, tuple[str, ...]]] = {
    "an angle": ("rad", "deg"),
    "a rate of turn": ("rad/s", "deg/s"),
    "an acceleration": ("m/s2", "g", "mg", "cm/s2", "mm/s2"),
    "a speed": ("m/s", "kt km/h ft/s", "cm/s", "mm/s"),
    "a length": ("m", "ft", "cm", "mm"),
    "a voltage": ("V", "mV"),
    "a pressure": ("Pa", "hPa", "kPa"),
    "a temperature": ("K", "degC"),
}
OF_VARIABLES: Final[Mapping[str, tuple[str, ...]]] = {
    "vd": ("m/s", "kt km/h ft/s ft/min", "cm/s", "mm/s"),
    **dict.fromkeys(FAMILIES["rotor"], ("rad/s", "rpm")),
    **dict.fromkeys(FAMILIES["pwm"], ("us", "s", "ms")),
    **dict.fromkeys(
        ("throttle", "control_throttle", *FAMILIES["motor"], *FAMILIES["servo"]), ("1", "percent")
    ),
}  #: the same of variables whose kind does not tell


@dataclass(frozen=True)
class Odds:
    """Logarithms of how likely a wrong line is before any data, against one as likely as any."""

    odd_unit: float = 3.0  #: a line has another unit than its siblings, which are of one sensor
    several: float = -3.0  #: all angles or rates at once, or lines of several sensors
    one_axis: float = -10.0  #: one axis of the specific force alone
    one_of_several: float = -3.0  #: one velocity, position or surface alone
    less_usual: float = -3.0  #: each next unit in a list by usage
    scale: float = -5.0  #: any factor: that it is fitted is paid for
    scales: float = -6.0  #: any factor of all rates: less likely than that all are in another unit
    downward: float = -2.0  #: an altitude that counts downward
    frame: float = -3.0  #: all axes of a sensor, or of several, point another way


ODDS: Final = Odds()


def reading(state: Assignment, name: str) -> tuple[str, float]:
    """Return which column a variable takes, and its factor."""
    return state.get(name, (name, 1.0))


def multiplied(names: Sequence[str], factor: float) -> Callable[[Assignment], Assignment]:
    """Return an edit that multiplies columns."""

    def apply(state: Assignment) -> Assignment:
        columns = ((name, reading(state, name)) for name in names)
        return {**state, **{name: (column, factor * known) for name, (column, known) in columns}}

    return apply


def counted_from_east(state: Assignment) -> Assignment:
    """Take the heading for one that was counted from east to north."""
    return {**state, "psi": (EAST, reading(state, "psi")[1])}


def exchanged(one: str, other: str) -> Callable[[Assignment], Assignment]:
    """Return an edit that exchanges two columns."""
    return lambda state: {**state, one: reading(state, other), other: reading(state, one)}


def with_east(data: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return columns with the heading as it is where it was counted from east to north."""
    if "psi" not in data:
        return dict(data)
    return {**data, EAST: 0.5 * np.pi - data["psi"]}


def corrected(state: Assignment, data: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return columns as a state reads them; the quaternion follows edited angles."""
    out, columns = dict(data), with_east(data)
    for name, (column, factor) in state.items():
        if name in data and column in columns:
            out[name] = factor * columns[column]
    if set(EULER) <= data.keys() and set(EULER) & state.keys():
        angles = np.column_stack([out[name] for name in EULER])
        out.update(zip(QUATERNION, rotations.quaternions_of(angles).T, strict=True))
    return out


@dataclass(frozen=True)
class LineEdit(Edit[Assignment]):
    """An edit of lines of a mapping."""

    def changes(self, lines: Lines) -> tuple[Change, ...]:
        """Return what each line says then; none where a line is no user's, or no plain column along the axes of stoop."""
        if not all(name in lines and lines[name].plain for name in self.lines):
            return ()
        out: list[Change] = []
        for name, (column, factor) in self.apply({}).items():
            line = lines[name]
            if self.kind == "unit":
                out.append(line.changed("unit", self.units[self.lines.index(name)], ""))
            elif self.kind == "pulses":
                out += [line.changed("scale", 1e-3, 1.0), line.changed("offset", -1.0, 0.0)]
            elif column == EAST:
                offset = 0.5 * np.pi - line.value("offset", 0.0)
                out += [
                    line.changed("offset", offset, 0.0),
                    line.changed("scale", -line.value("scale", 1.0), 1.0),
                ]
            else:
                taken = lines[column]
                if column != name and not line.same_stream(taken):
                    return ()
                keys = {
                    "column" if "column" in line.entry else "columns": "",
                    "unit": "",
                    "scale": 1.0,
                    "offset": 0.0,
                }
                values = {key: taken.value(key, default) for key, default in keys.items()}
                values |= {key: factor * values[key] for key in ("scale", "offset")}
                out += [
                    line.changed(key, value, keys[key])
                    for key, value in values.items()
                    if value != line.value(key, keys[key])
                ]
        for name in self.lines:  # a line that is not in the mapping yet is written whole
            line = lines[name]
            if line.ready:
                entry = {
                    **line.entry,
                    **{change.key: change.value for change in out if change.table == line.key},
                }
                out = [change for change in out if change.table != line.key]
                out += [Change(line.key, key, value) for key, value in entry.items()]
        tables = [(change.table, change.key) for change in out]
        # lines of one group share their lists
        return tuple(out) if len(set(tables)) == len(tables) else _merged(out, lines)

    def advice(self, lines: Lines) -> str:
        """Return what to write and where; what to multiply where columns stand in no file."""
        changes, place = self.changes(lines), where(self.lines, lines)
        if changes:
            return told(changes, lines)
        if any(name not in lines or lines[name].file != TABLE for name in self.lines):
            return f"{self.fix} for {place}"
        if self.kind in ("sign", "scale"):
            return f"multiply {place} by {self.fix.rpartition(' ')[2]}"
        converted = self.kind in ("unit", "frame")
        return f"convert {place} from {self.value}" if converted else f"{self.fix} for {place}"


def _merged(changes: Sequence[Change], lines: Lines) -> tuple[Change, ...]:
    """Return changes of lists of the same table as one, each with what changes in any of them."""
    before = {line.key: line for line in lines.values()}
    out: dict[tuple[str, str], Change] = {}
    for change in changes:
        known = out.get(change[:2])
        if known is not None and isinstance(change.value, list):
            default = {"scale": 1.0, "offset": 0.0}.get(change.key, "")
            old = before[change.table].entry.get(change.key, default)
            was = old if isinstance(old, list) else [old] * len(change.value)
            value = [b if b != c else a for a, b, c in zip(known.value, change.value, was, strict=True)]
            change = change._replace(value=value)
        out[change[:2]] = change
    return tuple(out.values())


def mapping_edits(
    signals: Mapping[str, Signal],
    judged: Iterable[str],
    lines: Lines,
    scales: Mapping[tuple[str, ...], float],
) -> Iterator[Edit[Assignment]]:
    """Yield every single edit of a mapping.

    Parameters
    ----------
    signals : variable -> its samples
    judged : variables whose sign and exchange the residuals can show
    lines : what the user wrote; other lines, of ready mappings, have a right sign but for the rates
    scales : variables -> one factor of all of them that the others show
    """
    there, units = signals.keys(), {name: lines[name].unit if name in lines else "" for name in signals}
    signed = (lines.keys() | {*RATES, "az"}) & set(judged)
    for name in (name for name in SIGNED if name in signed):
        prior = ODDS.downward if name == "altitude" else 0.0
        yield LineEdit("sign", (name,), "write scale = -1", multiplied((name,), -1.0), prior=prior)
    for one, other in EXCHANGED:
        if {one, other} <= signed:
            yield LineEdit(
                "exchange", (one, other), "exchange the columns", exchanged(one, other), complete=True
            )
    for names, factor in scales.items():
        as_unit = factor in TWICE and (factor < 1.0) == (_factor(names[0], units[names[0]]) == 1.0)
        if lines.keys() >= set(names) and not as_unit:
            change, fix = multiplied(names, factor), f"multiply scale by {factor:.3g}"
            prior = 0.0 if factor in TWICE else ODDS.scale if len(names) == 1 else ODDS.scales
            yield LineEdit("scale", names, fix, change, _complete(names, factor), prior)
    grouped = {name for sensor in SENSORS for name in sensor}
    for sensor in SENSORS:
        own = tuple(name for name in sensor if name in there)
        if len(own) > 1 and len({units[name] for name in own}) == 1:
            yield from _units(
                own, units[own[0]], 0.0 if sensor in (SPECIFIC_FORCE, VELOCITY, POSITION) else ODDS.several
            )
        for name in own:
            yield from _of_one(name, units, {units[n] for n in own if n != name} - {""}, len(own))
    for name in (name for name in there if name not in grouped):
        yield from _units((name,), units[name], 0.0, signals[name])
        if name.startswith("motor_"):
            advice = f"write scale = 0.001 and offset = -1 (of 1000 to 2000 us), or call it pwm_{name[6:]},"
            yield LineEdit("pulses", (name,), advice, multiplied((name,), 0.5e-3))
    yield from _of_systems(units)


def _of_systems(units: Mapping[str, str]) -> Iterator[Edit[Assignment]]:
    """Yield other units of lines of several sensors, which one recorder wrote: those that do not have them."""
    seen = {tuple(name for name in sensor if name in units) for sensor in SENSORS}  # whose edits there are
    for system, sets in SYSTEMS:
        for sensors in sets:
            every = [name for sensor in sensors for name in sensor if name in units]
            other = {name: system.get(name, system.get(VARIABLES[name].unit, "")) for name in every}
            now = {name: _factor(name, units[name] or VARIABLES[name].unit) for name in every}
            names = tuple(name for name in every if _factor(name, other[name]) != now[name])
            if len(names) > 1 and not {names, (*names, *(other[name] for name in names))} & seen:
                seen.add((*names, *(other[name] for name in names)))
                factors = {name: (_factor(name, other[name]) / now[name], other[name]) for name in names}
                smaller = any(factor < 1.0 for factor, _ in factors.values())
                yield _unit_of_each(factors, smaller, ODDS.several)


def _unit_of_each(factors: Mapping[str, tuple[float, str]], complete: bool, prior: float) -> Edit[Assignment]:
    """Return the edit that gives each line another unit, by its factor."""

    def change(state: Assignment) -> Assignment:
        for name, (factor, _) in factors.items():
            state = multiplied((name,), factor)(state)
        return state

    units = tuple(unit for _, unit in factors.values())
    value = " and ".join(dict.fromkeys(units))
    fix = " and ".join(f'unit = "{unit}"' for unit in dict.fromkeys(units))
    return LineEdit("unit", tuple(factors), f"write {fix}", change, complete, prior, value, units)


def _of_one(
    name: str, units: Mapping[str, str], siblings: set[str], count: int
) -> Iterator[Edit[Assignment]]:
    """Yield other units of one line of a sensor."""
    odd = len(siblings) == 1 and units[name] not in {"", *siblings}
    if name in SPECIFIC_FORCE:
        if odd and count == len(SPECIFIC_FORCE):
            yield _unit((name,), units[name], next(iter(siblings)), 0.0)
        if name == "az":
            yield from _units((name,), units[name], ODDS.one_axis)
        return
    alone = count == 1 or name in (*EULER, *RATES, *VANES)
    yield from _units((name,), units[name], ODDS.odd_unit if odd else 0.0 if alone else ODDS.one_of_several)


def _units(
    names: tuple[str, ...], unit: str, prior: float, signal: Signal | None = None
) -> Iterator[Edit[Assignment]]:
    """Yield the edits that give columns another unit, the most usual first."""
    si = VARIABLES[names[0]].unit
    usual = OF_VARIABLES.get(names[0], USUAL.get(UNITS[si].kind, ()))
    now = _factor(names[0], unit or si)
    known = np.empty(0) if signal is None else signal[1][np.isfinite(signal[1])]
    level = float(np.median(known)) if known.size else 0.0  # of a sensor that reads nothing
    if "degC" in usual and unit != "degC" and level != 0.0:
        warmer = multiplied(names, 1.0 + UNITS["degC"].zero / level)
        yield LineEdit("unit", names, 'write unit = "degC"', warmer, True, prior, "degC", ("degC",))
    others = [[u for u in units.split() if u != "degC" and _factor(names[0], u) != now] for units in usual]
    for rank, units in enumerate(units for units in others if units):
        for other in units:
            yield _unit(names, unit, other, prior + rank * ODDS.less_usual)


def _factor(name: str, unit: str) -> float:
    return VARIABLES[name].units.get(unit, 1.0)


def _unit(names: tuple[str, ...], unit: str, other: str, prior: float) -> Edit[Assignment]:
    """Return the edit that gives lines of one sensor another unit."""
    factor = _factor(names[0], other) / _factor(names[0], unit or VARIABLES[names[0]].unit)
    return _unit_of_each(dict.fromkeys(names, (factor, other)), _complete(names, factor), prior)


def _complete(names: Sequence[str], factor: float) -> bool:
    """Tell whether an edit must explain the motion: but larger rates, from which an attitude is predicted, hide no noise."""
    return not (set(names) <= set(RATES) and factor > 1.0)

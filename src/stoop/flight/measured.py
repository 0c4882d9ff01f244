"""What the numbers of a column say of its unit and its sign: sizes, gravity, rates against angles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import wrap
from stoop.base.units import DEGREE, FACTORS, KINDS, PULSE_FACTORS, STANDARD_GRAVITY, ZEROS
from stoop.base.variables import VARIABLES
from stoop.checks.units import LARGEST, MEDIANS
from stoop.flight.time_delay import Signal

SPAN: Final = 0.2  #: s over which an angle is differenced
ALIKE: Final = 0.8  #: correlation of an angle's change and a rate's integral, that shows they belong together
LEAST: Final = 50  #: samples that say anything
CALM: Final = 3.0 * DEGREE  #: rad; no flight stays below
PAIRS: Final = (("phi", "p"), ("theta", "q"), ("psi", "r"))
FORCE: Final = ("ax", "ay", "az")
SURFACES: Final = ("elevator", "aileron", "rudder", "flap")
PULSE: Final = (700.0, 2500.0)  #: us; a median between these is a pulse


@dataclass(frozen=True)
class Line:
    """One line of a mapping to be.

    Attributes
    ----------
    variable, stream, column : what is found where
    unit : empty while it is not known
    scale : factor, for example -1
    said : whether name or file state the unit
    doubts : why it may be wrong
    remarks : what was seen
    """

    variable: str
    stream: str
    column: str
    unit: str = ""
    scale: float = 1.0
    said: bool = False
    doubts: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def doubted(self, why: str) -> Line:
        """Return the line with one more doubt."""
        return replace(self, doubts=(*self.doubts, why))

    def remarked(self, what: str) -> Line:
        """Return the line with one more remark."""
        return replace(self, remarks=(*self.remarks, what))

    def values(self, x: FloatArray) -> FloatArray:
        """Return a column as the line maps it: SI."""
        factor = PULSE_FACTORS[self.unit] if self.variable.startswith("pwm_") else FACTORS[self.unit or "1"]
        return x * factor * self.scale + ZEROS.get(self.unit, 0.0)


Columns = Mapping[str, Signal]  #: variable -> the samples of its line, as recorded


def with_units(lines: Sequence[Line], columns: Columns) -> list[Line]:
    """Choose units, and turn signs, by what the numbers say.

    Parameters
    ----------
    lines : one for each variable
    columns : variable -> samples of its column, as recorded
    """
    known = {line.variable: line for line in lines}
    known = _sized(known, columns)
    known = _paired(known, columns)
    known = _weighed(known, columns)
    known = _upright(known, columns)
    return list(known.values())


def _size(x: FloatArray, share: float = 0.995) -> float:
    seen = np.abs(x[np.isfinite(x)])
    return float(np.quantile(seen, share)) if seen.size else 0.0


def _sized(known: dict[str, Line], columns: Columns) -> dict[str, Line]:
    """Choose units by the size of each column alone."""
    out: dict[str, Line] = {}
    for name, line in known.items():
        x = columns[name][1]
        new = _output(line, x) if VARIABLES[name].kind == "command" else _measurement(line, x)
        if new.variable not in out:
            out[new.variable] = new
    return out


def _measurement(line: Line, x: FloatArray) -> Line:
    name, size = line.variable, _size(x)
    kind = KINDS[VARIABLES[name].unit]
    if line.unit or name in FORCE:
        return line
    if kind in ("an angle", "a rate of turn"):
        ending = "/s" if kind == "a rate of turn" else ""
        if name.startswith("rotor_"):
            return replace(line, unit="rpm").doubted("rpm or rad/s: nothing tells")
        if size > LARGEST.get(name, math.inf):
            return replace(line, unit=f"deg{ending}").remarked(f"up to {size:.3g}: degrees")
        return replace(line, unit=f"rad{ending}")
    if name == "temperature" and size < 100.0:
        return replace(line, unit="degC")
    return _ranged(line, _size(x, 0.5))


def _ranged(line: Line, size: float) -> Line:
    """Choose the unit that brings the median size to where flights have it."""
    unit = VARIABLES[line.variable].unit
    known = MEDIANS.get(line.variable)
    if known is None or known.low <= size <= known.high:
        return replace(line, unit=unit)
    meant = [u for u in known.units if known.low <= size * FACTORS[u] / FACTORS[unit] <= known.high]
    if meant:
        return replace(line, unit=meant[0]).remarked(f"{size:.3g} in the median: {meant[0]}")
    return replace(line, unit=unit).doubted(f"{size:.3g} in the median is no {line.variable} in {unit}")


def _output(line: Line, x: FloatArray) -> Line:
    """Tell pulses, percents, normalized commands and deflections apart."""
    name, size, middle = line.variable, _size(x), _size(x, 0.5)
    stem, _, number = name.partition("_")
    if PULSE[0] <= middle <= PULSE[1] and not name.startswith("pwm_"):
        pulses = f"pwm_{number}" if number.isdigit() else name
        if pulses == name:
            return replace(line, unit="1").doubted("these are pulses: name them pwm_N and add a calibration")
        return replace(line, variable=pulses, unit="us").remarked("pulses")
    if name.startswith("pwm_"):
        return _pulse(line, middle)
    if stem in SURFACES:
        return _surface(line, size)
    if size > 2500.0:
        return replace(line, unit="1", scale=1.0 / 65535.0).doubted(f"up to {size:.5g}: 16 bits?")
    if size > 1.5 and not line.unit:
        return replace(line, unit="percent").remarked(f"up to {size:.3g}: percent")
    return replace(line, unit=line.unit or VARIABLES[name].unit)


def _pulse(line: Line, middle: float) -> Line:
    if line.unit in PULSE_FACTORS:
        return line
    for unit, many in PULSE_FACTORS.items():
        if PULSE[0] <= middle * many <= PULSE[1]:
            return replace(line, unit=unit)
    number = line.variable.partition("_")[2]
    if middle <= 1.5:
        return replace(line, variable=f"servo_{number}", unit="1").doubted(
            "no pulses, rather normalized: servo or motor?"
        )
    return replace(line, unit="us").doubted(f"{middle:.3g} in the median is no pulse in us")


def _surface(line: Line, size: float) -> Line:
    if line.unit and KINDS[line.unit] == "an angle":
        return line
    if line.unit == "1" or 0.8 < size <= 1.01:
        words = "normalized, no angle: name it servo_N and add a calibration"
        return replace(line, unit="1").doubted(words)
    if size > LARGEST.get(line.variable, math.inf):
        return replace(line, unit="deg").remarked(f"up to {size:.3g}: degrees")
    return replace(line, unit="rad").doubted(f"up to {size:.3g}: rad, or a normalized command?")


def _paired(known: dict[str, Line], columns: Columns) -> dict[str, Line]:
    """Compare each angle with the rate that is nearly its derivative: units and signs."""
    out = dict(known)
    for angle, rate in PAIRS:
        if angle in out and rate in out and {angle, rate} <= columns.keys():
            out[angle], out[rate] = _pair(out[angle], out[rate], columns[angle], columns[rate])
    for siblings in zip(*PAIRS, strict=True):
        out = _as_siblings(out, siblings)
    for name in ("phi", "theta", "psi", "p", "q", "r", "alpha", "beta"):
        if name in out and not _is_sure(out[name]) and name in columns:
            out[name] = out[name].doubted(_smallness(out[name], columns[name][1]))
    return out


def _as_siblings(known: dict[str, Line], siblings: Sequence[str]) -> dict[str, Line]:
    """Give what nothing tells of the unit of its siblings, which are of one sensor."""
    there = [known[name] for name in siblings if name in known]
    told = [line for line in there if line.said or line.remarks]
    if len({line.unit for line in told}) != 1:
        return known
    unit, names = told[0].unit, " and ".join(line.variable for line in told)
    new = [replace(line, unit=unit).doubted(f"{unit} as {names}") for line in there if line not in told]
    return known | {line.variable: line for line in new}


def _is_sure(line: Line) -> bool:
    return line.said or bool(line.remarks) or bool(line.doubts)


def _smallness(line: Line, x: FloatArray) -> str:
    unit = VARIABLES[line.variable].unit
    return f"{unit} by its size only: up to {_size(x):.3g}"


def _pair(angle: Line, rate: Line, a: Signal, r: Signal) -> tuple[Line, Line]:
    ratio, likeness = growth((a[0], angle.values(a[1])), (r[0], rate.values(r[1])))
    if abs(likeness) < ALIKE:
        return angle, rate
    if ratio < 0.0:
        rate = replace(rate, scale=-rate.scale).doubted(
            f"turned, as {angle.variable} changes against it; or is it {angle.variable} that is to be turned?"
        )
    told = f"{rate.variable} is its derivative"
    factor = abs(ratio)
    if 0.5 < factor < 2.0:
        if not _is_sure(angle) and not _is_sure(rate) and _size(a[1]) < CALM:
            return angle, rate
        return angle.remarked(told), rate.remarked(f"the derivative of {angle.variable}")
    if 0.5 < factor * DEGREE < 2.0:
        return _degrees(angle, rate, told)
    if 0.5 < factor / DEGREE < 2.0:
        rate, angle = _degrees(rate, angle, f"{angle.variable} is its integral")
        return angle, rate
    return angle.doubted(f"changes {factor:.3g} times as fast as {rate.variable} says"), rate


def _degrees(accused: Line, other: Line, told: str) -> tuple[Line, Line]:
    """Give the unit in degrees to the one of a pair that is 57.3 times too large."""
    ending = "/s" if VARIABLES[accused.variable].unit.endswith("/s") else ""
    if accused.said and other.said:
        return accused.doubted(f"57.3 times as large as {other.variable} says: wrong unit"), other
    if accused.unit.startswith("deg"):  # then the other one is in degrees as well
        more = "/s" if VARIABLES[other.variable].unit.endswith("/s") else ""
        return accused.remarked(told), replace(other, unit=f"deg{more}").remarked(told)
    return replace(accused, unit=f"deg{ending}").remarked(f"{told}, 57.3 times as large"), other.remarked(
        "radians"
    )


def growth(angle: Signal, rate: Signal) -> tuple[float, float]:
    """Return how many times faster an angle changes than a rate says, with its sign, and their correlation.

    Parameters
    ----------
    angle : time (n,) s and values (n,) rad
    rate : time (m,) s and values (m,) rad/s
    """
    t, x = (part[np.isfinite(angle[1])] for part in angle)
    s, w = (part[np.isfinite(rate[1])] for part in rate)
    if t.size < LEAST or s.size < LEAST:
        return math.nan, 0.0
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (w[1:] + w[:-1]) * np.diff(s))])
    integral = np.interp(t, s, turned, left=np.nan, right=np.nan)
    steps = max(1, round(min(SPAN / float(np.median(np.diff(t))), t.size)))
    change = x[steps:] - x[:-steps]
    if np.abs(x).max() < 10.0:  # radians: a jump of a turn is none
        change = wrap(change)
    said = integral[steps:] - integral[:-steps]
    good = np.isfinite(said) & np.isfinite(change)
    good &= np.abs(change) <= 20.0 * np.median(np.abs(change[good])) + 1e-12 if good.any() else good
    a, b = change[good], said[good]
    power = float(a @ a) * float(b @ b)
    if a.size < LEAST or power == 0.0:
        return math.nan, 0.0
    likeness = float(a @ b) / math.sqrt(power)
    return math.copysign(math.sqrt(float(a @ a) / float(b @ b)), likeness), likeness


def _weighed(known: dict[str, Line], columns: Columns) -> dict[str, Line]:
    """Let gravity tell unit and sign of the specific force."""
    there = [name for name in FORCE if name in known and name in columns]
    if "az" not in there:
        return {
            name: replace(line, unit=line.unit or "m/s2").doubted("m/s2 or g: without az gravity cannot tell")
            if name in there and not line.said
            else line
            for name, line in known.items()
        }
    parts = [columns[name][1] for name in there]
    same = all(part.size == parts[0].size for part in parts)
    size = _size(np.sqrt(sum(x**2 for x in parts)) if same else columns["az"][1], 0.5)
    units = [("m/s2", STANDARD_GRAVITY), ("g", 1.0), ("mg", 1e3), ("cm/s2", 980.665), ("mm/s2", 9806.65)]
    meant = next((unit for unit, weight in units if 0.6 < size / weight < 1.6), "")
    out = dict(known)
    for name in there:
        out[name] = _weighed_line(out[name], size, meant)
    return _turned_up(out, columns, there)


def _weighed_line(line: Line, size: float, meant: str) -> Line:
    if not meant:
        return replace(line, unit=line.unit or "m/s2").doubted(
            f"{size:.3g} in the median is no weight; gravity left out?"
        )
    if line.said and line.unit != meant:
        return line.doubted(f"gravity reads {size:.3g}: rather {meant}")
    return replace(line, unit=meant).remarked(f"gravity reads {size:.3g}")


def _turned_up(known: dict[str, Line], columns: Columns, there: Sequence[str]) -> dict[str, Line]:
    x = columns["az"][1]
    az = known["az"]
    middle = float(np.median(x[np.isfinite(x)])) * az.scale if np.isfinite(x).any() else 0.0
    if middle <= 0.0:
        return known
    out = {**known, "az": replace(az, scale=-az.scale).remarked("its z points up: turned")}
    for name in ("ay",) if "ay" in there else ():
        out[name] = out[name].doubted("z points up, so y may point to the left: then scale = -1")
    return out


def _upright(known: dict[str, Line], columns: Columns) -> dict[str, Line]:
    """Let the altitude tell whether z and its velocity count up or down."""
    out = dict(known)
    for name in ("pd", "vd"):
        line = out.get(name)
        if line is None or "altitude" not in out:
            continue
        t, height = columns["altitude"]
        rise = height if name == "pd" else np.gradient(height, t)
        at, x = columns[name]
        there = np.interp(at, t, rise, left=np.nan, right=np.nan)
        good = np.isfinite(there) & np.isfinite(x)
        if np.count_nonzero(good) < LEAST or not np.std(there[good]) > 0.0 or not np.std(x[good]) > 0.0:
            continue
        likeness = float(np.corrcoef(there[good], x[good])[0, 1]) * line.scale
        if abs(likeness) > ALIKE:
            turned = replace(line, scale=-line.scale) if likeness > 0.0 else line
            out[name] = turned.remarked(
                "counts down, as the altitude shows" + (": turned" * (likeness > 0.0))
            )
    return out

"""Units and signs of a drafted mapping by what its columns read: the edits of `stoop.checks.units`, applied to a guess."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.text import enumerated
from stoop.base.units import DEGREE, FACTORS, KINDS, PULSE_FACTORS, ZEROS
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VARIABLES
from stoop.checks.engine import Finding, Range, search
from stoop.checks.lines import Line
from stoop.checks.units import (
    LARGEST,
    MEDIANS,
    PULSES,
    UNITS,
    Factors,
    Signal,
    UnitModel,
    largest_size,
    median_size,
    unit_edits,
)

MIN_ANGLE: Final = 3.0 * DEGREE  #: rad; no flight stays below
SURFACES: Final = ("elevator", "aileron", "rudder", "flap")
TURNING: Final = (*EULER, *RATES, "alpha", "beta")


@dataclass(frozen=True)
class DraftLine:
    """One line of a drafted mapping.

    Attributes
    ----------
    variable, stream, column : what is found where
    unit : empty while it is not known
    scale : factor, for example -1
    stated : whether name or file state the unit
    doubts : why it may be wrong
    remarks : what the numbers show
    """

    variable: str
    stream: str
    column: str
    unit: str = ""
    scale: float = 1.0
    stated: bool = False
    doubts: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def doubted(self, why: str) -> DraftLine:
        """Return the line with one more doubt."""
        return replace(self, doubts=(*self.doubts, why))

    def remarked(self, what: str) -> DraftLine:
        """Return the line with one more remark."""
        return replace(self, remarks=(*self.remarks, what))

    def values(self, x: FloatArray) -> FloatArray:
        """Return a column as the line maps it: SI."""
        factor = PULSE_FACTORS[self.unit] if self.variable.startswith("pwm_") else FACTORS[self.unit or "1"]
        return x * factor * self.scale + ZEROS.get(self.unit, 0.0)


def with_units(lines: Sequence[DraftLine], columns: Mapping[str, Signal]) -> list[DraftLine]:
    """Choose units, and turn signs, by what the numbers say.

    Parameters
    ----------
    lines : one for each variable
    columns : variable -> samples of its column, as recorded
    """
    known: dict[str, DraftLine] = {}
    for line in lines:
        x = columns[line.variable][1]
        new = _command(line, x) if VARIABLES[line.variable].kind == "command" else _with_default(line)
        known.setdefault(new.variable, new)
    for _ in range(2):  # once sizes have shown degrees, headings can be compared with the yaw rate
        model, found = _searched(known, columns)
        contradicted = frozenset(
            name
            for key, one in model({}, None).items()
            if isinstance(one, Range) and one.violated
            for name in key[1:]
        )
        for one in found:
            known = _applied(known, one, contradicted)
    model, _ = _searched(known, columns)
    return list(_doubted(_agreeing(known, model, columns), model, columns).values())


def _with_default(line: DraftLine) -> DraftLine:
    if line.unit:
        return line
    if line.variable.startswith("rotor_"):
        return replace(line, unit="rpm").doubted("rpm or rad/s: nothing tells")
    return replace(line, unit=VARIABLES[line.variable].unit)


def _searched(
    known: Mapping[str, DraftLine], columns: Mapping[str, Signal]
) -> tuple[UnitModel, list[Finding[Factors]]]:
    """Return what the measured columns contradict in the draft; what a file states is not changed, but signs are."""
    signals = {
        name: (columns[name][0], line.values(columns[name][1]))
        for name, line in known.items()
        if name in columns and VARIABLES[name].kind != "command"
    }
    model = UnitModel(signals, signs=True)
    units = {name: Line("", name, known[name].unit) for name in signals}
    edits = [
        edit
        for edit in unit_edits(signals, units, signs=True)
        if edit.kind == "sign" or not any(known[name].stated for name in edit.lines)
    ]
    as_mapped: Factors = {}
    found, _ = search(as_mapped, lambda _: edits, model, UNITS)
    return model, found


def _applied(
    known: dict[str, DraftLine], found: Finding[Factors], contradicted: frozenset[str]
) -> dict[str, DraftLine]:
    """Return the draft with an edit, and why; `contradicted` are variables whose own numbers speak against their lines."""
    out, edit, key = dict(known), found.best, found.edits[0].channel
    others = [enumerated(one.edit.lines) for one in found.edits[1:]]
    if edit.kind == "sign" and key[0] == "turns":
        (name,) = edit.lines
        rival = f"; or is it {' or '.join(others)} that is to be turned?" if others else ""
        why = f"turned, as {key[1] if name == key[2] else key[2]} changes against it{rival}"
        out[name] = replace(out[name], scale=-out[name].scale).doubted(why)
    elif edit.kind == "sign":
        (name,) = edit.lines
        why = "its z points up: turned" if name == "az" else "counts down, as the altitude shows: turned"
        out[name] = replace(out[name], scale=-out[name].scale).remarked(why)
        if name == "az" and "ay" in out:
            out["ay"] = out["ay"].doubted("z points up, so y may point to the left: then scale = -1")
    else:
        shown = [name for name in edit.lines if name in contradicted or name in SPECIFIC_FORCE] or list(
            edit.lines
        )
        for name in edit.lines:
            line = replace(out[name], unit=edit.value)
            if name in shown:
                out[name] = line.remarked(f"{edit.value} by {_REASONS[key[0]]}")
            else:
                out[name] = line.doubted(f"{edit.value} as {enumerated(shown)}")
    return out


_REASONS: Final = {
    "size": "its size", "median": "its size", "weight": "its weight", "z-axis": "its weight",
    "noise": "noise beside the other axes", "growth": "the change of angles", "gravity": "the change of velocity",
}  # fmt: skip


def _agreeing(
    known: dict[str, DraftLine], model: UnitModel, columns: Mapping[str, Signal]
) -> dict[str, DraftLine]:
    """Remark what confirms a line: a rate that is the derivative of its angle, gravity, the altitude."""
    out = dict(known)
    for (angle, rate), factor in model.growth.items():
        lines = out[angle], out[rate]
        small = float(np.max(np.abs(columns[angle][1]), where=np.isfinite(columns[angle][1]), initial=0.0))
        if not factor or (not any(map(_is_sure, lines)) and small < MIN_ANGLE):
            continue  # both may be in degrees
        if 0.5 < abs(factor) < 2.0:
            out[angle], out[rate] = (
                lines[0].remarked(f"{rate} is its derivative"),
                lines[1].remarked(f"the derivative of {angle}"),
            )
        else:
            out[angle] = lines[0].doubted(f"changes {abs(factor):.3g} times as fast as {rate} says")
    force = [name for name in SPECIFIC_FORCE if name in out and name in columns]
    weighs = "az" in force and MEDIANS["az"].low <= model.weight(lambda _: 1.0) <= MEDIANS["az"].high
    for name in force:
        if "az" not in force and not out[name].stated:
            out[name] = out[name].doubted("m/s2 or g: without az gravity cannot tell")
        elif "az" in force:
            reading = model.weight(lambda _: 1.0) / FACTORS[out["az"].unit]
            text = f"gravity reads {reading:.3g}"
            out[name] = (
                replace(out[name], remarks=(text, *(r for r in out[name].remarks if " by " not in r)))
                if weighs
                else (out[name].doubted(f"{text}: no weight; gravity left out?"))
            )
    for vertical, rise in model.rises.items():
        if rise and not out[vertical].remarks:
            out[vertical] = out[vertical].remarked("counts down, as the altitude shows")
    return out


def _is_sure(line: DraftLine) -> bool:
    return line.stated or bool(line.remarks) or bool(line.doubts)


def _doubted(
    known: dict[str, DraftLine], model: UnitModel, columns: Mapping[str, Signal]
) -> dict[str, DraftLine]:
    """Doubt what nothing confirms, and what no unit explains."""
    out = dict(known)
    for name in TURNING:
        if name in out and not _is_sure(out[name]):
            out[name] = out[name].doubted(
                f"{out[name].unit} by its size only: up to {largest_size(columns[name][1]):.3g}"
            )
    for key, evidence in model({}, None).items():
        if isinstance(evidence, Range) and evidence.violated and key[0] in ("size", "median", "growth"):
            name = key[1]
            size = median_size(columns[name][1]) if key[0] == "median" else largest_size(columns[name][1])
            out[name] = out[name].doubted(f"{size:.3g} is no {name} in {out[name].unit}")
    return out


def _command(line: DraftLine, x: FloatArray) -> DraftLine:
    """Tell pulses, percents, normalized commands and deflections apart."""
    name, size, middle = line.variable, largest_size(x), median_size(x)
    stem, _, number = name.partition("_")
    if name.startswith("pwm_"):
        return _pulse(line, middle)
    if PULSES[0] <= middle <= PULSES[1]:
        if number.isdigit():
            return replace(line, variable=f"pwm_{number}", unit="us").remarked("pulses")
        return replace(line, unit="1").doubted("these are pulses: name them pwm_N and add a calibration")
    if stem in SURFACES:
        return _surface(line, size)
    if size > 2500.0:
        return replace(line, unit="1", scale=1.0 / 65535.0).doubted(f"up to {size:.5g}: 16 bits?")
    if size > 1.5 and not line.unit:
        return replace(line, unit="percent").remarked(f"up to {size:.3g}: percent")
    return replace(line, unit=line.unit or VARIABLES[name].unit)


def _pulse(line: DraftLine, middle: float) -> DraftLine:
    if line.unit in PULSE_FACTORS:
        return line
    for unit, many in PULSE_FACTORS.items():
        if PULSES[0] <= middle * many <= PULSES[1]:
            return replace(line, unit=unit)
    if middle <= 1.5:
        servo = replace(line, variable=f"servo_{line.variable.partition('_')[2]}", unit="1")
        return servo.doubted("no pulses, rather normalized: servo or motor?")
    return replace(line, unit="us").doubted(f"{middle:.3g} in the median is no pulse in us")


def _surface(line: DraftLine, size: float) -> DraftLine:
    if line.unit and KINDS[line.unit] == "an angle":
        return line
    if line.unit == "1" or 0.8 < size <= 1.01:
        return replace(line, unit="1").doubted("normalized, no angle: name it servo_N and add a calibration")
    if size > LARGEST.get(line.variable, math.inf):
        return replace(line, unit="deg").remarked(f"up to {size:.3g}: degrees")
    return replace(line, unit="rad").doubted(f"up to {size:.3g}: rad, or a normalized command?")

"""Tables of the natural modes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stoop.base.numbers import NOTHING, number, rounded_to_error, window
from stoop.results.result import ConditionModes, Estimate, Identification, MeasuredMode, ModeEstimate

FAR = 3.0  #: standard errors; of some twenty numbers on a page one is beyond two by chance


@dataclass(frozen=True)
class ModeRow:
    """One mode; texts as shown."""

    name: str
    frequency: str
    frequency_span: str
    damping: str
    damping_span: str
    amplitude: str
    amplitude_span: str
    measured: tuple[str, ...]
    remark: str


@dataclass(frozen=True)
class ModeView:
    """The modes at one flight condition."""

    title: str
    remark: str
    rows: tuple[ModeRow, ...]


def mode_views(identification: Identification) -> list[ModeView]:
    """Return the tables of all flight conditions."""
    return [_view(identification, condition) for condition in identification.result.modes]


def _view(identification: Identification, condition: ConditionModes) -> ModeView:
    maneuvers = identification.result.maneuvers
    flown = ", ".join(
        window(maneuvers[i].start, maneuvers[i].stop) for i in condition.maneuvers if i < len(maneuvers)
    )
    about = "steady straight flight" if condition.about == "trim" else "the mean state"
    place = f"{number(condition.airspeed, 3)} m/s, {number(condition.altitude, 3)} m, flown in {flown}"
    rows = tuple(_row(identification, mode) for mode in condition.modes)
    return ModeView(f"About {about} at {place}", condition.remark, rows)


def _row(identification: Identification, mode: ModeEstimate) -> ModeRow:
    sampled = "intervals sampled" if mode.method == "sampled" else ""
    oscillates = mode.imag.estimate > 0.0
    return ModeRow(
        name=mode.name,
        frequency=_value(mode.frequency) if oscillates else NOTHING,
        frequency_span=_span(mode.frequency) if oscillates else "",
        damping=_value(mode.damping) if oscillates else NOTHING,
        damping_span=_span(mode.damping) if oscillates else "",
        amplitude=_value(mode.time_constant),
        amplitude_span=_span(mode.time_constant),
        measured=tuple(_measured(identification, mode, one) for one in mode.measured if oscillates),
        remark="; ".join(word for word in (mode.remark, sampled) if word),
    )


def _measured(identification: Identification, mode: ModeEstimate, one: MeasuredMode) -> str:
    maneuvers = identification.result.maneuvers
    where = (
        window(maneuvers[one.maneuver].start, maneuvers[one.maneuver].stop)
        if one.maneuver < len(maneuvers)
        else ""
    )
    if math.isnan(one.frequency.estimate):
        return f"{where}: {one.remark}"
    frequency, damping = (
        " ± ".join(rounded_to_error(e.estimate, e.std_error)) for e in (one.frequency, one.damping)
    )
    seen = f"{', '.join(one.channels)} in {window(one.start, one.stop)}"
    return f"{frequency} rad/s, damping {damping} ({seen}): {_agreement(mode, one)}"


def _agreement(mode: ModeEstimate, one: MeasuredMode) -> str:
    """Say whether model and record agree within both error bars."""
    off = [
        abs(a.estimate - b.estimate) / math.hypot(a.std_error, b.std_error)
        for a, b in ((mode.frequency, one.frequency), (mode.damping, one.damping))
        if math.hypot(a.std_error, b.std_error) > 0.0
    ]
    if not off or not all(math.isfinite(x) for x in off):
        return "no interval to compare with"
    return f"{max(off):.1f} standard errors from the model" if max(off) > FAR else "agrees with the model"


def _value(one: Estimate) -> str:
    return rounded_to_error(one.estimate, one.std_error)[0]


def _span(one: Estimate) -> str:
    if not (math.isfinite(one.ci95_lower) and math.isfinite(one.ci95_upper)):
        return NOTHING
    width = 0.25 * (one.ci95_upper - one.ci95_lower)
    return f"{rounded_to_error(one.ci95_lower, width)[0]} … {rounded_to_error(one.ci95_upper, width)[0]}"

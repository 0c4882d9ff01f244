"""A mapping judged as a whole: one likelihood of all residuals, over one set of edits of its lines."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop import Flight, Notice
from stoop.extend import flights
from stoop.extend.arrays import BoolArray, FloatArray
from stoop.extend.errors import FlightError
from stoop.extend.notices import attempt, notice
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop_draft.checks.air import Air
from stoop_draft.checks.controls import Controls
from stoop_draft.checks.engine import Edit, Finding, Range, Residuals, empty_columns, search
from stoop_draft.checks.entries import TABLE, Line, Lines, read_lines, ready_line, where
from stoop_draft.checks.flight_path import FlightPath
from stoop_draft.checks.frames import frame_edits
from stoop_draft.checks.kinematics import Columns, Motion, check_rates, thinned
from stoop_draft.checks.lines import EAST, Assignment, Signal, corrected, mapping_edits, reading, with_east
from stoop_draft.checks.units import LARGEST, Sizes, full_turn, without_jumps

#: statistic -> code of the notice
SUSPECT_CLOCK: Final = 5.0  #: Hz; body rates are hardly ever logged more slowly
_CODES: Final = {
    "size": "angle-size", "median": "unit-size", "weight": "force-size", "z-axis": "force-axis-unit",
    "noise": "force-axis-unit", "growth": "angle-rate-factor", "up": "force-points-up",
}  # fmt: skip
_UNEXPLAINED: Final = {
    "size": "size-unexplained", "median": "size-unexplained", "weight": "size-unexplained",
    "growth": "angle-rate-unexplained",
}  # fmt: skip
#: kind of evidence -> what shows it
SHOWN: Final[Mapping[str, str]] = {
    "size": "its size", "least": "its size", "median": "its size",
    "weight": "its weight", "z-axis": "its weight", "up": "its weight",
    "noise": "noise beside the other axes", "growth": "the change of angles", "turns": "the change of angles",
    "turn": "the change of angles", "gain": "the change of angles over a second", "force": "the change of velocity",
    "place": "the change of position", "moment": "the angular acceleration", "level": "the velocity over ground",
    "air": "the change of velocity", "lift": "the lift", "side": "the side force", "bank": "the direction of lift",
    "path-lift": "the lift", "path-speed": "the speed gained in descents", "wind": "the wind",
    "flow": "the force that grows with it",
}  # fmt: skip


class Model:
    """All residuals of a log under a mapping.

    Parameters
    ----------
    signals : variable -> its samples as recorded, SI as mapped
    data : variable -> (n,) on one grid of `rate` [Hz], SI as mapped, NaN on the ground; none where clocks are not trusted
    controls : whether controls are compared with angular accelerations
    """

    def __init__(
        self, signals: Mapping[str, Signal], data: Columns, rate: float, controls: bool = True
    ) -> None:
        self.signals, turned = signals, dict(signals)
        if "psi" in signals:
            turned[EAST] = signals["psi"][0], with_east({"psi": signals["psi"][1]})[EAST]
        self.sizes = Sizes(turned)
        self.parts: list[Motion | Air | FlightPath | Controls] = []
        self.judged = {*signals, *data}
        if data:
            thin, rate = thinned(data, rate)
            thin = with_east(thin)
            self.motion = Motion(thin, rate)
            path = FlightPath(thin, rate, winged=not {"motor_2", "rotor_2", "pwm_2"} & self.judged)
            self.parts = [self.motion, Air(thin, rate), path, *([Controls(thin, rate)] if controls else [])]

    def __call__(self, state: Assignment, changed: Collection[str] | None) -> Residuals:
        """Return all residuals in which some of the variables that changed take part."""
        out = dict(self.sizes(state, changed))
        for part in self.parts:
            out.update(part(state, changed))
        return out

    def scales(self, state: Assignment) -> dict[tuple[str, ...], float]:
        """Return the factors that other channels show."""
        every = (*self.parts, self.sizes)
        return {names: x for part in every for names, x in part.scales(state).items()}

    def edits(self, state: Assignment, lines: Lines) -> Iterable[Edit[Assignment]]:
        """Return the edits that a search tries next."""
        yield from mapping_edits(self.signals, self.judged, lines, self.scales(state))
        if abs(reading(state, "psi")[1]) == 1.0:  # a quarter of a turn is known of radians
            yield from frame_edits({name: line for name, line in lines.items() if name in self.judged})


@dataclass(frozen=True)
class Judgment:
    """What contradicts a mapping, and which column each variable then takes."""

    refused: tuple[Notice, ...]  #: angles and rates in a wrong unit
    notices: tuple[Notice, ...]  #: all else
    state: Assignment

    def corrected(self, data: Columns) -> dict[str, FloatArray]:
        """Return columns with the wrong lines corrected."""
        return corrected(self.state, data)


def check_mapping(signals: Mapping[str, Signal], data: Columns, rate: float, lines: Lines) -> Judgment:
    """Return what contradicts a mapping; see `Model`.

    Signs and axes of body rates, sizes and the sign of gravity are examined in any log; all else only where the user wrote
    the line.
    """
    # the filters cost half a second: not where no line of a control could be wrong
    own = {name: line for name, line in lines.items() if not line.ready}
    controls = any(VARIABLES[name].kind == "command" for name in own)
    model = Model(signals, data, rate, controls)
    start: Assignment = {}
    found, state = search(start, lambda now: model.edits(now, own), model)
    notices, now = [], start
    for one in found:
        notices.append(_notice(one, model, lines, now))
        now = one.best.apply(now)
    explained = {name for one in found for names in one.lines for name in names}
    for key, evidence in model.sizes(state, None).items():
        wrong = isinstance(evidence, Range) and evidence.violated and not explained & set(key[1:])
        if wrong and key[0] in _UNEXPLAINED:
            place = where(key[1:], lines)
            notices.append(notice(_UNEXPLAINED[key[0]], key[1], **model.sizes.values(key), line=place))
    notices.sort(key=lambda one: list(VARIABLES).index(one.subject))
    refused = [n for n in notices if n.subject in LARGEST and n.code not in _OF_LINES]
    return Judgment(tuple(refused), tuple(n for n in notices if n not in refused), state)


_OF_LINES: Final = ("mapping-sign", "mapping-exchange", "mapping-scale", "mapping-frame", "mapping-ambiguous")


def _notice(one: Finding[Assignment], model: Model, lines: Lines, state: Assignment) -> Notice:
    """Return what is said of a wrong line, of columns as a state reads them."""
    key, kind = one.edits[0].channel, one.best.kind
    of_size = kind in ("unit", "pulses") or (key[0] == "up" and kind != "frame")
    code = f"mapping-{kind}" if len(one.edits) == 1 else "mapping-ambiguous"
    shown: dict[str, float | str] = {}
    subject = one.best.lines[0]
    if of_size and key[0] in _CODES:
        code, shown = _CODES[key[0]], model.sizes.values(key)
        subject = key[1] if key[1] in one.best.lines else subject
    if kind == "pulses":
        code = "command-in-pulses"
    if kind == "frame":
        shown["axes"] = one.best.value
    if code.startswith("mapping-"):
        before, after = (model(x, one.best.lines)[key] for x in (state, one.best.apply(state)))
        shown["shown"] = f"{SHOWN[key[0]]} ({key[-1]}): {before} as written, {after} once corrected"
    return notice(code, subject, **shown, **one.values(lines))


def on_grid(signals: Mapping[str, Signal], rate: float) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return times (n,) and columns of signals by linear interpolation, NaN where a signal has no data."""
    start, stop = min(t[0] for t, _ in signals.values()), max(t[-1] for t, _ in signals.values())
    time = np.arange(start, stop, 1.0 / rate)
    out = {}
    for name, (t, x) in signals.items():
        known = np.isfinite(x)
        out[name] = (
            np.interp(time, t[known], without_jumps(name, x)[known], np.nan, np.nan)
            if known.sum() > 1
            else np.full(time.size, np.nan)
        )
    return time, out


class ContradictedError(FlightError):
    """Angles or rates are in degrees where radians belong; `notices` hold all that contradicts the mapping."""

    def __init__(self, text: str, notices: Sequence[Notice] = ()) -> None:
        super().__init__(text)
        self.notices = tuple(notices)


def judge_mapping(
    flight: Flight,
    up: BoolArray,
    channels: Sequence[flights.Channels],
    faults: Sequence[flights.Fault],
    failed: list[Notice],
    mapped: flights.Mapped | None,
) -> list[Notice]:
    """Return what contradicts the units, signs and axes of a flight's columns, from samples in the air (`up`).

    Columns without a number are left out; clipped and stuck samples are not judged. Columns of a table in memory have no mapping.
    Raises `ContradictedError` for angles in degrees.
    """
    lines = {name: Line(TABLE, f"'{name}'") for name in flight.sources}
    if mapped is not None:
        lines = {name: ready_line(*source, name) for name, source in mapped.ready.items()}
        lines |= read_lines(mapped.places)
    time, rate = flight.time, flight.rate
    data = {name: flight.column(name) for name in flight.channels}
    # copies count: a sparse log may be gigabytes on its grid
    in_air = data if up.all() else {name: np.where(up, x, np.nan) for name, x in data.items()}
    signals = {
        name: (group.time, np.where(np.interp(group.time, time, up) > 0.5, x, np.nan))
        for group in channels
        for name, x in group.values.items()
    }
    empty = empty_columns(in_air) | empty_columns({name: x for name, (_, x) in signals.items()})
    in_air = {name: x for name, x in in_air.items() if name not in empty}
    signals = {name: one for name, one in signals.items() if name not in empty}
    angles = signals.keys() & set(FAMILIES["euler"])
    # the grid took other units than radians for turns, and those of one angle of an attitude turned all of them
    strange = any(full_turn(name, signals[name][1]) != 2.0 * np.pi for name in angles)
    for name in angles if strange else ():
        t, x = signals[name]
        in_air[name] = x[np.rint(np.interp(time, t, np.arange(t.size))).astype(int)]
    judged: dict[str, FloatArray] = {}
    # slower body rates are those of a wrong clock
    if not any(
        0.0 < flight.sources[name].rate < SUSPECT_CLOCK
        for name in FAMILIES["rates"]
        if name in flight.sources
    ):
        judged = {
            name: flights.Fault.removed(time, x, [fault for fault in faults if fault.variable == name])
            for name, x in in_air.items()
        }
    found = attempt(failed, Judgment((), (), {}), check_mapping, signals, judged, rate, lines)
    of_rates = attempt(failed, [], check_rates, found.corrected(in_air), rate, lines)
    named: set[object] = {one.subject for one in found.notices}
    named.update(*(own for one in found.notices if isinstance(own := one.values.get("lines"), tuple)))
    of_rates = [one for one in of_rates if one.subject not in named]
    if found.refused:
        said, every = str(found.refused[0]).removesuffix("."), (*found.refused, *found.notices, *of_rates)
        raise ContradictedError(f"{flight.path or flight.name}: {said}", every)
    if any(one.code.startswith(("mapping-", "rate-", "attitude-")) for one in (*found.notices, *of_rates)):
        # a late attitude explains one unlike its rates
        of_rates = attempt(failed, [], flights.attitude_delay, channels) or of_rates
    return [*found.notices, *of_rates]

"""A mapping judged as a whole: one likelihood of all residuals, over one set of edits of its lines."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import VARIABLES
from stoop.checks.air import Air
from stoop.checks.controls import Controls
from stoop.checks.engine import Edit, Finding, Range, Residuals, search
from stoop.checks.entries import Lines, where
from stoop.checks.flight_path import FlightPath
from stoop.checks.frames import frame_edits
from stoop.checks.kinematics import Columns, Motion, thinned
from stoop.checks.lines import EAST, Assignment, Signal, corrected, mapping_edits, reading, with_east
from stoop.checks.units import LARGEST, Sizes, without_jumps

#: statistic -> code of the notice
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

"""Servo outputs -> deflections: a calibration table per output, and mixers that say which surface each moves.

.. code-block:: toml

    [calibration.pwm_3]                     # pulse or normalized command -> deflection
    points = [[1100, -0.40], [1500, 0.0], [1900, 0.38]]
    unit = "rad"                            # of the second number of each point
    degree = 2                              # fitted polynomial; left out: straight lines between the points

    [surface.aileron]                       # a weighted sum of calibrated outputs
    from = {pwm_1 = 0.5, pwm_2 = -0.5}

    [mixer.tail]                            # or a mixer by its name
    kind = "v-tail"
    left = "pwm_3"
    right = "pwm_4"

Each calibrated deflection counts positive with the trailing edge down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.variables import VARIABLES
from stoop.errors import LogError
from stoop.flight.channels import WILD, Channels
from stoop.logs.mapping import factor_of, number_of, only_keys, text_of

LARGEST: Final = 0.5 * np.pi  #: rad; no surface turns further
FINEST: Final = 1e-6  #: apart must inputs of a table be
CHECKED: Final = 200  #: places between the ends of a fitted calibration where its slope is looked at
MOVED: Final = ("elevator", "aileron", "rudder", "flap", "throttle")  #: what a calibration can lead to
MIXERS: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "v-tail": {"elevator": (0.5, 0.5), "rudder": (0.5, -0.5)},
    "inverted v-tail": {"elevator": (0.5, 0.5), "rudder": (-0.5, 0.5)},
    "elevon": {"elevator": (0.5, 0.5), "aileron": (0.5, -0.5)},
    "flaperon": {"flap": (0.5, 0.5), "aileron": (0.5, -0.5)},
}  #: name -> surface -> weights of the left and the right panel


@dataclass(frozen=True)
class Calibration:
    """What one output does.

    Attributes
    ----------
    inputs, outputs : (n,) the table, inputs rising; rad, or 1 for a throttle
    curve : coefficients of a fitted polynomial of (input - middle) / half, lowest power first; empty for lines
    """

    inputs: tuple[float, ...]
    outputs: tuple[float, ...]
    curve: tuple[float, ...] = ()

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return deflections; beyond the table they go on along the line at its end."""
        low, high = self.inputs[0], self.inputs[-1]
        inside = np.clip(values, low, high)
        beyond = values - inside
        slopes = self._slopes()
        return self._inside(inside) + np.where(beyond < 0.0, slopes[0], slopes[1]) * beyond

    def _inside(self, x: FloatArray) -> FloatArray:
        if not self.curve:
            return np.interp(x, self.inputs, self.outputs)
        low, high = self.inputs[0], self.inputs[-1]
        scaled = (2.0 * x - low - high) / (high - low)
        return np.asarray(np.polynomial.polynomial.polyval(scaled, self.curve), dtype=np.float64)

    def _slopes(self) -> tuple[float, float]:
        x = np.array(self.inputs)
        step = 1e-4 * (x[-1] - x[0])
        ends = np.array([x[0], x[0] + step, x[-1] - step, x[-1]])
        first, second, third, last = self._inside(ends)
        return float((second - first) / step), float((last - third) / step)

    def beyond(self, values: FloatArray) -> float:
        """Return the share of the samples that lie beyond the table, 0 to 1."""
        known = values[np.isfinite(values)]
        outside = (known < self.inputs[0]) | (known > self.inputs[-1])
        return float(outside.mean()) if known.size else 0.0


@dataclass(frozen=True)
class Surfaces:
    """Calibrations and what they are mixed to.

    Attributes
    ----------
    place : of the mapping, for messages
    calibrations : output -> what it does
    mixes : surface -> output -> weight
    """

    place: str = ""
    calibrations: Mapping[str, Calibration] = field(default_factory=dict)
    mixes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def read_surfaces(place: str, content: Mapping[str, Any]) -> Surfaces:
    """Read the tables calibration, surface and mixer of a mapping.

    Raises
    ------
    LogError
        When a table does not rise or fall all the way, is too short or in degrees, or a mix names no calibration.
    """
    tables = {key: content.get(key, {}) for key in ("calibration", "surface", "mixer")}
    for key, table in tables.items():
        if not isinstance(table, dict) or not all(isinstance(entry, dict) for entry in table.values()):
            raise LogError(f"{place}: {key} holds no tables; write [{key}.NAME]")
    known = {name: _calibration(place, name, entry) for name, entry in tables["calibration"].items()}
    mixes: dict[str, Mapping[str, float]] = {}
    for name, entry in tables["surface"].items():
        _add(place, mixes, name, f"surface.{name}", _mix(place, name, entry))
    for name, entry in tables["mixer"].items():
        for surface, mix in _mixer(place, name, entry).items():
            _add(place, mixes, surface, f"mixer.{name}", mix)
    _check_calibrated(place, known, mixes)
    return Surfaces(place, known, mixes)


def _add(
    place: str, mixes: dict[str, Mapping[str, float]], surface: str, where: str, mix: Mapping[str, float]
) -> None:
    if surface in mixes:
        raise LogError(
            f"{place}: {where} moves {surface}, which another table moves already; keep one of them"
        )
    if surface not in MOVED:
        raise LogError(f"{place}: {where} leads to '{surface}'; a mix leads to one of {', '.join(MOVED)}")
    mixes[surface] = mix


def _check_calibrated(
    place: str, known: Mapping[str, Calibration], mixes: Mapping[str, Mapping[str, float]]
) -> None:
    for surface, mix in mixes.items():
        for name in mix:
            if name not in known:
                span = "[[1100, -0.4], [1900, 0.4]]" if name.startswith("pwm") else "[[-1, -0.4], [1, 0.4]]"
                raise LogError(
                    f"{place}: {surface} is mixed from {name}, which has no calibration; "
                    f"add [calibration.{name}] with points = {span}"
                )


def _calibration(place: str, name: str, entry: Mapping[str, Any]) -> Calibration:
    where = f"calibration.{name}"
    only_keys(place, where, entry, frozenset({"points", "unit", "degree"}))
    if name not in VARIABLES:
        raise LogError(f"{place}: {where}: '{name}' is no variable of stoop; name an output, such as pwm_1")
    points = _points(place, where, entry.get("points"))
    unit = text_of(place, where, entry, "unit") if "unit" in entry else "rad"
    outputs = factor_of(place, where, "elevator", unit) * points[:, 1]
    if np.abs(outputs).max() > LARGEST:
        raise LogError(
            f'{place}: {where}.points reach {np.abs(outputs).max():.3g} rad: are they degrees? write unit = "deg"'
        )
    curve = _curve(place, where, entry, points[:, 0], outputs)
    return Calibration(tuple(points[:, 0].tolist()), tuple(outputs.tolist()), curve)


def _points(place: str, where: str, given: object) -> FloatArray:
    """Return (n, 2), the inputs rising and the outputs rising or falling all the way."""
    rows = given if isinstance(given, list) else []
    pairs = [row for row in rows if isinstance(row, list) and len(row) == 2]
    if len(pairs) < 2 or len(pairs) != len(rows):
        raise LogError(
            f"{place}: {where}.points needs two pairs [input, deflection] and more; "
            "write points = [[1100, -0.4], [1900, 0.4]]"
        )
    numbers = [[number_of(place, where, {"points": x}, "points", 0.0) for x in row] for row in pairs]
    table = np.array(sorted(numbers))
    steps = np.diff(table, axis=0)
    if not (steps[:, 0] > FINEST).all():
        twice = next(a[0] for a, b in pairwise(table.tolist()) if b[0] - a[0] <= FINEST)
        raise LogError(f"{place}: {where}.points holds the input {twice:g} twice; keep one of them")
    if not ((steps[:, 1] > 0.0).all() or (steps[:, 1] < 0.0).all()):
        raise LogError(
            f"{place}: {where}.points turn back: the deflection must rise, or fall, all the way; measure again"
        )
    return table


def _curve(
    place: str, where: str, entry: Mapping[str, Any], x: FloatArray, y: FloatArray
) -> tuple[float, ...]:
    if "degree" not in entry:
        return ()
    degree = entry["degree"]
    if type(degree) is not int or not 1 <= degree < x.size:  # true is an int too
        raise LogError(
            f"{place}: {where}.degree is to be a whole number from 1 to {x.size - 1} for {x.size} points"
        )
    fitted = np.polynomial.Polynomial.fit(x, y, degree)
    slope = fitted.deriv()(np.linspace(x[0], x[-1], CHECKED))
    if not ((slope > 0.0).all() or (slope < 0.0).all()):
        raise LogError(f"{place}: {where}: the fitted curve turns back between the points; lower its degree")
    return tuple(float(c) for c in fitted.coef)


def _mix(place: str, name: str, entry: Mapping[str, Any]) -> Mapping[str, float]:
    where = f"surface.{name}"
    only_keys(place, where, entry, frozenset({"from"}))
    given = entry.get("from")
    if not isinstance(given, dict) or not given:
        raise LogError(f"{place}: {where}.from is no table of weights; write from = {{pwm_1 = 1.0}}")
    return {channel: number_of(place, f"{where}.from", given, channel, 1.0) for channel in given}


def _mixer(place: str, name: str, entry: Mapping[str, Any]) -> dict[str, Mapping[str, float]]:
    where = f"mixer.{name}"
    only_keys(place, where, entry, frozenset({"kind", "left", "right"}))
    kind, left, right = (text_of(place, where, entry, key) for key in ("kind", "left", "right"))
    if kind not in MIXERS:
        raise LogError(f"{place}: {where}.kind = '{kind}' is unknown; write one of {', '.join(MIXERS)}")
    if left == right:
        raise LogError(f"{place}: {where}: left and right are the same output; name two")
    return {surface: {left: a, right: b} for surface, (a, b) in MIXERS[kind].items()}


def deflections(surfaces: Surfaces, channels: Sequence[Channels]) -> tuple[list[Channels], list[str]]:
    """Make surface deflections of recorded outputs, which are kept as well.

    Parameters
    ----------
    surfaces : calibrations and mixes
    channels : as recorded

    Returns
    -------
    channels : one for each mix, on the clock of its first output
    notes : which outputs were not recorded, and which left their table

    Raises
    ------
    LogError
        When an output was not recorded.
    """
    there = {name: group for group in channels for name in group.values}
    made = []
    for surface, mix in surfaces.mixes.items():
        missing = [name for name in mix if name not in there]
        if missing:
            raise LogError(
                f"{surfaces.place}: {surface} is mixed from {missing[0]}, which this log does not hold; "
                f"it holds {', '.join(_outputs(there)) or 'no output'}"
            )
        made.append(_deflection(surfaces, surface, mix, there))
    return made, _leaving(surfaces, there)


def _outputs(names: Mapping[str, Channels]) -> list[str]:
    return [name for name in names if VARIABLES[name].kind == "command"]


def _deflection(
    surfaces: Surfaces, surface: str, mix: Mapping[str, float], there: Mapping[str, Channels]
) -> Channels:
    first = there[next(iter(mix))]
    total = np.zeros(first.time.size)
    for name, weight in mix.items():
        group = there[name]
        total += weight * _on(first.time, group.time, surfaces.calibrations[name](_driven(name, group)))
    return Channels(f"{first.source} (calibrated)", first.time, {surface: total})


def _driven(name: str, group: Channels) -> FloatArray:
    """Return an output with NaN where it was not driven: a pulse of no length is none."""
    x = np.where(np.abs(group.values[name]) < WILD, group.values[name], np.nan)
    return np.where(x > 0.0, x, np.nan) if name.startswith("pwm_") else x


def _on(at: FloatArray, time: FloatArray, x: FloatArray) -> FloatArray:
    return x if at is time else np.interp(at, time, x, left=np.nan, right=np.nan)


def _leaving(surfaces: Surfaces, there: Mapping[str, Channels]) -> list[str]:
    notes = []
    for name in dict.fromkeys(name for mix in surfaces.mixes.values() for name in mix):
        known = surfaces.calibrations[name]
        share = known.beyond(_driven(name, there[name]))
        if share > 0.0:
            notes.append(
                f"{name} leaves its calibration ({known.inputs[0]:g} to {known.inputs[-1]:g}) in "
                f"{100.0 * share:.2g} % of its samples: there the line at its end goes on"
            )
    return notes

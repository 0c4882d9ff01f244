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
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.text import nearest
from stoop.base.units import FACTORS
from stoop.base.variables import VARIABLES
from stoop.errors import LogError
from stoop.flight.channels import MAX_VALUE, Channels
from stoop.flight.mapping_schema import CalibrationTable, MixerKind, MixerTable, SurfaceTable

MAX_DEFLECTION: Final = 0.5 * np.pi  #: rad; no surface turns further
MIN_SPACING: Final = 1e-6  #: between inputs of a table
SLOPE_SAMPLES: Final = 200  #: places between the ends of a fitted calibration where its slope is looked at
SURFACES: Final = ("elevator", "aileron", "rudder", "flap", "throttle")  #: what a calibration can lead to
MIXERS: Final[dict[MixerKind, dict[str, tuple[float, float]]]] = {
    "v-tail": {"elevator": (0.5, 0.5), "rudder": (0.5, -0.5)},
    "inverted v-tail": {"elevator": (0.5, 0.5), "rudder": (-0.5, 0.5)},
    "elevon": {"elevator": (0.5, 0.5), "aileron": (0.5, -0.5)},
    "flaperon": {"flap": (0.5, 0.5), "aileron": (0.5, -0.5)},
}  #: name -> surface -> weights of the left and the right panel


@dataclass(frozen=True)
class Calibration:
    """Deflection over one output.

    Attributes
    ----------
    inputs, outputs : (n,) the table, inputs rising; rad, or 1 for a throttle
    curve : coefficients of a fitted polynomial of (input - middle) / half, lowest power first; empty for lines
    """

    inputs: tuple[float, ...]
    outputs: tuple[float, ...]
    curve: tuple[float, ...] = ()

    @classmethod
    def of(cls, at: str, table: CalibrationTable) -> Calibration:
        """Return the calibration of a table of the mapping; inputs rise, deflections rise or fall all the way."""
        if table.unit not in FACTORS:
            raise LogError(f"{at}.unit = '{table.unit}' is unknown; {nearest(table.unit, FACTORS, 0.3)}")
        points = np.array(sorted(table.points))
        x, y = points[:, 0], FACTORS[table.unit] * points[:, 1]
        steps = np.diff(points, axis=0)
        if not (steps[:, 0] > MIN_SPACING).all():
            twice = next(a[0] for a, b in pairwise(points.tolist()) if b[0] - a[0] <= MIN_SPACING)
            raise LogError(f"{at}.points holds the input {twice:g} twice; keep one of them")
        if not _monotonic(steps[:, 1]):
            raise LogError(
                f"{at}.points turn back: the deflection must rise, or fall, all the way; measure again"
            )
        if np.abs(y).max() > MAX_DEFLECTION:
            raise LogError(
                f'{at}.points reach {np.abs(y).max():.3g} rad: are they degrees? write unit = "deg"'
            )
        curve: tuple[float, ...] = ()
        if table.degree is not None:
            if table.degree >= x.size:
                raise LogError(
                    f"{at}.degree is to be a whole number from 1 to {x.size - 1} for {x.size} points"
                )
            fitted = np.polynomial.Polynomial.fit(x, y, table.degree)
            if not _monotonic(fitted.deriv()(np.linspace(x[0], x[-1], SLOPE_SAMPLES))):
                raise LogError(f"{at}: the fitted curve turns back between the points; lower its degree")
            curve = tuple(float(c) for c in fitted.coef)
        return cls(tuple(x.tolist()), tuple(y.tolist()), curve)

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return deflections; beyond the table they go on along the line at its end."""
        low, high = self.inputs[0], self.inputs[-1]
        inside = np.clip(values, low, high)
        beyond = values - inside
        step = 1e-4 * (high - low)
        ends = self._inside(np.array([low, low + step, high - step, high]))
        first, last = float((ends[1] - ends[0]) / step), float((ends[3] - ends[2]) / step)
        return self._inside(inside) + np.where(beyond < 0.0, first, last) * beyond

    def _inside(self, x: FloatArray) -> FloatArray:
        if not self.curve:
            return np.interp(x, self.inputs, self.outputs)
        low, high = self.inputs[0], self.inputs[-1]
        scaled = (2.0 * x - low - high) / (high - low)
        return np.asarray(np.polynomial.polynomial.polyval(scaled, self.curve), dtype=np.float64)

    def beyond(self, values: FloatArray) -> float:
        """Return the share of the samples that lie beyond the table, 0 to 1."""
        known = values[np.isfinite(values)]
        outside = (known < self.inputs[0]) | (known > self.inputs[-1])
        return float(outside.mean()) if known.size else 0.0


def _monotonic(slopes: FloatArray) -> bool:
    return bool((slopes > 0.0).all() or (slopes < 0.0).all())


@dataclass(frozen=True)
class Surfaces:
    """Calibrations and what they are mixed to.

    Attributes
    ----------
    place : of the mapping, for messages
    calibrations : output -> its calibration
    mixes : surface -> output -> weight
    """

    place: str = ""
    calibrations: Mapping[str, Calibration] = field(default_factory=dict)
    mixes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        place: str,
        calibrations: Mapping[str, CalibrationTable],
        surfaces: Mapping[str, SurfaceTable],
        mixers: Mapping[str, MixerTable],
    ) -> Surfaces:
        """Return what the tables calibration, surface and mixer of a mapping say.

        Raises
        ------
        LogError
            When a table does not rise or fall all the way or is in degrees, or a mix names no calibration.
        """
        known = {}
        for name, table in calibrations.items():
            at = f"{place}: calibration.{name}"
            if name not in VARIABLES:
                raise LogError(f"{at}: '{name}' is no variable of stoop; name an output, such as pwm_1")
            known[name] = Calibration.of(at, table)
        rows = [(f"surface.{name}", name, surface.weights) for name, surface in surfaces.items()]
        for name, mixer in mixers.items():
            left, right = mixer.left, mixer.right
            if left == right:
                raise LogError(f"{place}: mixer.{name}: left and right are the same output; name two")
            rows += [
                (f"mixer.{name}", moved, {left: a, right: b}) for moved, (a, b) in MIXERS[mixer.kind].items()
            ]
        mixes: dict[str, Mapping[str, float]] = {}
        for where, surface, weights in rows:
            if surface in mixes:
                raise LogError(
                    f"{place}: {where} moves {surface}, which another table moves already; keep one of them"
                )
            if surface not in SURFACES:
                raise LogError(
                    f"{place}: {where} leads to '{surface}'; a mix leads to one of {', '.join(SURFACES)}"
                )
            for name in weights.keys() - known.keys():
                span = "[[1100, -0.4], [1900, 0.4]]" if name.startswith("pwm") else "[[-1, -0.4], [1, 0.4]]"
                raise LogError(
                    f"{place}: {surface} is mixed from {name}, which has no calibration; "
                    f"add [calibration.{name}] with points = {span}"
                )
            mixes[surface] = weights
        return cls(place, known, mixes)

    def deflections(self, channels: Sequence[Channels]) -> tuple[list[Channels], list[Notice]]:
        """Make surface deflections of recorded outputs, which are kept as well.

        Parameters
        ----------
        channels : as recorded

        Returns
        -------
        channels : one for each mix, on the clock of its first output
        notices : which outputs left their table

        Raises
        ------
        LogError
            When an output was not recorded.
        """
        there = {name: group for group in channels for name in group.values}
        made, found = [], {}
        for surface, mix in self.mixes.items():
            missing = [name for name in mix if name not in there]
            if missing:
                outputs = [name for name in there if VARIABLES[name].kind == "command"]
                raise LogError(
                    f"{self.place}: {surface} is mixed from {missing[0]}, which this log does not hold; "
                    f"it holds {', '.join(outputs) or 'no output'}"
                )
            first = there[next(iter(mix))]
            total = np.zeros(first.time.size)
            for name, weight in mix.items():
                group, known = there[name], self.calibrations[name]
                values = _driven(name, group)
                x = known(values)
                if group.time is not first.time:
                    x = np.interp(first.time, group.time, x, left=np.nan, right=np.nan)
                total += weight * x
                share = known.beyond(values)
                if share > 0.0:
                    low, high = known.inputs[0], known.inputs[-1]
                    found[name] = notice("output-beyond-calibration", name, low=low, high=high, share=share)
            made.append(Channels(f"{first.source} (calibrated)", first.time, {surface: total}))
        return made, [*found.values()]


def _driven(name: str, group: Channels) -> FloatArray:
    """Return an output with NaN where it was not driven: a pulse of no length is none."""
    x = np.where(np.abs(group.values[name]) < MAX_VALUE, group.values[name], np.nan)
    return np.where(x > 0.0, x, np.nan) if name.startswith("pwm_") else x

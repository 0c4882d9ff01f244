"""Recorded numbers in our conventions: axes of other systems turned into ours, servo outputs calibrated to deflections.

Axes: body forward-right-down, ground north-east-down. "flu" is a body with forward, left, up (ROS, Crazyflie); "enu" a
ground with east, north, up; "nwu" one with north, west, up, or with x where the vehicle pointed when it was switched on.

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

References
----------
REP 103 of ROS, Standard units of measure and coordinate conventions, section "Axis orientation".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated, Final, Literal, TypeAlias

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.rotations import euler_angles, product, quaternions_of
from stoop.base.text import nearest
from stoop.base.units import FACTORS
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VARIABLES, VELOCITY
from stoop.errors import LogError
from stoop.flight.gridding import MAX_VALUE, Channels

Frame: TypeAlias = tuple[str, ...]
_BODY: Final = ("frd", "flu")
_BODY_VECTORS: Final = (
    RATES,
    ("p_dot", "q_dot", "r_dot"),
    SPECIFIC_FORCE,
    ("control_roll", "control_pitch", "control_yaw"),
)
_GROUND_VECTORS: Final = (
    VELOCITY,
    ("vn_smooth", "ve_smooth", "vd_smooth"),
    POSITION,
    ("an", "ae", "ad"),
    ("wind_n", "wind_e"),
)
_HALF: Final = float(np.sqrt(0.5))
_GROUND_TURNS: Final = {
    "ned": (1.0, 0.0, 0.0, 0.0),
    "nwu": (0.0, 1.0, 0.0, 0.0),
    "enu": (0.0, _HALF, _HALF, 0.0),
}  #: quaternion that takes coordinates of that ground into ned: half a turn about north, or about north-east

Text: TypeAlias = Annotated[str, Field(min_length=1)]
Number: TypeAlias = Annotated[float, Field(gt=-1e300, lt=1e300)]
MixerKind: TypeAlias = Literal["v-tail", "inverted v-tail", "elevon", "flaperon"]
MAX_DEFLECTION: Final = 0.5 * np.pi  #: rad; no surface turns further
MIN_SPACING: Final = 1e-6  #: between inputs of a table
SURFACES: Final = ("elevator", "aileron", "rudder", "flap", "throttle")  #: what a calibration can lead to
MIXERS: Final[dict[MixerKind, dict[str, tuple[float, float]]]] = {
    "v-tail": {"elevator": (0.5, 0.5), "rudder": (0.5, -0.5)},
    "inverted v-tail": {"elevator": (0.5, 0.5), "rudder": (-0.5, 0.5)},
    "elevon": {"elevator": (0.5, 0.5), "aileron": (0.5, -0.5)},
    "flaperon": {"flap": (0.5, 0.5), "aileron": (0.5, -0.5)},
}  #: name -> surface -> weights of the left and the right panel


def check_frame(at: str, variables: tuple[str, ...], given: str | Sequence[str]) -> Frame:
    """Return the frame of these variables: one name, or two for an attitude, those of body and ground.

    Raises LogError, which begins with `at` (file and key), when the variables cannot be turned one by one.
    """
    frame = (given,) if isinstance(given, str) else tuple(given)
    attitude = set(variables) in (set(EULER), set(QUATERNION))
    for name in variables if frame else ():
        vector = next((vector for vector in _GROUND_VECTORS if name in vector), ())
        if attitude:
            possible = len(frame) == 2 and frame[0] in _BODY and frame[1] in _GROUND_TURNS
        elif len(frame) == 1 and any(name in body for body in _BODY_VECTORS):
            possible = frame[0] in _BODY
        else:  # east and north change places, so that both are needed
            whole = frame[0] != "enu" or name not in vector[:2] or set(vector[:2]) <= set(variables)
            possible = len(frame) == 1 and bool(vector) and frame[0] in _GROUND_TURNS and whole
        if possible:
            continue
        names = next((", ".join(attitude) for attitude in (EULER, QUATERNION) if name in attitude), "")
        advice = "; leave it out there"
        if vector:
            advice = f" alone; name {', '.join(vector)} together in one group, with columns x, y, z"
        elif names:
            advice = f' alone; name {names} together in one group, with frame = ["flu", "enu"] or the like'
        raise LogError(f"{at}.frame = {', '.join(frame)} says nothing about {name}{advice}")
    return frame


def rotate_axes(values: Mapping[str, FloatArray], frame: Frame) -> dict[str, FloatArray]:
    """Bring vectors and attitudes (n,), SI, into our axes; all of these rotations are their own inverse.

    Those of a vector stand in the order x, y, z of its own frame, which `check_frame` has checked.
    """
    out = dict(values)
    if not frame:
        return out
    for names in (QUATERNION, EULER):
        if set(values) == set(names):
            columns = np.column_stack([values[name] for name in names])
            q = columns if names == QUATERNION else quaternions_of(columns)
            q = product(np.array(_GROUND_TURNS[frame[1]]), q)
            if frame[0] == "flu":  # half a turn about the forward axis: its own inverse but for the sign
                q = product(q, np.array([0.0, 1.0, 0.0, 0.0]))
            return dict(zip(names, (q if names == QUATERNION else euler_angles(q)).T, strict=True))
    for vector in _BODY_VECTORS if frame[0] in _BODY else _GROUND_VECTORS:
        there = {name: values[name] for name in vector if name in values}
        if frame[0] in ("flu", "nwu"):  # left and up become right and down
            out |= {name: x if name == vector[0] else -x for name, x in there.items()}
        elif frame[0] == "enu":
            north, east, *_ = vector
            out |= {name: -x for name, x in there.items() if name not in (north, east)}
            out |= {north: there[east], east: there[north]} if north in there else {}
    return out


class Table(BaseModel):
    """A table of a mapping file."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class CalibrationTable(Table):
    """[calibration.OUTPUT]: pairs of output and deflection; a polynomial of some degree, or lines between them."""

    points: Annotated[list[Annotated[list[Number], Field(min_length=2, max_length=2)]], Field(min_length=2)]
    unit: str = "rad"
    degree: Annotated[int, Field(ge=1)] | None = None


class SurfaceTable(Table):
    """[surface.NAME]: a weighted sum of calibrated outputs."""

    weights: Annotated[dict[str, Number], Field(alias="from", min_length=1)]


class MixerTable(Table):
    """[mixer.NAME]: two calibrated outputs that move two surfaces."""

    kind: MixerKind
    left: Text
    right: Text


@dataclass(frozen=True)
class Calibration:
    """Deflection over one output."""

    inputs: tuple[float, ...]  #: (n,) the table, inputs rising; rad, or 1 for a throttle
    outputs: tuple[float, ...]
    #: coefficients of a fitted polynomial of (input - middle) / half, lowest power first; empty for lines
    curve: tuple[float, ...] = ()

    @classmethod
    def of(cls, at: str, table: CalibrationTable) -> Calibration:
        """Return the calibration of a table of the mapping; inputs rise, deflections rise or fall all the way."""

        def monotonic(slopes: FloatArray) -> bool:
            return bool((slopes > 0.0).all() or (slopes < 0.0).all())

        if table.unit not in FACTORS:
            raise LogError(f"{at}.unit = '{table.unit}' is unknown; {nearest(table.unit, FACTORS, 0.3)}")
        points = np.array(sorted(table.points))
        x, y = points[:, 0], FACTORS[table.unit] * points[:, 1]
        steps = np.diff(points, axis=0)
        if not (steps[:, 0] > MIN_SPACING).all():
            twice = next(a[0] for a, b in pairwise(points.tolist()) if b[0] - a[0] <= MIN_SPACING)
            raise LogError(f"{at}.points holds the input {twice:g} twice; keep one of them")
        if not monotonic(steps[:, 1]):
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
            fitted, (_, rank, *_) = np.polynomial.Polynomial.fit(x, y, table.degree, full=True)
            if rank <= table.degree:
                raise LogError(f"{at}.points lie too close for a curve of degree {table.degree}; lower it")
            if not monotonic(fitted.deriv()(np.linspace(x[0], x[-1], 200))):
                raise LogError(f"{at}: the fitted curve turns back between the points; lower its degree")
            curve = tuple(float(c) for c in fitted.coef)
        return cls(tuple(x.tolist()), tuple(y.tolist()), curve)

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return deflections; beyond the table they go on along the line at its end."""
        low, high = self.inputs[0], self.inputs[-1]

        def inner(x: FloatArray) -> FloatArray:
            if not self.curve:
                return np.interp(x, self.inputs, self.outputs)
            scaled = (2.0 * x - low - high) / (high - low)
            return np.asarray(np.polynomial.polynomial.polyval(scaled, self.curve), dtype=np.float64)

        inside = np.clip(values, low, high)
        beyond = values - inside
        step = 1e-4 * (high - low)
        ends = inner(np.array([low, low + step, high - step, high]))
        first, last = float((ends[1] - ends[0]) / step), float((ends[3] - ends[2]) / step)
        return inner(inside) + np.where(beyond < 0.0, first, last) * beyond


@dataclass(frozen=True)
class Surfaces:
    """Calibrations and what they are mixed to."""

    place: str = ""  #: of the mapping, for messages
    calibrations: Mapping[str, Calibration] = field(default_factory=dict)  #: output -> its calibration
    mixes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  #: surface -> output -> weight

    @classmethod
    def of(
        cls,
        place: str,
        calibrations: Mapping[str, CalibrationTable],
        surfaces: Mapping[str, SurfaceTable],
        mixers: Mapping[str, MixerTable],
    ) -> Surfaces:
        """Return what the tables calibration, surface and mixer of a mapping say.

        Raises LogError when a table does not rise or fall all the way or is in degrees, or a mix names no calibration.
        """
        known = {}
        for name, table in calibrations.items():
            at = f"{place}: calibration.{name}"
            if name not in VARIABLES:
                raise LogError(f"{at}: '{name}' is no variable of stoop; name an output, such as pwm_1")
            known[name] = Calibration.of(at, table)
        rows = [(f"surface.{name}", name, surface.weights) for name, surface in surfaces.items()]
        for name, mixer in mixers.items():
            if mixer.left == mixer.right:
                raise LogError(f"{place}: mixer.{name}: left and right are the same output; name two")
            for moved, weights in MIXERS[mixer.kind].items():
                panels = dict(zip((mixer.left, mixer.right), weights, strict=True))
                rows.append((f"mixer.{name}", moved, panels))
        mixes: dict[str, Mapping[str, float]] = {}
        for where, surface, shares in rows:
            if surface in mixes:
                raise LogError(
                    f"{place}: {where} moves {surface}, which another table moves already; keep one of them"
                )
            if surface not in SURFACES:
                raise LogError(
                    f"{place}: {where} leads to '{surface}'; a mix leads to one of {', '.join(SURFACES)}"
                )
            for name in shares.keys() - known.keys():
                span = "[[1100, -0.4], [1900, 0.4]]" if name.startswith("pwm") else "[[-1, -0.4], [1, 0.4]]"
                raise LogError(
                    f"{place}: {surface} is mixed from {name}, which has no calibration; "
                    f"add [calibration.{name}] with points = {span}"
                )
            mixes[surface] = shares
        return cls(place, known, mixes)

    def deflections(self, channels: Sequence[Channels]) -> tuple[list[Channels], list[Notice]]:
        """Make surface deflections of recorded outputs, each mix on the clock of its first output, and notices."""
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
                values = np.where(np.abs(group.values[name]) < MAX_VALUE, group.values[name], np.nan)
                if name.startswith("pwm_"):  # a pulse of no length is none
                    values = np.where(values > 0.0, values, np.nan)
                x = known(values)
                if group.time is not first.time:
                    x = np.interp(first.time, group.time, x, left=np.nan, right=np.nan)
                total += weight * x
                low, high = known.inputs[0], known.inputs[-1]
                reading = values[np.isfinite(values)]
                share = float(((reading < low) | (reading > high)).mean()) if reading.size else 0.0
                if share > 0.0:
                    found[name] = notice("output-beyond-calibration", name, low=low, high=high, share=share)
            made.append(Channels(f"{first.source} (calibrated)", first.time, {surface: total}))
        return made, [*found.values()]

"""Search of the gains that reject disturbances best while the margins hold over the uncertainty of a model.

About each axis in turn, the others closed, P, I and D are those of the highest rejection (by 4 dB, so that the usual 3 dB have
a reserve), at the airspeed where it is lowest, for which every margin of every axis and the noise keep a specification: a
search over the logarithms of the parameters, by linear approximations of the constraints [1]_, from the best of a grid. An
axis restores its own margins first; where it cannot, the gains of the others are lowered, yaw first. It is done at the
estimates, with the specification raised by what the 5th percentile of the draws was below the estimate at the gains before; a
few rounds settle that difference. FF makes the rate of a fixed wing follow its setpoint at the frequency of the attitude loop,
whose gain stays as it flew.

References
----------
.. [1] M. J. D. Powell, "A direct search optimization method that models the objective and constraint functions by linear
   interpolation", in Advances in Optimization and Numerical Analysis, 1994.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from scipy.optimize import NonlinearConstraint, minimize

from stoop.extend.arrays import ComplexArray, FloatArray
from stoop.extend.errors import StoopError
from stoop_tune.control_laws.rate_law import SETPOINT
from stoop_tune.control_laws.table import Firmware, rounded
from stoop_tune.judgment import AxisMargins, Condition, judge, with_handling
from stoop_tune.loops import MOTION, SLOWEST, AxisLoop, frequencies, motion, opened, return_difference

FARTHEST: Final = 10.0  #: factor by which a gain moves at most
FEW: Final = 400  #: draws, of which the percentiles of most rounds are
ROUNDS: Final = 6  #: of the search, each with the percentiles of the last
GRID: Final = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 9.0)  #: factors of each gain, with which the search begins
STARTS: Final = 3  #: of that grid
STEP: Final = 0.4  #: first of the search, of a logarithm
TOLERANCE: Final = 1e-3
MOST: Final = 300  #: trials of a search
#: least of I over P, of that ratio in flight: what holds the trim is not given up for bandwidth
INTEGRAL_SHARE: Final = 0.5
SLACK: Final = 0.005  #: share of a specification that rounding may miss
SETTLED: Final = 0.02  #: change of the difference between estimates and percentile, share of a specification
RATE_TERMS: Final = ("P", "I", "D")
BACK_OFF: Final = 0.95  #: of the gains of an axis, as long as the last round misses a specification
BACK_OFFS: Final = 60
PLENTY: Final = 3.0  #: times a specification, from where more makes no difference


@dataclass(frozen=True)
class Specification:
    """What the 5th percentile of every margin keeps, and the 95th of the noise, at every airspeed and about every axis.

    Attributes
    ----------
    gain : dB (SAE AS94900)
    phase : deg (SAE AS94900)
    disk : dB, up and down, of the disk margin
    noise : %, rms of the command that the noise of the gyro causes, of a full command
    """

    gain: float = 6.0
    phase: float = 45.0
    disk: float = 4.0
    noise: float = 5.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise StoopError(f"tune: the specification {name} = {value:g}: write a number above zero")

    def shares(self, own: AxisMargins) -> FloatArray:
        """Return by how much margins and noise exceed the specification, as shares of it (4, 1 + d)."""
        found = own.values()
        with np.errstate(invalid="ignore"):
            kept = [
                found[name][1] / limit - 1.0
                for name, limit in (
                    ("gain margin", self.gain),
                    ("phase margin", self.phase),
                    ("disk margin", self.disk),
                )
            ]
            quiet = 1.0 - np.nan_to_num(found["noise"][1], posinf=100.0) / self.noise
        shares = np.nan_to_num(np.array([*kept, quiet]), nan=-1.0, posinf=PLENTY)
        return np.asarray(np.clip(shares, -1.0, PLENTY))

    def left(self, judged: Sequence[AxisMargins]) -> tuple[FloatArray, FloatArray]:
        """Return what margins (k) leave of it, as shares (k, 4): at the estimates, and as the 5th percentile of the draws."""
        found = np.array([self.shares(one) for one in judged])
        drawn = np.sort(found[..., 1:], axis=-1) if found.shape[-1] > 1 else found
        return found[..., 0], drawn[..., round(0.05 * (drawn.shape[-1] - 1))]


#: by who asks for them, from little damping to much: MIL-F-9490D at the limit airspeed and of elastic modes, and the optimization
#: of ArduCopter in discuss.ardupilot.org/t/109759; a disk margin of two thirds of the gain margin everywhere
DAMPING: Final = {
    "MIL-F-9490D at VL": Specification(4.5, 30.0, 3.0),
    "SAE AS94900": Specification(),
    "ArduCopter": Specification(7.0, 50.0, 4.7),
    "MIL-F-9490D elastic": Specification(8.0, 60.0, 5.3),
}


@dataclass(frozen=True, eq=False)
class Design:
    """Loops of a firmware around a model, and what they shall keep.

    Attributes
    ----------
    flown : parameters that the search begins with
    axes : those that the model has
    conditions : with the draws of the model
    noise : power spectral density of each axis' gyro, (rad/s)^2/Hz
    """

    firmware: Firmware
    flown: Mapping[str, float]
    axes: tuple[str, ...]
    conditions: Sequence[Condition]
    specification: Specification
    noise: Mapping[str, float]

    def loop(self, values: Mapping[str, float], axis: str, condition: Condition) -> AxisLoop:
        """Return the loops about an axis with some parameters at a condition."""
        return AxisLoop(
            self.firmware.law(values, axis), self.firmware.attitude_loop(values, axis), condition.ratio
        )

    def loops(self, values: Mapping[str, float]) -> list[dict[str, AxisLoop]]:
        """Return the loops of every axis at every condition."""
        return [{a: self.loop(values, a, one) for a in self.axes} for one in self.conditions]

    def margins(self, loops: Sequence[Mapping[str, AxisLoop]]) -> list[list[AxisMargins]]:
        """Return the margins of loops by axis, at every condition."""
        return [judge(one, own, self.noise) for one, own in zip(self.conditions, loops, strict=True)]

    def judged(self, values: Mapping[str, float]) -> list[list[AxisMargins]]:
        """Return the margins of every axis with some parameters, at every condition, with bandwidth and phase delay."""
        loops = self.loops(values)
        margins = zip(self.conditions, loops, self.margins(loops), strict=True)
        return [with_handling(one, own, found) for one, own, found in margins]

    def left(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return what is left of the specification (conditions, axes, 4): at the estimates, and as the 5th percentile."""
        found = [self.specification.left(at) for at in self.margins(self.loops(values))]
        return np.array([estimate for estimate, _ in found]), np.array([drawn for _, drawn in found])

    def opened(self, values: Mapping[str, float], place: int, count: int) -> ComplexArray:
        """Return the loops (n, k, m) opened at each actuator with some parameters, at a condition, of the first k models."""
        condition = self.conditions[place].part(slice(0, count))
        own = [self.loop(values, a, condition) for a in self.axes]
        frequency = frequencies(own)
        return opened(return_difference(motion(condition.plants, frequency), own, frequency))

    def tuned(self, axis: str) -> dict[str, str]:
        """Return the parameters of an axis that are searched, by term: a gain of zero stays zero."""
        named = self.firmware.gains(axis, self.flown)
        return {t: named[t] for t in RATE_TERMS if t in named and self.flown.get(named[t], 0.0) > 0.0}

    def part(self, count: int) -> Design:
        """Return the design around the first models: one is that of the estimates."""
        return replace(self, conditions=[c.part(slice(0, count)) for c in self.conditions])


def propose(design: Design) -> dict[str, float]:
    """Return the parameters that change, with their new values.

    Raises
    ------
    StoopError
        No gains near those that flew keep the specification.
    """
    axes = _searchable(design)
    central, raised = design.part(1), np.zeros(())
    joint = replace(design, conditions=[Condition.joint(design.conditions)])
    own = {**design.flown, **_feedforward(central)}
    for axis in axes:
        own |= _searched(joint, own, axis, raised, False, GRID)
    rejecting = [
        design.axes[i]
        for at in central.margins(central.loops(own))
        for i, one in enumerate(at)
        if one.margins.rejection[0]
    ]
    resting = [a for a in axes if a not in rejecting]  # there is nothing that their gains could be chosen by
    own |= {n: design.flown[n] for a in resting for n in design.tuned(a).values()}
    axes = tuple(a for a in axes if a in rejecting)
    for sample in (design.part(FEW), design):
        for _ in range(ROUNDS):
            before, begun = raised, dict(own)
            own = _lowered(central, own, resting, central.left(own)[1] - raised, raised)[0]
            # first each axis restores its own margins, then also those of the others
            for strict in (False, True):
                for axis in axes[::-1]:
                    own |= _searched(joint, own, axis, raised, strict)
            estimate, drawn = sample.left(own)
            raised = np.maximum(estimate - drawn, 0.0)
            settled = np.max(np.abs(raised - before)) < SETTLED
            if settled and (drawn.min() >= -SLACK or own == begun):
                break
    whole = {n: design.firmware.settable(own[n]) for a in axes for n in design.tuned(a).values()}
    if any(own[n] != x for n, x in whole.items()):
        own |= whole
        drawn = design.left(own)[1]
    own, drawn = _lowered(design, own, design.axes, drawn)
    if drawn.min() >= -SLACK:
        return {name: value for name, value in own.items() if value != design.flown[name]}
    worst, about, _ = np.unravel_index(np.argmin(drawn), drawn.shape)
    raise StoopError(
        f"tune: {design.conditions[int(worst)].place} no gains keep the specification about {design.axes[int(about)]}: lower "
        "it (--gain-margin, --phase-margin, --disk-margin, --noise), slow the attitude loop, or fly the maneuvers that the "
        "verdict asks for"
    )


def _lowered(
    design: Design,
    values: Mapping[str, float],
    axes: Sequence[str],
    left: FloatArray,
    raised: FloatArray | float = 0.0,
) -> tuple[dict[str, float], FloatArray]:
    """Return parameters with the gains of some axes lowered until each keeps the specification, and what is left of it.

    Parameters
    ----------
    left : (conditions, axes, 4), above `raised`, with `values`
    """
    own = dict(values)
    for _ in range(BACK_OFFS):
        missed = (left.min(axis=(0, 2)) < -SLACK).tolist()
        low = [a for a, one in zip(design.axes, missed, strict=True) if one and a in axes]
        if not low:
            break
        own |= {n: design.firmware.settable(BACK_OFF * own[n]) for a in low for n in design.tuned(a).values()}
        left = design.left(own)[1] - raised
    return own, left


def _searchable(design: Design) -> tuple[str, ...]:
    """Return the axes with gains; refuse parameters of which only a part is known."""
    missing = [
        n
        for a in design.axes
        for t, n in design.firmware.gains(a, design.flown).items()
        if t != "D" and n not in design.flown
    ]
    found = tuple(a for a in design.axes if design.tuned(a))
    if missing or not found:
        lacking = (
            f"{', '.join(missing)} {'are' if len(missing) > 1 else 'is'} missing"
            if missing
            else "all gains are zero"
        )
        raise StoopError(
            f"tune: {design.firmware.title}: {lacking}, so that no gains are proposed: take the parameters from a log of this "
            "vehicle, or all of them from its ground station"
        )
    return found


def _searched(
    design: Design,
    values: Mapping[str, float],
    axis: str,
    raised: FloatArray,
    strict: bool,
    grid: Sequence[float] = (),
) -> dict[str, float]:
    """Return the parameters of an axis of the highest rejection, what is left of the specification being `raised` or more.

    The design has one condition, whose models are the estimates at every airspeed.

    It begins with `values`, and with the best of a grid of factors of the gains that flew. Unless it is strict, what another
    axis misses with `values` is left to that axis; it may not miss more.
    """
    tuned = design.tuned(axis)
    names = list(tuned.values())
    origin = np.log([values[n] / design.flown[n] for n in names])
    place, (others,) = design.axes.index(axis), design.loops(values)

    def parameters(x: FloatArray) -> dict[str, float]:
        return {
            n: rounded(design.flown[n] * math.exp(step)) for n, step in zip(names, x.tolist(), strict=True)
        }

    @cache
    def trial(x: tuple[float, ...]) -> tuple[float, FloatArray]:
        tried = {**values, **parameters(np.array(x))}
        (judged,) = design.margins([{**others, axis: design.loop(tried, axis, design.conditions[0])}])
        left = np.stack([design.specification.shares(one) for one in judged], axis=1).T
        return -math.log(_rejection(judged[place])), np.min(left - raised, axis=0)

    lowest = -math.log(FARTHEST)
    highest = np.log([min(FARTHEST, design.firmware.largest / design.flown[n]) for n in names])
    rate = [names.index(tuned[term]) for term in ("P", "I") if term in tuned]

    asked = np.full((len(design.axes), 1), -0.5 * SLACK)
    if not strict:
        asked = np.minimum(trial(tuple(origin.tolist()))[1], asked)
    asked[place] = 0.0

    def kept(x: FloatArray) -> FloatArray:
        ratio = x[rate[1]] - x[rate[0]] if len(rate) > 1 else 0.0
        left = trial(tuple(x.tolist()))[1] - asked
        return np.append(left.ravel(), ratio - math.log(INTEGRAL_SHARE) + SLACK)

    def quality(x: FloatArray) -> tuple[float, float]:
        return min(0.0, float(kept(x).min())), -trial(tuple(x.tolist()))[0]

    tried = sorted(
        (np.minimum(np.log(x), highest) for x in itertools.product(grid, repeat=len(names))), key=quality
    )
    ends = [
        minimize(  # type: ignore[call-overload]  # its stubs know no options of COBYLA
            lambda x: trial(tuple(x.tolist()))[0],
            start,
            method="COBYLA",
            bounds=[(lowest, most) for most in highest],
            constraints=NonlinearConstraint(kept, 0.0, np.inf),
            tol=TOLERANCE,
            options={"rhobeg": STEP, "maxiter": MOST},
        ).x
        for start in (origin, *tried[-STARTS:])
    ]
    return parameters(max((np.clip(x, lowest, highest) for x in ends), key=quality))


def _rejection(own: AxisMargins) -> float:
    """Return the frequency, rad/s, up to which disturbances are reduced, or what comes nearest to it where they hardly are."""
    found = own.margins.firm_rejection
    least = np.where(found, found, SLOWEST * np.minimum(1.0, math.sqrt(0.5) / own.margins.slow))
    return float(least.min())


def _feedforward(design: Design) -> dict[str, float]:
    """Return the FF of each axis by which the rate follows its setpoint at the attitude loop's frequency, at the estimates."""
    out = {}
    for i, axis in enumerate(design.axes):
        name, angle = (
            design.firmware.gains(axis, design.flown).get("FF", ""),
            design.firmware.attitude_gain(design.flown, axis),
        )
        if not (design.flown.get(name, 0.0) > 0.0 and angle):
            continue
        one = design.firmware.law({**design.flown, name: 1.0}, axis)
        (term,) = (t for t in one.terms if t.name == "FF")
        at, needed = np.array([angle]), []
        for c in design.conditions:
            answer = motion(c.plants, at)[MOTION[axis][0]][0, i, 0]
            command = term.response(SETPOINT, np.exp(1j * at / one.rate), one.rate)[0] * c.ratio**term.power
            needed.append((1.0 / (answer * command)).real.item())
        if min(needed) > 0.0:
            flown = design.flown[name]
            out[name] = rounded(float(np.clip(np.mean(needed), flown / FARTHEST, flown * FARTHEST)))
    return out

"""The trivial model beside every figure: a lag for each channel of each maneuver.

In a fit maneuver the lag is given its own axis's command and fitted to that very maneuver: more commands would
make it a regression that can match anything once. In a validation maneuver it is given all commands, its gains
and times come from the fit maneuvers, and only its bias is its own: that favors the lag, for the model under
test gets nothing from the window but its initial state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.identify.result import Role
from stoop.validation.figures import Match
from stoop.validation.lag import Lag, LagRecord, fit_lag
from stoop.validation.runs import FloatArray, join

ROLL: Final = ("control_roll", "aileron")
PITCH: Final = ("control_pitch", "elevator")
YAW: Final = ("control_yaw", "rudder")
OWN_COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("p", "phi"), ROLL),
    **dict.fromkeys(("q", "V", "alpha", "theta", "ax", "az"), PITCH),
    **dict.fromkeys(("r", "beta", "psi", "ay"), YAW),
}  #: channel -> its axis's command, the first that there is


@dataclass(frozen=True, eq=False)
class BaselineSegment:
    """One segment of a maneuver.

    Attributes
    ----------
    commands : mapping of str to (n,)
        What the pilot or autopilot commanded, or the surfaces; complete; the same names in every segment.
    measured : mapping of str to (n,)
        The channels; NaN where missing; angles unwrapped.
    """

    commands: Mapping[str, FloatArray]
    measured: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class BaselineManeuver:
    """A maneuver as the trivial model sees it."""

    role: Role
    segments: tuple[BaselineSegment, ...]


def baseline_matches(
    maneuvers: Sequence[BaselineManeuver], channels: Sequence[str], rate: float
) -> tuple[dict[str, Match], ...]:
    """Return what the lag makes of every channel of every maneuver.

    Parameters
    ----------
    maneuvers : sequence of BaselineManeuver
        Fit and validation maneuvers in any order.
    channels : sequence of str
        Channels wanted; one without enough measurements is left out.
    rate : float, Hz
        Sample rate of all segments.

    Returns
    -------
    tuple of dict of str to Match
        For each maneuver its curves, segments joined by one NaN as in `stoop.validation.runs.join`. Without
        any fit maneuver the validation maneuvers have none.
    """
    found: tuple[dict[str, Match], ...] = tuple({} for _ in maneuvers)
    for channel in channels:
        joint = _joint(maneuvers, channel, rate)
        for maneuver, matches in zip(maneuvers, found, strict=True):
            match = _match(maneuver, channel, rate, joint)
            if match is not None:
                matches[channel] = match
    return found


def _joint(maneuvers: Sequence[BaselineManeuver], channel: str, rate: float) -> Lag | None:
    """Return the lag given all commands, fitted to all fit maneuvers, if something is to be predicted."""
    if all(maneuver.role == "fit" for maneuver in maneuvers):
        return None
    fitted = [m for m in maneuvers if m.role == "fit"]
    records = [r for number, m in enumerate(fitted) for r in _records(m, channel, _all(m), number)]
    return fit_lag(records, rate) if records else None


def _match(maneuver: BaselineManeuver, channel: str, rate: float, joint: Lag | None) -> Match | None:
    if maneuver.role == "validation":
        predicted = joint.predicted(_records(maneuver, channel, _all(maneuver))) if joint else None
        return Match(join(predicted)) if predicted is not None else None
    records = _records(maneuver, channel, _own(maneuver, channel))
    lag = fit_lag(records, rate) if records else None
    return Match(join(lag.matched(records)), join(lag.left_out(records))) if lag else None


def _records(
    maneuver: BaselineManeuver, channel: str, commands: Sequence[str], number: int = 0
) -> list[LagRecord]:
    return [
        LagRecord(*_arrays(segment, channel, commands), number) for segment in maneuver.segments if commands
    ]


def _arrays(segment: BaselineSegment, channel: str, commands: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    driving = np.column_stack([segment.commands[name] for name in commands])
    return driving, segment.measured.get(channel, np.full(len(driving), np.nan))


def _all(maneuver: BaselineManeuver) -> list[str]:
    return list(maneuver.segments[0].commands) if maneuver.segments else []


def _own(maneuver: BaselineManeuver, channel: str) -> list[str]:
    """Return the channel's own command where there is one, else all of them."""
    there = _all(maneuver)
    return [name for name in OWN_COMMANDS.get(channel, ()) if name in there][:1] or there

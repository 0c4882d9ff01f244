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

from stoop.assess.figures import Match
from stoop.assess.lag import Lag, LagRecord, fit_lag
from stoop.assess.runs import join
from stoop.base.arrays import FloatArray
from stoop.results.result import Role

ROLL: Final = ("control_roll", "aileron")
PITCH: Final = ("control_pitch", "elevator")
YAW: Final = ("control_yaw", "rudder")
_MIXED: Final = {
    **dict.fromkeys(("p", "phi", "ve", "ay"), "rotors_roll"),
    **dict.fromkeys(("q", "theta", "vn", "ax"), "rotors_pitch"),
    **dict.fromkeys(("r", "psi"), "rotors_yaw"),
    **dict.fromkeys(("vd", "az"), "rotors_heave"),
}
_SURFACES: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("p", "phi"), ROLL),
    **dict.fromkeys(("q", "V", "alpha", "theta", "ax", "az"), PITCH),
    **dict.fromkeys(("r", "beta", "psi", "ay"), YAW),
}
OWN_COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {
    c: (*_SURFACES.get(c, ()), *((_MIXED[c],) if c in _MIXED else ())) for c in (*_SURFACES, *_MIXED)
}  #: channel -> its axis's command, the first that there is
SAME_RATE: Final = 1e-6  #: in parts; two clocks read back from a file


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
    """A maneuver as the trivial model sees it; `rate` is its sample rate, Hz."""

    role: Role
    segments: tuple[BaselineSegment, ...]
    rate: float


def baseline_matches(
    maneuvers: Sequence[BaselineManeuver], channels: Sequence[str]
) -> tuple[dict[str, Match], ...]:
    """Return what the lag makes of every channel of every maneuver.

    Parameters
    ----------
    maneuvers : sequence of BaselineManeuver
        Fit and validation maneuvers in any order. What predicts learns from the fit maneuvers sampled as the first
        of them is; a lag is continuous in time, so it predicts at any rate.
    channels : sequence of str
        Channels wanted; one without enough measurements is left out.

    Returns
    -------
    tuple of dict of str to Match
        For each maneuver its curves, segments joined by one NaN as in `stoop.assess.runs.join`. Without
        any fit maneuver the validation maneuvers have none.
    """
    found: tuple[dict[str, Match], ...] = tuple({} for _ in maneuvers)
    for channel in channels:
        joint = _joint(maneuvers, channel)
        for maneuver, matches in zip(maneuvers, found, strict=True):
            match = _match(maneuver, channel, joint)
            if match is not None:
                matches[channel] = match
    return found


def _joint(maneuvers: Sequence[BaselineManeuver], channel: str) -> Lag | None:
    """Return the lag given all commands, fitted to all fit maneuvers, if something is to be predicted."""
    if all(maneuver.role == "fit" for maneuver in maneuvers):
        return None
    fitted = [m for m in maneuvers if m.role == "fit"]
    alike = [m for m in fitted if abs(m.rate - fitted[0].rate) < SAME_RATE * m.rate]
    records = [r for number, m in enumerate(alike) for r in _records(m, channel, _all(m), number)]
    return fit_lag(records, alike[0].rate) if records else None


def _match(maneuver: BaselineManeuver, channel: str, joint: Lag | None) -> Match | None:
    if maneuver.role == "validation":
        if joint is None:
            return None
        return Match(join(joint.at(maneuver.rate).predicted(_records(maneuver, channel, _all(maneuver)))))
    records = _records(maneuver, channel, _own(maneuver, channel))
    lag = fit_lag(records, maneuver.rate) if records else None
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

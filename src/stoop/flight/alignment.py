"""Clocks of streams that disagree, brought together by motion that both streams measured.

A mapping says which stream is moved, and by which other one:

.. code-block:: toml

    [align."mocap.csv"]                  # the stream whose clock is moved
    with = "autopilot.csv"               # the stream whose clock counts
    using = ["r", "turning"]             # quantities that are compared; left out: all that both streams hold
    longest = 30.0                       # s, the largest shift looked for; left out: any
    drift = true                         # also how fast one clock runs away from the other; left out: false
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final, TypeAlias, TypeGuard

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.rotations import conjugate, continuous, euler_angles, normalized, product, quaternions_of
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, POSITION, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import FlightError, LogError
from stoop.flight.channels import MAX_VALUE, Channels, finite
from stoop.flight.mapping_schema import AlignmentTable
from stoop.flight.time_delay import Lag, Signal, find_lag, with_drift
from stoop.logs import Recording

MIN_CORRELATION: Final = 0.5  #: below which a shift means nothing
MAX_ATTITUDE_DELAY: Final = (
    1.0  #: s; an attitude that comes later than this was not estimated from these rates
)
MIN_SHIFT: Final = 0.02  #: s; smaller disagreements are not worth a suggestion
QUANTITIES: Final = {
    "p": "roll rate, measured or from the attitude",
    "q": "pitch rate, measured or from the attitude",
    "r": "yaw rate, measured or from the attitude",
    "psi_dot": "how fast the heading changes; the yaw rate where there is no heading",
    "turning": "size of the rate of turn, whatever the axes",
    "vn": "velocity north, measured or from the position",
    "ve": "velocity east, measured or from the position",
    "vd": "velocity down, measured, or from position or altitude",
    "load": "size of the specific force, measured or from the velocity",
}  #: by which two streams can be compared

Supply: TypeAlias = Callable[[Recording, str], Sequence[Channels]]


@dataclass(frozen=True)
class Alignment:
    """One line of [align].

    Attributes
    ----------
    place : file and key, for messages
    stream : whose clock is moved
    reference : the stream whose clock counts
    using : quantities that are compared; empty means all
    longest : s, the largest shift that is looked for
    drift : whether the clocks may also run at different speeds
    """

    place: str
    stream: str
    reference: str
    using: tuple[str, ...] = ()
    longest: float = np.inf
    drift: bool = False

    @classmethod
    def of(cls, place: str, stream: str, table: AlignmentTable) -> Alignment:
        """Return what the table [align.STREAM] of a mapping says."""
        at = f"{place}: align.{stream}"
        if table.reference == stream:
            raise LogError(f"{at}: a stream cannot be aligned with itself; name another one in with")
        longest = np.inf if table.longest is None else table.longest
        return cls(at, stream, table.reference, tuple(table.using), longest, table.drift)

    def lag(self, recording: Recording, supply: Supply) -> Lag:
        """Return by how much the clock of the stream is to be moved.

        Raises
        ------
        FlightError
            When a stream is missing, or both have nothing in common that shows the shift.
        """
        found = []
        for name in (self.stream, self.reference):
            if name not in recording.streams:
                raise FlightError(
                    f"{self.place}: '{name}' is not in the log; it holds {', '.join(recording.streams)}"
                )
            known = quantities(supply(recording, name))
            found.append({q: x for q, x in known.items() if not self.using or q in self.using})
        moving, fixed = found
        if not moving.keys() & fixed.keys():
            raise FlightError(
                f"{self.place}: nothing in common to compare: {self.stream} holds {', '.join(moving) or 'nothing'}, "
                f"{self.reference} holds {', '.join(fixed) or 'nothing'}; map more of their columns"
            )
        lag = find_lag(moving, fixed, self.longest)
        if lag is None or lag.correlation < MIN_CORRELATION:
            why = (
                "they overlap too little" if lag is None else f"the best correlation is {lag.correlation:.2f}"
            )
            raise FlightError(
                f"{self.place}: {self.stream} and {self.reference} do not show the same motion ({why}); "
                f"check signs and axes, or give the offset under [clock.{self.stream}]"
            )
        return with_drift(lag, moving, fixed) if self.drift else lag


def align(
    alignments: Sequence[Alignment], recording: Recording, supply: Supply
) -> tuple[Recording, list[Notice]]:
    """Move the clocks of streams.

    Parameters
    ----------
    alignments : one for each stream to be moved
    recording : as it was read
    supply : gives all channels that a stream of the recording can supply

    Returns
    -------
    recording : with the clocks moved
    notices : by how much, and with which certainty

    Raises
    ------
    FlightError
        When a stream is missing, or both have nothing in common that shows the shift.
    """
    notices = []
    for one in alignments:
        lag = one.lag(recording, supply)
        values = {
            "shift": lag.shift,
            "std": lag.sigma,
            "correlation": lag.correlation,
            "overlap": lag.overlap,
        }
        notices.append(
            notice("clock-aligned", one.stream, reference=one.reference, using=lag.using, **values)
        )
        if lag.drift:
            notices.append(notice("clock-drift", one.stream, ppm=1e6 * lag.drift, std=1e6 * lag.drift_sigma))
        if not lag.trusted:
            notices.append(notice("clock-doubtful", one.stream, rival=lag.rival))
        stream = recording.streams[one.stream]
        moved = replace(stream, time=lag.moved(stream.time))
        recording = replace(recording, streams={**recording.streams, one.stream: moved})
    return recording, notices


def suggest_alignments(recording: Recording, supply: Supply, place: str) -> list[Notice]:
    """Name the streams of a log of several files whose clocks seem to disagree.

    Parameters
    ----------
    recording : of several files, each with a clock of its own
    supply : gives all channels that a stream of the recording can supply
    place : of the mapping, for the advice
    """
    every = {name: quantities(supply(recording, name)) for name in recording.streams}
    known = {name: signals for name, signals in every.items() if signals}
    notices = []
    for one, other in combinations(sorted(known, key=lambda name: -len(known[name])), 2):
        lag = find_lag(known[other], known[one])
        if _is_evident(lag):
            values = {"shift": -lag.shift, "correlation": lag.correlation}
            notices.append(notice("clocks-disagree", other, reference=one, mapping=place, **values))
    return notices


def attitude_delay(channels: Sequence[Channels]) -> list[Notice]:
    """Return by how much the attitude comes late against the body rates, where that is plain.

    Parameters
    ----------
    channels : those that were taken, each on its own clock
    """
    rates = next((group for group in channels if set(RATES) <= group.values.keys()), None)
    attitude = next(
        (g for g in channels if any(set(form) <= g.values.keys() for form in (QUATERNION, EULER))), None
    )
    if rates is None or attitude is None or rates.source == attitude.source:
        return []
    turning, measured = (
        {name: x for name, x in quantities([group]).items() if name in RATES} for group in (attitude, rates)
    )
    lag = find_lag(turning, measured, MAX_ATTITUDE_DELAY)
    if not _is_evident(lag):
        return []
    code = "attitude-late" if lag.shift < 0.0 else "attitude-early"
    values = {"delay": abs(lag.shift), "correlation": lag.correlation}
    return [notice(code, attitude.source, reference=rates.source, **values)]


def _is_evident(lag: Lag | None) -> TypeGuard[Lag]:
    return lag is not None and lag.trusted and abs(lag.shift) >= max(MIN_SHIFT, 3.0 * lag.sigma)


def quantities(channels: Sequence[Channels]) -> dict[str, Signal]:
    """Return the motion that channels of one stream show, by the names of `QUANTITIES`."""
    signals = {
        name: (group.time, np.where(np.abs(x) < MAX_VALUE, x, np.nan))
        for group in channels
        for name, x in group.values.items()
    }
    found = _turn_of_attitude(signals)
    if "psi" in signals and "psi_dot" not in found:
        t, x = finite(*signals["psi"])
        found["psi_dot"] = _slope(t, np.unwrap(x))
    found |= {name: signals[name] for name in RATES if name in signals}
    if "r" in found and "psi_dot" not in found:
        found["psi_dot"] = found["r"]
    if set(RATES) <= found.keys() and found["p"][0].size == found["r"][0].size == found["q"][0].size:
        size = np.sqrt(found["p"][1] ** 2 + found["q"][1] ** 2 + found["r"][1] ** 2)
        found["turning"] = found["p"][0], size
    for speed, place in zip(VELOCITY, POSITION, strict=True):
        if speed in signals:
            found[speed] = signals[speed]
        elif place in signals:
            found[speed] = _slope(*finite(*signals[place]))
    if "altitude" in signals and "vd" not in found:
        t, x = finite(*signals["altitude"])
        found["vd"] = _slope(t, -x)
    load = _load(signals)
    return found if load is None else {**found, "load": load}


def _turn_of_attitude(signals: Mapping[str, Signal]) -> dict[str, Signal]:
    """Return body rates and rate of heading that an attitude implies: 2 conj(q) dq/dt."""
    names = next((part for part in (QUATERNION, EULER) if set(part) <= signals.keys()), None)
    if names is None:
        return {}
    t = signals[names[0]][0]
    columns = np.column_stack([signals[name][1] for name in names])
    good = np.isfinite(columns).all(axis=1)
    t, columns = t[good], columns[good]
    if t.size < 3:
        return {}
    q = continuous(normalized(columns if names == QUATERNION else quaternions_of(columns)))
    rates = 2.0 * product(conjugate(q), np.gradient(q, t, axis=0)).T[1:]
    found = {name: (t, x) for name, x in zip(RATES, rates, strict=True)}
    return {**found, "psi_dot": _slope(t, np.unwrap(euler_angles(q)[:, 2]))}


def _load(signals: Mapping[str, Signal]) -> Signal | None:
    """Return the size of the specific force: as measured, else of the change of velocity less gravity."""
    for names in (SPECIFIC_FORCE, VELOCITY):
        if not set(names) <= signals.keys():
            continue
        t = signals[names[0]][0]
        parts = [signals[name][1] for name in names]
        if any(part.size != t.size for part in parts) or t.size < 3:
            continue
        if names == VELOCITY:
            x, y, z = (np.gradient(part, t) for part in parts)
            parts = [x, y, z - STANDARD_GRAVITY]
        return t, np.sqrt(parts[0] ** 2 + parts[1] ** 2 + parts[2] ** 2)
    return None


def _slope(t: FloatArray, x: FloatArray) -> Signal:
    return (t, np.gradient(x, t)) if t.size > 2 else (t[:0], x[:0])

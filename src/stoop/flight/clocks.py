"""Clocks of streams that disagree, brought together by what both streams measured.

A mapping says which stream is moved, and by which other one:

.. code-block:: toml

    [align."mocap.csv"]                  # the stream whose clock is moved
    with = "autopilot.csv"               # the stream whose clock counts
    using = ["r", "turning"]             # what is compared; left out: all that both streams tell
    longest = 30.0                       # s, the largest shift looked for; left out: any
    drift = true                         # also how fast one clock runs away from the other; left out: false
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Final, TypeAlias

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import conjugate, continuous, euler_angles, normalized, product, quaternions_of
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, QUATERNION
from stoop.errors import FlightError, LogError
from stoop.flight.channels import WILD, Channels
from stoop.flight.lag import Lag, Signal, find_lag, finite, with_drift
from stoop.logs import Recording
from stoop.logs.mapping import number_of, only_keys, text_of

HOPELESS: Final = 0.5  #: correlation below which a shift means nothing
LATEST: Final = 1.0  #: s; an attitude that comes later than this was not estimated from these rates
WORTH: Final = 0.02  #: s; smaller disagreements are not worth a suggestion
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
}  #: what two streams can be compared by

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


def read_alignments(place: str, tables: Mapping[str, Any]) -> tuple[Alignment, ...]:
    """Read the tables [align.STREAM] of a mapping.

    Raises
    ------
    LogError
        When a key is unknown or a stream is aligned with itself.
    """
    return tuple(_alignment(place, stream, table) for stream, table in tables.items())


def _alignment(place: str, stream: str, table: object) -> Alignment:
    where = f"align.{stream}"
    if not isinstance(table, dict):
        raise LogError(f'{place}: {where} is not a table; write {{with = "the stream whose clock counts"}}')
    only_keys(place, where, table, frozenset({"with", "using", "longest", "drift"}))
    reference = text_of(place, where, table, "with")
    using = table.get("using", [])
    if not isinstance(using, list) or any(
        not isinstance(name, str) or name not in QUANTITIES for name in using
    ):
        raise LogError(f"{place}: {where}.using is a list of some of {', '.join(QUANTITIES)}")
    longest = number_of(place, where, table, "longest", 0.0) if "longest" in table else np.inf
    drift = table.get("drift", False)
    if reference == stream or not isinstance(drift, bool) or longest <= 0.0:
        raise LogError(
            f"{place}: {where}: name another stream in with, a longest above zero, and drift = true or false"
        )
    return Alignment(f"{place}: {where}", stream, reference, tuple(using), longest, drift)


def align(
    alignments: Sequence[Alignment], recording: Recording, supply: Supply
) -> tuple[Recording, list[str]]:
    """Move the clocks of streams.

    Parameters
    ----------
    alignments : one for each stream to be moved
    recording : as it was read
    supply : gives all channels that a stream of the recording can supply

    Returns
    -------
    recording : with the clocks moved
    notes : by how much, and how sure that is

    Raises
    ------
    FlightError
        When a stream is missing, or both have nothing in common that tells the shift.
    """
    notes = []
    for one in alignments:
        lag = _found(one, recording, supply)
        notes.append(_words(one.stream, one.reference, lag))
        stream = recording.streams[one.stream]
        moved = replace(stream, time=lag.moved(stream.time))
        recording = replace(recording, streams={**recording.streams, one.stream: moved})
    return recording, notes


def _found(one: Alignment, recording: Recording, supply: Supply) -> Lag:
    for name in (one.stream, one.reference):
        if name not in recording.streams:
            raise FlightError(
                f"{one.place}: '{name}' is not in the log; it holds {', '.join(recording.streams)}"
            )
    moving, fixed = (
        _only(quantities(supply(recording, name)), one.using) for name in (one.stream, one.reference)
    )
    if not moving.keys() & fixed.keys():
        raise FlightError(
            f"{one.place}: nothing in common to compare: {one.stream} tells {_list(moving)}, "
            f"{one.reference} tells {_list(fixed)}; map more of their columns"
        )
    lag = find_lag(moving, fixed, one.longest)
    if lag is None or lag.correlation < HOPELESS:
        found = "they overlap too little" if lag is None else f"the best correlation is {lag.correlation:.2f}"
        raise FlightError(
            f"{one.place}: {one.stream} and {one.reference} do not show the same motion ({found}); "
            f"check signs and axes, or give the offset under [clock.{one.stream}]"
        )
    return with_drift(lag, moving, fixed) if one.drift else lag


def _only(signals: dict[str, Signal], using: tuple[str, ...]) -> dict[str, Signal]:
    return {name: x for name, x in signals.items() if not using or name in using}


def _list(names: Mapping[str, object]) -> str:
    return ", ".join(names) or "nothing"


def _words(stream: str, reference: str, lag: Lag) -> str:
    drift = ""
    if lag.drift:
        drift = f", and {1e6 * lag.drift:+.0f} (± {1e6 * lag.drift_sigma:.0f}) millionths of the time"
    doubt = "" if lag.trusted else f": DOUBTFUL, at another shift it is {lag.rival:.2f}; look at both by eye"
    return (
        f"clock of {stream} moved by {lag.shift:+.4f} s (± {lag.sigma:.4f}){drift} to that of {reference}, by "
        f"{', '.join(lag.using)}: correlation {lag.correlation:.2f} over {lag.overlap:.0f} s{doubt}"
    )


def suggestions(recording: Recording, supply: Supply, place: str) -> list[str]:
    """Say which streams of a log of several files look as if their clocks disagreed.

    Parameters
    ----------
    recording : of several files, each with a clock of its own
    supply : gives all channels that a stream of the recording can supply
    place : of the mapping, for the advice
    """
    told = {name: quantities(supply(recording, name)) for name in recording.streams}
    known = {name: signals for name, signals in told.items() if signals}
    notes = []
    for one, other in combinations(sorted(known, key=lambda name: -len(known[name])), 2):
        lag = find_lag(known[other], known[one])
        if lag is not None and lag.trusted and abs(lag.shift) > max(WORTH, 3.0 * lag.sigma):
            notes.append(
                f"the clock of {other} reads {-lag.shift:+.3f} s against that of {one} (correlation "
                f'{lag.correlation:.2f}): bring them together in {place} by [align."{other}"] with = "{one}"'
            )
    return notes


def lateness(channels: Sequence[Channels]) -> str:
    """Say by how much the attitude comes late against the body rates, where that is plain.

    Parameters
    ----------
    channels : those that were taken, each on its own clock
    """
    rates = next((group for group in channels if {"p", "q", "r"} <= group.values.keys()), None)
    attitude = next(
        (g for g in channels if any(set(form) <= g.values.keys() for form in (QUATERNION, EULER))), None
    )
    if rates is None or attitude is None or rates.source == attitude.source:
        return ""
    lag = find_lag(_turning_of(attitude), _turning_of(rates), LATEST)
    if lag is None or not lag.trusted or abs(lag.shift) < max(WORTH, 3.0 * lag.sigma):
        return ""
    way = "late" if lag.shift < 0.0 else "early"
    return (
        f"the attitude comes {abs(lag.shift):.3f} s {way} against the rates (shifted so, they correlate by "
        f"{lag.correlation:.2f}): bring it to their clock in a mapping, by [align.{attitude.source}] "
        f'with = "{rates.source}"'
    )


def _turning_of(group: Channels) -> dict[str, Signal]:
    return {name: x for name, x in quantities([group]).items() if name in ("p", "q", "r")}


def quantities(channels: Sequence[Channels]) -> dict[str, Signal]:
    """Return what channels of one stream tell of the motion, by the names of `QUANTITIES`."""
    signals = {
        name: (group.time, np.where(np.abs(x) < WILD, x, np.nan))
        for group in channels
        for name, x in group.values.items()
    }
    return {**_turning(signals), **_moving(signals)}


def _turning(signals: Mapping[str, Signal]) -> dict[str, Signal]:
    found: dict[str, Signal] = dict(_turn_of_attitude(signals))
    if "psi" in signals and "psi_dot" not in found:
        t, x = finite(*signals["psi"])
        found["psi_dot"] = _slope(t, np.unwrap(x))
    found |= {name: signals[name] for name in ("p", "q", "r") if name in signals}
    if "r" in found and "psi_dot" not in found:
        found["psi_dot"] = found["r"]
    if {"p", "q", "r"} <= found.keys() and found["p"][0].size == found["r"][0].size == found["q"][0].size:
        size = np.sqrt(found["p"][1] ** 2 + found["q"][1] ** 2 + found["r"][1] ** 2)
        found["turning"] = found["p"][0], size
    return found


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
    p, pitch, r = 2.0 * product(conjugate(q), np.gradient(q, t, axis=0)).T[1:]
    heading = np.unwrap(euler_angles(q)[:, 2])
    return {"p": (t, p), "q": (t, pitch), "r": (t, r), "psi_dot": _slope(t, heading)}


def _moving(signals: Mapping[str, Signal]) -> dict[str, Signal]:
    found: dict[str, Signal] = {}
    for speed, place in (("vn", "pn"), ("ve", "pe"), ("vd", "pd")):
        if speed in signals:
            found[speed] = signals[speed]
        elif place in signals:
            found[speed] = _slope(*finite(*signals[place]))
    if "altitude" in signals and "vd" not in found:
        t, x = finite(*signals["altitude"])
        found["vd"] = _slope(t, -x)
    load = _load(signals)
    return {**found, **({} if load is None else {"load": load})}


def _load(signals: Mapping[str, Signal]) -> Signal | None:
    """Return the size of the specific force: as measured, else of the change of velocity less gravity."""
    for names, pull in ((("ax", "ay", "az"), None), (("vn", "ve", "vd"), STANDARD_GRAVITY)):
        if not set(names) <= signals.keys():
            continue
        t = signals[names[0]][0]
        parts = [signals[name][1] for name in names]
        if any(part.size != t.size for part in parts) or t.size < 3:
            continue
        if pull is not None:
            x, y, z = (np.gradient(part, t) for part in parts)
            parts = [x, y, z - pull]
        return t, np.sqrt(parts[0] ** 2 + parts[1] ** 2 + parts[2] ** 2)
    return None


def _slope(t: FloatArray, x: FloatArray) -> Signal:
    return (t, np.gradient(x, t)) if t.size > 2 else (t[:0], x[:0])

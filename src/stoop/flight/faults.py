"""Suspected faults of sensors: stuck, clipped, an offset at rest. They are reported.

Nothing is corrected; a fit takes what was clipped or stuck as not measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, runs
from stoop.base.notices import Notice, notice
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import EULER, QUATERNION, RATES, SPECIFIC_FORCE, VARIABLES, VELOCITY
from stoop.flight.gridding import Channels, finite, stretches

if TYPE_CHECKING:
    from stoop.flight.flight import Flight

#: channels that move whenever the vehicle does
_AIR = ("V", "alpha", "beta", "airspeed_pitot", "airspeed_equivalent")
WATCHED: Final = frozenset({*_AIR, *RATES, *EULER, *QUATERNION, *SPECIFIC_FORCE, *VELOCITY})
#: codes of what contradicts a mapping as a whole begin so
INCONSISTENT: Final = ("mapping-", "rate-", "attitude-")
REST_OFFSETS: Final = {"airspeed_pitot": 1.0, "p": 0.02, "q": 0.02, "r": 0.02}  #: SI; less is usual


class Limits:
    """What is suspicious in a channel, and when a vehicle stands still."""

    stuck_time: Final = 1.0  #: s without any change
    stuck_samples: Final = 25
    clipped_samples: Final = 8  #: at a limit
    contrast: Final = 5  #: times as many samples at the limit as at the value next to it
    distinct: Final = 0.3  #: share of different values below which numbers are coarse, and meet by chance
    near_limit: Final = 0.005  #: of a limit: nearer was clipped, and moved a little by the filter of the grid
    rest_speed: Final = 0.5  #: m/s over ground
    rest_rate: Final = 0.05  #: rad/s
    rest_time: Final = 2.0  #: s
    weight: Final = 0.03  #: of gravity, by which the specific force at rest may depart from it


Kind = Literal["stuck", "clipped", "offset at rest", "wrong sign", "wrong unit", "inconsistent"]


@dataclass(frozen=True)
class Fault:
    """One suspicion."""

    #: "stuck", "clipped", "offset at rest", "wrong sign", "wrong unit" or "inconsistent" (with the attitude)
    kind: Kind
    variable: str  #: registry name
    value: float  #: SI; where it is stuck or clipped, or what it reads at rest
    start: float  #: s, where it was seen first and last
    stop: float
    notice: Notice  #: for the user

    @property
    def message(self) -> str:
        """The sentence of the notice, without its full stop."""
        return str(self.notice).removesuffix(".")

    def to_dict(self) -> dict[str, Any]:
        """Return what a JSON document holds."""
        names = ("kind", "variable", "value", "start", "stop", "message")
        return {name: getattr(self, name) for name in names}

    @staticmethod
    def removed(time: FloatArray, x: FloatArray, faults: Sequence[Fault]) -> FloatArray:
        """Return a gridded channel (n,) with NaN where its faults say stuck or clipped: a limit is no measurement.

        Without faults it is the channel itself.
        """
        out = x.copy() if faults else x
        for fault in faults:
            if fault.kind == "stuck":
                out[(time >= fault.start) & (time <= fault.stop)] = np.nan
            elif fault.kind == "clipped" and np.isfinite(x).any():
                edge, near = fault.value, Limits.near_limit * abs(fault.value)
                out[x > edge - near if edge > np.nanmedian(x) else x < edge + near] = np.nan
        return out


def recorded_faults(channels: Sequence[Channels]) -> list[Fault]:
    """Look for stuck and clipped channels in the samples as they were recorded."""
    found: list[Fault] = []
    for group in channels:
        shared = list(_shared_limits(group))
        found += shared
        for name in (WATCHED & set(group.values)) - {fault.variable for fault in shared}:
            t, x = finite(group.time, group.values[name])
            if x.size > Limits.stuck_samples:
                found += list(_clipped(name, t, x)) or _stuck(name, t, x)
    return sorted(found, key=lambda fault: list(VARIABLES).index(fault.variable))


def _shared_limits(group: Channels) -> Iterator[Fault]:
    """Yield limits at which several of three alike channels end, to the last digit: that is no chance."""
    for names in (RATES, SPECIFIC_FORCE):
        known = {name: x[np.isfinite(x)] for name, x in group.values.items() if name in names}
        long = [(n, known[n]) for n in names if n in known and known[n].size > Limits.stuck_samples]
        ends = [(name, float(end)) for name, x in long for end in (x.min(), x.max())]
        alike = {name for name, value in ends if _shared(value, ends)}
        # of those alone, as it takes a sort
        fine = {n for n in alike if np.unique(known[n]).size > Limits.distinct * known[n].size}
        ends = [(name, value) for name, value in ends if name in fine]
        for name, value in ends:
            if _shared(value, ends):
                at = group.time[group.values[name] == value]
                unit = VARIABLES[name].unit
                found = notice("shared-limit", name, value=value, unit=unit, count=int(at.size))
                yield Fault("clipped", name, value, float(at[0]), float(at[-1]), found)


def _shared(value: float, ends: Sequence[tuple[str, float]]) -> bool:
    """Tell whether several channels end at a size that is not zero."""
    return value != 0.0 and [abs(end) for _, end in ends].count(abs(value)) > 1


def _clipped(name: str, t: FloatArray, x: FloatArray) -> Iterator[Fault]:
    """Yield the limits at which samples pile up far more than at the values next to them."""
    if max(np.count_nonzero(x == end) for end in (x.min(), x.max())) < Limits.clipped_samples:
        return  # before all are sorted
    values, counts = np.unique(x, return_counts=True)
    if values.size < Limits.clipped_samples:
        return
    symmetric = abs(values[0] + values[-1]) < 0.01 * abs(values[-1])
    for end, beside in ((0, 1), (-1, -2)):
        value, count = float(values[end]), int(counts[end])
        if value == 0.0 or count < max(Limits.clipped_samples, Limits.contrast * int(counts[beside])):
            continue
        held = x == value
        if not symmetric and len(runs(held)) - int(held[0]) < 2:
            continue  # reached once: stuck rather than clipped
        at = t[held]
        found = notice("clipped-reading", name, value=value, unit=VARIABLES[name].unit, count=count)
        yield Fault("clipped", name, value, float(at[0]), float(at[-1]), found)


def _stuck(name: str, t: FloatArray, x: FloatArray) -> list[Fault]:
    """Return the longest time without any change, when it is suspiciously long."""
    best = None
    for part in stretches(t):
        times, values = t[part], x[part]
        edges = np.concatenate([[0], np.flatnonzero(np.diff(values) != 0.0) + 1, [values.size]])
        longest = int(np.argmax(np.diff(edges)))
        first, last = int(edges[longest]), int(edges[longest + 1]) - 1
        least = best[1] - best[0] if best else Limits.stuck_time
        if last - first >= Limits.stuck_samples and times[last] - times[first] > least:
            best = float(times[first]), float(times[last]), float(values[first])
    if best is None:
        return []
    start, stop, value = best
    unit = VARIABLES[name].unit
    found = notice("constant-reading", name, value=value, unit=unit, start=start, stop=stop)
    return [Fault("stuck", name, value, start, stop, found)]


def without_faults(flight: Flight) -> Flight:
    """Return the flight with the samples of clipped and stuck sensors taken as not measured."""
    by_name: dict[str, list[Fault]] = {}
    for fault in flight.faults:
        if fault.kind in ("clipped", "stuck"):
            by_name.setdefault(fault.variable, []).append(fault)
    if not by_name:
        return flight
    pairs = [(name, flight.column(name), found) for name, found in by_name.items()]
    columns = {name: Fault.removed(flight.time, x, found) for name, x, found in pairs}
    data = flight.data.assign({name: ("time", x, flight.data[name].attrs) for name, x in columns.items()})
    found = notice("samples-not-measured", variables=tuple(columns))
    return replace(flight, data=data, notices=(*flight.notices, found))


def contradiction(found: Notice, start: float, stop: float) -> Fault:
    """Return what contradicts a mapping as a fault of the channel, over the record [s]."""
    kind: Kind = "wrong sign" if found.code == "force-points-up" else "wrong unit"
    kind = "inconsistent" if found.code.startswith(INCONSISTENT) else kind
    value = next((found.values[name] for name in ("gain", "size", "evidence") if name in found.values), 0.0)
    return Fault(kind, found.subject, float(str(value)), start, stop, found)


def at_rest(data: Mapping[str, FloatArray], rate: float) -> BoolArray:
    """Tell at which grid points (n,) of `rate` [Hz] the vehicle surely stands: slow over ground, not turning, for a while."""
    if not {*VELOCITY, *RATES} <= data.keys():
        return np.zeros(next(iter(data.values())).size, dtype=bool)
    speed = np.sqrt(data["vn"] ** 2 + data["ve"] ** 2 + data["vd"] ** 2)
    turning = np.sqrt(data["p"] ** 2 + data["q"] ** 2 + data["r"] ** 2)
    still = (speed < Limits.rest_speed) & (turning < Limits.rest_rate)
    for start, stop in runs(still):
        if stop - start < Limits.rest_time * rate:
            still[start:stop] = False
    return still


def rest_faults(time: FloatArray, data: Mapping[str, FloatArray], rate: float) -> list[Fault]:
    """Look for offsets while the vehicle stands: pitot, gyros, length of the specific force."""
    rest = at_rest(data, rate)
    if not rest.any():
        return []
    watched = {name: data[name][rest] for name in REST_OFFSETS if name in data}
    if set(SPECIFIC_FORCE) <= data.keys():
        watched["az"] = np.asarray(np.sqrt(sum(data[name][rest] ** 2 for name in SPECIFIC_FORCE)))
    out = []
    for name, x in watched.items():
        known = x[np.isfinite(x)]
        value = float(np.median(known)) if known.size else 0.0
        if name == "az":
            off = abs(value - STANDARD_GRAVITY) > Limits.weight * STANDARD_GRAVITY
            found = notice("specific-force-at-rest", name, value=value)
        else:
            off = abs(value) > REST_OFFSETS[name]
            code = "pitot-at-rest" if name == "airspeed_pitot" and value > 0.0 else "offset-at-rest"
            found = notice(code, name, value=value, unit=VARIABLES[name].unit)
        if off:
            start, stop = time[rest][[0, -1]].tolist()
            out.append(Fault("offset at rest", name, value, start, stop, found))
    return out

"""Suspected faults of sensors: stuck, clipped, an offset at rest. They are reported.

Nothing is corrected; a fit takes what was clipped or stuck as not measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import VARIABLES
from stoop.flight.channels import Channels, stretches

WATCHED: Final = frozenset(
    "V alpha beta p q r phi theta psi ax ay az vn ve vd q0 q1 q2 q3 airspeed_pitot airspeed_equivalent".split()  # noqa: SIM905
)  #: channels that move whenever the vehicle does
STUCK_TIME: Final = 1.0  #: s
STUCK_SAMPLES: Final = 25
CLIPPED_SAMPLES: Final = 8
CLIPPED_CONTRAST: Final = 5  #: times as many samples at the limit as at the value next to it
ALIKE: Final = (("p", "q", "r"), ("ax", "ay", "az"))  #: channels of one sensor, clipped at one size
FINE: Final = 0.3  #: share of different values below which numbers are coarse, and meet by chance
NEAR: Final = 0.005  #: of a limit: what lies nearer was clipped, and moved a little by the filter of the grid
REST_SPEED: Final = 0.5  #: m/s over ground
REST_RATE: Final = 0.05  #: rad/s
REST_TIME: Final = 2.0  #: s

Kind: TypeAlias = Literal["stuck", "clipped", "offset at rest", "wrong sign", "wrong unit", "inconsistent"]


@dataclass(frozen=True)
class Fault:
    """One suspicion.

    Attributes
    ----------
    kind : "stuck", "clipped", "offset at rest", "wrong sign", "wrong unit" or "inconsistent" (with the attitude)
    variable : registry name
    value : SI; where it is stuck or clipped, or what it reads at rest
    start, stop : s, where it was seen first and last
    message : plain words
    """

    kind: Kind
    variable: str
    value: float
    start: float
    stop: float
    message: str


def recorded_faults(channels: Sequence[Channels]) -> list[Fault]:
    """Look for stuck and clipped channels in the samples as they were recorded."""
    found: list[Fault] = []
    for group in channels:
        shared = list(_shared_limits(group))
        found += shared
        for name in (WATCHED & set(group.values)) - {fault.variable for fault in shared}:
            good = np.isfinite(group.values[name])
            t, x = group.time[good], group.values[name][good]
            if x.size > STUCK_SAMPLES:
                limits = list(_clipped(name, t, x))
                found += limits or _stuck(name, t, x)
    return sorted(found, key=lambda fault: list(VARIABLES).index(fault.variable))


def _stuck(name: str, t: FloatArray, x: FloatArray) -> list[Fault]:
    """Return the longest time without any change, when it is suspiciously long."""
    best: tuple[float, float, float] | None = None
    for part in stretches(t, x):
        first, last = _longest_constant(x[part])
        lasted = t[part][last] - t[part][first]
        if last - first >= STUCK_SAMPLES and lasted > (best[1] - best[0] if best else STUCK_TIME):
            best = float(t[part][first]), float(t[part][last]), float(x[part][first])
    if best is None:
        return []
    start, stop, value = best
    unit = VARIABLES[name].unit
    message = f"{name} stands still at {value:.4g} {unit} from {start:.2f} to {stop:.2f} s"
    return [Fault("stuck", name, value, start, stop, message)]


def _longest_constant(x: FloatArray) -> tuple[int, int]:
    """Return first and last index of the longest run of equal values."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(x) != 0.0) + 1, [x.size]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1]) - 1


def _clipped(name: str, t: FloatArray, x: FloatArray) -> Iterator[Fault]:
    """Yield the limits at which samples pile up far more than at the values next to them."""
    values, counts = np.unique(x, return_counts=True)
    if values.size < CLIPPED_SAMPLES:
        return
    symmetric = abs(values[0] + values[-1]) < 0.01 * abs(values[-1])
    for end, beside in ((0, 1), (-1, -2)):
        value, count = float(values[end]), int(counts[end])
        if value == 0.0 or count < max(CLIPPED_SAMPLES, CLIPPED_CONTRAST * int(counts[beside])):
            continue
        held = x == value
        if not symmetric and np.count_nonzero(np.diff(held.astype(np.int8)) == 1) < 2:
            continue  # held once: stuck rather than clipped
        at = t[held]
        words = (
            f"{name} stops {count} times at exactly {value:.4g} {VARIABLES[name].unit}: clipped, or a default"
        )
        yield Fault("clipped", name, value, float(at[0]), float(at[-1]), words)


def _shared_limits(group: Channels) -> Iterator[Fault]:
    """Yield limits at which several of three alike channels end, to the last digit: that is no chance."""
    for names in ALIKE:
        ends = [end for name in names if name in group.values for end in _ends(name, group)]
        sizes = [abs(value) for _, value, _ in ends]
        for name, value, held in ends:
            if sizes.count(abs(value)) < 2 or value == 0.0:
                continue
            at = group.time[held]
            limit = f"{value:.4g} {VARIABLES[name].unit}"
            words = f"{name} stops {_often(at.size)} at exactly {limit}, where others stop too: clipped"
            yield Fault("clipped", name, value, float(at[0]), float(at[-1]), words)


def _often(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _ends(name: str, group: Channels) -> Iterator[tuple[str, float, npt.NDArray[np.bool_]]]:
    """Yield lowest and highest value of a channel and where it has them, unless its numbers are coarse."""
    x = group.values[name]
    seen = x[np.isfinite(x)]
    if seen.size > STUCK_SAMPLES and np.unique(seen).size > FINE * seen.size:
        for value in (float(seen.min()), float(seen.max())):
            yield name, value, x == value


def without_faulty(time: FloatArray, x: FloatArray, faults: Sequence[Fault]) -> FloatArray:
    """Return a channel with NaN where it was clipped or stuck: a limit is no measurement.

    Parameters
    ----------
    time, x : (n,), gridded
    faults : of this channel; those of other kinds take nothing away
    """
    out = x.copy()
    for fault in faults:
        if fault.kind == "stuck":
            out[(time >= fault.start) & (time <= fault.stop)] = np.nan
        elif fault.kind == "clipped":
            edge, near = fault.value, NEAR * abs(fault.value)
            beyond = x > edge - near if edge > np.nanmedian(x) else x < edge + near
            out[beyond] = np.nan
    return out


def as_fault(found: Notice, start: float, stop: float) -> Fault:
    """Return what contradicts a mapping as a fault of the channel, over the record [s]."""
    signs, motion = ("force-points-up",), ("mapping-", "rate-")
    kind: Kind = "wrong sign" if found.code in signs else "wrong unit"
    kind = "inconsistent" if found.code.startswith(motion) else kind
    value = next((found.values[name] for name in ("gain", "size", "evidence") if name in found.values), 0.0)
    return Fault(kind, found.subject, float(str(value)), start, stop, str(found).removesuffix("."))


def at_rest(data: Mapping[str, FloatArray], rate: float) -> npt.NDArray[np.bool_]:
    """Tell at which grid points the vehicle surely stands: slow over ground and not turning, for a while.

    Parameters
    ----------
    data : variable -> (n,), gridded
    rate : Hz
    """
    size = next(iter(data.values())).size
    if not {"vn", "ve", "vd", "p", "q", "r"} <= set(data):
        return np.zeros(size, dtype=bool)
    speed = np.sqrt(data["vn"] ** 2 + data["ve"] ** 2 + data["vd"] ** 2)
    turning = np.sqrt(data["p"] ** 2 + data["q"] ** 2 + data["r"] ** 2)
    still = (speed < REST_SPEED) & (turning < REST_RATE)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]))).reshape(-1, 2)
    for start, stop in edges:
        if stop - start < REST_TIME * rate:
            still[start:stop] = False
    return still


def rest_faults(time: FloatArray, data: Mapping[str, FloatArray], rate: float) -> list[Fault]:
    """Look for offsets while the vehicle stands: pitot, gyros, length of the specific force."""
    rest = at_rest(data, rate)
    if not rest.any():
        return []
    span = (float(time[rest][0]), float(time[rest][-1]))
    found = []
    for name, limit in (("airspeed_pitot", 1.0), ("p", 0.02), ("q", 0.02), ("r", 0.02)):
        value = _median(data[name][rest]) if name in data else 0.0
        if abs(value) > limit:
            words = f"{name} reads {value:.2f} {VARIABLES[name].unit} at rest{_doubt(name, value)}"
            found.append(Fault("offset at rest", name, value, *span, words))
    return found + _weight_fault(data, rest, span)


def _doubt(name: str, value: float) -> str:
    return " (or wind blew into it)" if name == "airspeed_pitot" and value > 0.0 else ""


def _weight_fault(
    data: Mapping[str, FloatArray], rest: npt.NDArray[np.bool_], span: tuple[float, float]
) -> list[Fault]:
    if not {"ax", "ay", "az"} <= set(data):
        return []
    force = np.sqrt(sum(data[name][rest] ** 2 for name in ("ax", "ay", "az")))
    value = _median(np.asarray(force))
    if abs(value - STANDARD_GRAVITY) <= 0.03 * STANDARD_GRAVITY:
        return []
    words = (
        f"the accelerometers read {value:.2f} m/s2 at rest in all, not 9.81: offset, scale or unit is wrong"
    )
    return [Fault("offset at rest", "az", value, *span, words)]


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0

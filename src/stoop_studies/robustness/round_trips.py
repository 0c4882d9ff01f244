"""What stoop writes, stoop reads: drawn flights and logs of hostile numbers, written, read, and compared.

Logs of numbers and flights of stoop's own come back to the bit, tables of text to nine digits, and autopilots' logs, which
hold numbers of 32 bits, to those.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop import logs
from stoop.base.arrays import FloatArray
from stoop.base.notices import notice
from stoop.base.variables import RATES, VARIABLES
from stoop.exporters.flight_logs import CLOCK, ENDINGS, OWN, TABLES, save_flight_as
from stoop.exporters.log_bytes import Event, Table, Topic, crazyflie_bytes, dataflash_bytes, ulog
from stoop.flight import Flight, from_columns, load
from stoop.logs.recording import Recording
from stoop_studies.robustness.differential import same
from stoop_studies.robustness.log_grammars import SHARES, Draw
from stoop_studies.robustness.other_readers import floats
from stoop_studies.robustness.readers import BOUNDS, in_this_process, prepare
from stoop_studies.robustness.trials import LISTED, SAME, BrokenPromiseError, Case, Tried, try_all

TYPES: Final = ("i1", "u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f4", "<f8")  #: of all logs' numbers
LETTERS: Final = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "f": "<f4",
                  "d": "<f8", "g": "<f2"}  #: of DataFlash, of numbers that are not scaled  # fmt: skip
EPSILON: Final = 2.0**-48  #: relative, of sums of many numbers of 64 bits
SINGLE: Final = 2.0**-22  #: relative, of numbers that were rounded to 32 bits twice
WHOLE: Final = ".bbl"  #: of whole numbers: rates are rounded to a tenth of a degree per second
DIGITS: Final = 9  #: of a number in a table of text


def try_round_trips(name: str, seed: int, count: int) -> Iterator[Tried]:
    """Try the first round trips of a seed by a writer, one of `ROUND_TRIPS`."""
    prepare("scipy.io")
    prepare("pyarrow.parquet")
    yield from try_all(lambda number: round_trip(name, seed, number), range(count), BOUNDS)


def round_trip(name: str, seed: int, number: int) -> Case:
    """Return what is written and read."""
    rng = Random(f"round trip {name} {seed} {number}")  # noqa: S311  no secret
    share = rng.choice(SHARES)
    draw = Draw(rng, share)

    def run(folder: Path) -> str:
        with in_this_process():
            return ROUND_TRIPS[name](draw, folder)

    return Case(number, "round trip", f"{100 * share:g} % hostile", run)


def _numbers(draw: Draw, count: int, kind: str) -> npt.NDArray[Any]:
    """Draw numbers (count,) of a type."""
    letter = "e" if kind == "<f2" else {value: key for key, value in LETTERS.items()}[kind]
    return np.array([draw.number(letter) for _ in range(count)], dtype=kind)


def _clock(draw: Draw) -> npt.NDArray[np.int64]:
    """Draw a growing clock (n,) [us]."""
    start = draw.rng.choice((0, 1, 10**12)) if draw.bad() else 2_000_000
    steps = [
        draw.rng.choice((1, 10**6, 10**9)) if draw.bad() else 20_000
        for _ in range(draw.rng.choice((1, 2, 60)))
    ]
    return start + np.cumsum(steps)


def _seconds(stamps: npt.NDArray[np.int64]) -> FloatArray:
    return np.asarray(1e-6 * stamps, dtype=np.float64)


def _check(recording: Recording, expected: Mapping[str, tuple[FloatArray, Mapping[str, FloatArray]]]) -> str:
    """Compare a recording with what was written: the streams and their columns to the bit.

    Raises
    ------
    BrokenPromiseError
        Something differs, or is missing.
    """
    if set(recording.streams) != set(expected):
        raise BrokenPromiseError(f"streams {sorted(recording.streams)} of {sorted(expected)}")
    for name, (time, columns) in expected.items():
        stream = recording.streams[name]
        if stream.time.size != time.size or not np.allclose(stream.time, time, rtol=1e-15, atol=0.0):
            raise BrokenPromiseError(f"the time of {name} is {stream.time[:3]}, not {time[:3]}")
        if lost := set(columns) - set(stream.columns):
            raise BrokenPromiseError(f"{name} has lost {sorted(lost)[:3]}")
        for key, values in columns.items():
            if (wrong := np.flatnonzero(~same(stream.columns[key], values))).size:
                i = wrong[0]
                raise BrokenPromiseError(f"{name} {key}: {stream.columns[key][i]!r} is not {values[i]!r}")
    return LISTED if recording.defects else SAME


def _as_floats(columns: Mapping[str, npt.NDArray[Any]]) -> dict[str, FloatArray]:
    return {key: floats(values.tolist()) for key, values in columns.items()}


def _ulog(draw: Draw, folder: Path) -> str:
    topics: list[Topic] = []
    for name in draw.rng.sample(("a", "sensor_combined", "b_1", "vehicle_attitude"), 2):
        for instance in range(draw.rng.randrange(1, 3)):
            stamps = _clock(draw)
            columns = {f"x{i}[{k}]" if i % 2 else f"x{i}": _numbers(draw, stamps.size, kind)
                       for i, kind in enumerate(draw.rng.sample(TYPES, 4)) for k in range(2 if i % 2 else 1)}  # fmt: skip
            if instance:  # of one layout with the first
                columns = {
                    key: _numbers(draw, stamps.size, x.dtype.str.replace("|", ""))
                    for key, x in topics[-1].columns.items()
                }
            topics.append(Topic(name, _seconds(stamps), columns, instance))
    path = folder / "a.ulg"
    path.write_bytes(
        ulog(
            topics,
            {"A": draw.number("f"), "B": int(draw.number("i"))},
            {"ver": draw.word("1").encode("utf-8", "ignore").decode()},
        )
    )
    expected = {
        f"{t.name}/{t.instance}" if t.instance else t.name: (t.time, _as_floats(t.columns)) for t in topics
    }
    return _check(logs.read(path), expected)


def _dataflash(draw: Draw, folder: Path) -> str:
    tables, expected = [], {}
    for name in ("IMU", "T1", "T2"):
        stamps = _clock(draw)
        letters = "".join(draw.rng.sample(list(LETTERS), 5))
        values: dict[str, Any] = {
            f"c{i}": _numbers(draw, stamps.size, LETTERS[x]) for i, x in enumerate(letters)
        }
        expected[name] = _seconds(stamps), _as_floats(values)
        columns = ",".join(["TimeUS", *values])
        tables.append(Table(name, columns, f"Q{letters}", "s-----", "F-----", {"TimeUS": stamps, **values}))
    path = folder / "a.bin"
    path.write_bytes(
        dataflash_bytes(
            tables, {"A": draw.number("f")}, [draw.word("armed").encode("utf-8", "ignore").decode()]
        )
    )
    return _check(logs.read(path), expected)


def _crazyflie(draw: Draw, folder: Path) -> str:
    events, expected = {}, {}
    for key, name in ((1, "fixedFrequency"), (700, "other")):
        stamps = _clock(draw)
        columns = {
            f"g.x{i}": _numbers(draw, stamps.size, kind) for i, kind in enumerate(draw.rng.sample(TYPES, 4))
        }
        events[name] = Event(key, _seconds(stamps), columns)
        expected[name] = _seconds(stamps), _as_floats(columns)
    path = folder / "a.usd"
    path.write_bytes(crazyflie_bytes(events))
    return _check(logs.read(path), expected)


def draw_flight(draw: Draw) -> Flight:
    """Draw a flight of any channels, with hostile numbers, names, notices and parameters."""
    count, rate = draw.rng.choice((1, 2, 3, 50, 300)), draw.rng.choice((1.0, 10.0, 100.0, 400.0))
    start = draw.rng.choice((0.0, 1e6, 1.7e9, -5.0)) if draw.bad() else 2.0
    names = draw.rng.sample(list(VARIABLES), draw.rng.randrange(1, 16))
    columns = {name: np.array([draw.number("d") for _ in range(count)], dtype=np.float64) for name in names}
    notices = tuple(notice("described-fault", name, text=draw.word("odd")) for name in names[:2])
    flight = from_columns(
        draw.word("flight"), start + np.arange(count) / rate, columns, notices, draw.word("simulation")
    )
    parameters = {draw.word(f"P{i}"): float(draw.number("d")) for i in range(3)}
    return Flight(**{**vars(flight), "parameters": parameters})


def _flight(ending: str, draw: Draw, folder: Path) -> str:
    flight, path = draw_flight(draw), folder / f"a{ending}"
    save_flight_as(flight, path)
    columns = {str(name): flight.column(str(name)) for name in flight.channels}
    if ending == OWN:
        back = load(path)
        found, known = ((x.rate, repr(x.sources), x.notices) for x in (back, flight))
        if found != known:
            raise BrokenPromiseError(f"rate, sources or notices are {found}, not {known}")
        return _check(logs.read(path), {"flight": (flight.time, columns)})
    if ending in TABLES:
        return _check_table(logs.read(path), path.name, flight.time, columns, ending == ".csv")
    back = load(path, rate=flight.rate)
    for name in RATES:
        if name in columns and name in back.names:
            compare_rates(name, flight, back)
    return LISTED if back.notices else SAME


def _check_table(
    recording: Recording, name: str, time: FloatArray, columns: dict[str, FloatArray], is_text: bool
) -> str:
    """Compare a table, which holds angles, or a quaternion, not both."""
    (stream,) = recording.streams.values()
    kept = {key: x for key, x in columns.items() if key in stream.columns}
    if set(stream.columns) != {CLOCK, *kept} or not {"phi", *kept} >= set(columns) - {"q0", "q1", "q2", "q3"}:
        raise BrokenPromiseError(f"columns {sorted(stream.columns)} of {sorted(columns)}")
    for key, values in {CLOCK: time, **kept}.items():
        digits = 16 if key == CLOCK else DIGITS
        wanted = floats([f"{x:.{digits}g}" for x in values]) if is_text else values
        found = stream.columns[key]
        # among whole numbers, the sign of a zero is lost
        if found.size != wanted.size or not (same(found, wanted) | (is_text & (found == wanted))).all():
            raise BrokenPromiseError(f"{key}: {found[:3]} is not {wanted[:3]}")
    return LISTED if recording.defects else SAME


def compare_rates(name: str, flight: Flight, back: Flight) -> None:
    """Compare a body rate at the times that both flights have, where both have a number.

    Clocks count microseconds: an error of one is a share of the step between neighbors.

    Raises
    ------
    BrokenPromiseError
        They differ by more than two roundings to 32 bits and one of the clock.
    """
    at = np.searchsorted(flight.time, back.time - 1e-6).clip(0, flight.time.size - 1)
    whole = flight.column(name)
    wanted, found = whole[at], back.column(name)
    there = (np.abs(flight.time[at] - back.time) < 2e-6) & np.isfinite(wanted) & np.isfinite(found)
    size, around = np.abs(whole[np.isfinite(whole)]), np.zeros(whole.size)
    padded = np.pad(size, 1, mode="edge") if size.size else np.zeros(1)
    around[np.isfinite(whole)] = np.max([padded[:-2], size, padded[2:]], axis=0)  # gaps are bridged
    around = around[at]
    filtered = EPSILON * padded.max()  # where a filter ran over all samples
    wrong = np.abs(found - wanted) > (SINGLE + 4e-6 * flight.rate) * around + filtered + 1e-37
    if (there & wrong).any():
        i = np.flatnonzero(there & wrong)[0]
        raise BrokenPromiseError(f"{name} is {found[i]}, not {wanted[i]}")


def _flight_trip(ending: str) -> Callable[[Draw, Path], str]:
    return lambda draw, folder: _flight(ending, draw, folder)


ROUND_TRIPS: Final[Mapping[str, Callable[[Draw, Path], str]]] = {
    "ulog": _ulog,
    "dataflash": _dataflash,
    "crazyflie": _crazyflie,
    **{f"flight {ending}": _flight_trip(ending) for ending in ENDINGS if ending != WHOLE},
}  #: name -> writer and reader

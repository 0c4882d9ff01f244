"""What stoop writes, stoop reads: drawn flights and logs of hostile numbers, written, read, and compared.

Logs of numbers and flights of stoop's own come back to the bit, tables of text to nine digits, and autopilots' logs, which
hold numbers of 32 bits, to those.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from studies.robustness.differential import same
from studies.robustness.drawn_logs import Choices
from studies.robustness.hostile import hostile_numbers, words
from studies.robustness.other_readers import floats
from studies.robustness.readers import in_this_process
from studies.robustness.trials import LISTED, SAME, promise

from stoop import logs
from stoop.base.notices import notice
from stoop.base.variables import RATES, VARIABLES
from stoop.exporters import flight_logs
from stoop.exporters.flight_logs import CLOCK, OWN, TABLES, save_flight_as
from stoop.exporters.log_bytes import Event, Table, Topic, crazyflie_bytes, dataflash_bytes, ulog
from stoop.flight import Flight, from_columns, load

LETTERS = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8", "f": "<f4",
           "d": "<f8", "g": "<f2"}  # fmt: skip  #: of DataFlash, of numbers that are not scaled
TYPES = [kind for kind in LETTERS.values() if kind != "<f2"]  #: of all logs' numbers
EPSILON = 2.0**-48  #: relative, of sums of many numbers of 64 bits
SINGLE = 2.0**-22  #: relative, of numbers that were rounded to 32 bits twice
ENDINGS = [ending for ending in flight_logs.ENDINGS if ending != ".bbl"]  #: which holds whole numbers
DIGITS = 9  #: of a number in a table of text
texts = words.map(lambda text: text.encode("utf-8", "ignore").decode())


@st.composite
def clocks(draw) -> np.ndarray:
    """Draw a growing clock (n,) [us]."""
    steps = draw(st.lists(st.sampled_from((20_000, 20_000, 1, 10**6, 10**9)), min_size=1, max_size=40))
    return draw(st.sampled_from((2_000_000, 0, 10**12))) + np.cumsum(steps)


def columns(draw, names: list[str], kinds: list[str], count: int) -> dict[str, np.ndarray]:
    """Draw columns (count,) of numbers of some types."""
    return {name: draw(arrays(kind, count)) for name, kind in zip(names, kinds, strict=True)}


def some_types(draw) -> list[str]:
    """Draw four types of number."""
    return draw(st.lists(st.sampled_from(TYPES), min_size=4, max_size=4, unique=True))


def as_floats(values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return columns as the readers give them."""
    return {key: floats(x.tolist()) for key, x in values.items()}


@st.composite
def ulogs(draw):
    """Draw a ULog: its name and bytes, and the streams that are expected; instances have one layout."""
    topics, expected = [], {}
    for name in draw(st.permutations(("a", "sensor_combined", "b_1", "vehicle_attitude")))[:2]:
        kinds = some_types(draw)
        for instance in range(draw(st.integers(1, 2))):
            stamps = draw(clocks())
            found = columns(
                draw, ["x0", "x1[0]", "x1[1]", "x2"], [kinds[0], kinds[1], kinds[1], kinds[2]], stamps.size
            )
            topics.append(Topic(name, 1e-6 * stamps, found, instance))
            expected[f"{name}/{instance}" if instance else name] = 1e-6 * stamps, as_floats(found)
    parameters = {"A": draw(st.floats(width=32)), "B": draw(st.integers(-(2**31), 2**31 - 1))}
    return "a.ulg", ulog(topics, parameters, {"ver": draw(texts)}), expected


@st.composite
def dataflashes(draw):
    """Draw a DataFlash log: its name and bytes, and the streams that are expected."""
    tables, expected = [], {}
    for name in ("IMU", "T1", "T2"):
        stamps = draw(clocks())
        letters = "".join(
            draw(st.lists(st.sampled_from(sorted(LETTERS)), min_size=5, max_size=5, unique=True))
        )
        found = columns(draw, [f"c{i}" for i in range(5)], [LETTERS[x] for x in letters], stamps.size)
        expected[name] = 1e-6 * stamps, as_floats(found)
        names = ",".join(["TimeUS", *found])
        tables.append(Table(name, names, f"Q{letters}", "s-----", "F-----", {"TimeUS": stamps, **found}))
    return "a.bin", dataflash_bytes(tables, {"A": draw(st.floats(width=32))}, [draw(texts)]), expected


@st.composite
def crazyflies(draw):
    """Draw a log of a Crazyflie: its name and bytes, and the streams that are expected."""
    events, expected = {}, {}
    for key, name in ((1, "fixedFrequency"), (700, "other")):
        stamps = draw(clocks())
        found = columns(draw, [f"g.x{i}" for i in range(4)], some_types(draw), stamps.size)
        events[name], expected[name] = Event(key, 1e-6 * stamps, found), (1e-6 * stamps, as_floats(found))
    return "a.usd", crazyflie_bytes(events), expected


LOGS = {"ulog": ulogs(), "dataflash": dataflashes(), "crazyflie": crazyflies()}  #: writer -> what it wrote


def try_log(folder: Path, name: str, content: bytes, expected) -> str:
    """Read a log that was written; the numbers are those that are expected, to the bit."""
    (folder / name).write_bytes(content)
    return check_streams(logs.read(folder / name), expected)


def check_streams(recording, expected) -> str:
    """Compare a recording with what was written."""
    promise(
        set(recording.streams) == set(expected), f"streams {sorted(recording.streams)} of {sorted(expected)}"
    )
    for name, (time, found) in expected.items():
        stream = recording.streams[name]
        kept = stream.time.size == time.size and np.allclose(stream.time, time, rtol=1e-15, atol=0.0)
        promise(kept, f"the time of {name} is {stream.time[:3]}, not {time[:3]}")
        promise(set(found) <= set(stream.columns), f"{name} has lost {set(found) - set(stream.columns)}")
        for key, values in found.items():
            wrong = np.flatnonzero(~same(stream.columns[key], values))
            promise(
                not wrong.size, f"{name} {key}: {stream.columns[key][wrong[:3]]} is not {values[wrong[:3]]}"
            )
    return LISTED if recording.defects else SAME


@st.composite
def flights(draw) -> tuple:
    """Draw the arguments of `made` for any channels, with hostile numbers, names, notices and parameters."""
    d = Choices(draw)
    count, rate = d.one(1, 2, 3, 50, 300), d.one(1.0, 10.0, 100.0, 400.0)
    start = d.one(0.0, 1e6, 1.7e9, -5.0) if d.bad() else 2.0
    names = d.some(VARIABLES, 1, 15)
    found = {name: np.array(d.numbers("d", count)) for name in names}
    faults = {name: d.word("odd") for name in names[:2]}
    parameters = {d.word(f"P{i}"): draw(hostile_numbers) for i in range(3)}
    return d.word("flight"), start + np.arange(count) / rate, found, faults, d.word("simulation"), parameters


def made(name: str, time, found, faults, source: str, parameters) -> Flight:
    """Return a flight; its clock may be refused."""
    notices = tuple(notice("described-fault", channel, text=text) for channel, text in faults.items())
    return replace(from_columns(name, time, found, notices, source), parameters=parameters)


def try_flight(folder: Path, ending: str, parts: tuple) -> str:
    """Make a flight, write it as a file of some kind, and compare what is read with it."""
    return there_and_back(folder, ending, made(*parts))


def there_and_back(folder: Path, ending: str, flight: Flight) -> str:
    """Write a flight as a file of some kind, and compare what is read with it."""
    path = folder / f"a{ending}"
    found = {str(name): flight.column(str(name)) for name in flight.channels}
    with in_this_process():
        save_flight_as(flight, path)
        if ending == OWN:
            back = load(path)
            told, known = ((x.rate, repr(x.sources), x.notices) for x in (back, flight))
            promise(told == known, f"rate, sources or notices are {told}, not {known}")
            return check_streams(logs.read(path), {"flight": (flight.time, found)})
        if ending in TABLES:
            return check_table(logs.read(path), flight.time, found, ending == ".csv")
        back = load(path, rate=flight.rate)
    for name in RATES:
        if name in found and name in back.names:
            compare_rates(name, flight, back)
    return LISTED if back.notices else SAME


def check_table(recording, time, found, is_text: bool) -> str:
    """Compare a table, which holds angles, or a quaternion, not both."""
    (stream,) = recording.streams.values()
    kept = {key: x for key, x in found.items() if key in stream.columns}
    whole = set(stream.columns) == {CLOCK, *kept} and {"phi", *kept} >= set(found) - {"q0", "q1", "q2", "q3"}
    promise(whole, f"columns {sorted(stream.columns)} of {sorted(found)}")
    for key, values in {CLOCK: time, **kept}.items():
        digits = 16 if key == CLOCK else DIGITS
        wanted = floats([f"{x:.{digits}g}" for x in values]) if is_text else values
        read = stream.columns[key]
        # among whole numbers, the sign of a zero is lost
        fits = read.size == wanted.size and (same(read, wanted) | (is_text & (read == wanted))).all()
        promise(fits, f"{key}: {read[:3]} is not {wanted[:3]}")
    return LISTED if recording.defects else SAME


def compare_rates(name: str, flight: Flight, back: Flight) -> None:
    """Compare a body rate at the times that both flights have, where both have a number.

    It may differ by two roundings to 32 bits and one of the clock, which counts microseconds: an error of one is a share of the
    step between neighbors.
    """
    at = np.searchsorted(flight.time, back.time - 1e-6).clip(0, flight.time.size - 1)
    whole = flight.column(name)
    wanted, found = whole[at], back.column(name)
    there = (np.abs(flight.time[at] - back.time) < 2e-6) & np.isfinite(wanted) & np.isfinite(found)
    size, around = np.abs(whole[np.isfinite(whole)]), np.zeros(whole.size)
    padded = np.pad(size, 1, mode="edge") if size.size else np.zeros(1)
    around[np.isfinite(whole)] = np.max([padded[:-2], size, padded[2:]], axis=0)  # gaps are bridged
    filtered = EPSILON * padded.max()  # where a filter ran over all samples
    wrong = there & (np.abs(found - wanted) > (SINGLE + 4e-6 * flight.rate) * around[at] + filtered + 1e-37)
    promise(not wrong.any(), f"{name} is {found[wrong][:3]}, not {wanted[wrong][:3]}")

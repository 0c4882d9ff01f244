"""Sound flights, vehicles, maneuvers and results with hostile numbers put into them.

Each is drawn from a sound one, so that what is hostile meets code far behind the readers: channels without motion or
without numbers, clocks that jump, masses of no body, bounds that touch, and numbers whose squares leave float64.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final, TypeAlias

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.variables import VARIABLES
from stoop.flight import Flight, save
from stoop.flight.flight import dataset
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle

HOSTILE: Final = (
    0.0, -0.0, 1.0, -1.0, 1e-9, 1e9, 1e-3, 1e5, 5e-324, 1e-308, 1e154, 1e200, 1e300, 1e308, -1e308, math.inf, -math.inf,
    math.nan, math.pi, 1.0 + 2.0**-52,
)  # fmt: skip
NAMES: Final = (
    "",
    " ",
    "a b",
    "a,b",
    "名",
    "x" * 300,
    "\x1b[31m",
    "time",
    "%s",
    "{}",
    "=1+1",
    "nan",
    '"',
    "é",
)
COUNTS: Final = (0, 1, 2, 3, 4, 7, 13, 20, 51)  #: samples of a flight that is cut short
LEAPS: Final = (1e-9, 0.5, 60.0, 3600.0, 1e6, 1e12, -1.0)  #: s of a clock
RATES: Final = (1e-3, 0.2, 1.0, 1e3, 1e5, 1e9)  #: Hz
WINGED: Final = """
duration = 6.0
rate = 25.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 0.5
step = 0.3
amplitude = 0.1
[[input]]
control = "aileron"
shape = "doublet"
start = 3.0
step = 0.4
amplitude = 0.1
"""
ON_ROTORS: Final = """
duration = 4.0
rate = 25.0
altitude = 100.0
[[input]]
control = "roll"
shape = "3-2-1-1"
start = 0.2
step = 0.15
amplitude = 10.0
[[input]]
control = "heave"
shape = "doublet"
start = 2.0
step = 0.4
amplitude = 3.0
"""
MANEUVERS: Final = {
    "twin-boom": WINGED,
    "short": WINGED.replace("aileron", "elevator"),
    "quad-x": ON_ROTORS,
    "hover": ON_ROTORS,
    "long": WINGED.replace("duration = 6.0", "duration = 24.0").replace("start = 3.0", "start = 12.0"),
    "glide": WINGED.replace("duration = 6.0", "duration = 65.0").replace("rate = 25.0", "rate = 10.0"),
    "long hover": ON_ROTORS.replace("duration = 4.0", "duration = 45.0"),
}  #: name of a flight and its vehicle -> maneuver file
FREED: Final = {"short": ("CLalpha", "Cmalpha", "Cmelevator"), "hover": ("rotors.T2",)}
MANY: Final = 170  #: further terms of the vehicle "many", which then has 200 free numbers
Document: TypeAlias = dict[str, Any]
Leaf: TypeAlias = tuple[Any, Any]  #: a table or list, and the key of what it holds


@dataclass(frozen=True, eq=False)
class Record:
    """A flight as columns of a table."""

    time: FloatArray  #: (n,) s
    columns: Mapping[str, FloatArray]  #: variable -> (n,)

    def cut(self, part: slice | BoolArray) -> Record:
        """Return a part of the samples."""
        return Record(self.time[part], {name: x[part] for name, x in self.columns.items()})


@cache
def vehicle(name: str) -> Vehicle:
    """Return a sound vehicle: a built-in one; "short" and "hover", of few free numbers; "many", of 200."""
    if name == "many":
        return parse_vehicle(toml_text(_with_many_terms(tomllib.loads(vehicle("twin-boom").text))), name)
    if name not in FREED:
        return resolve_vehicle(
            {"long": "twin-boom", "glide": "twin-boom", "long hover": "quad-x"}.get(name, name)
        )
    whole = resolve_vehicle("twin-boom" if name == "short" else "quad-x")
    document = tomllib.loads(whole.text)
    if name == "short":
        document["model"] = {"reduce": "longitudinal"}
    document["sensors"] = {"estimate_biases": False}
    for p in whole.parameters:
        if p.free and p.name not in FREED[name]:
            _fix(document, p.name)
    return parse_vehicle(toml_text(document), name)


def _fix(document: Document, name: str) -> None:
    """Make a number of a vehicle file no free one, where the file states it."""
    table, _, key = name.rpartition(".")
    tables = [document.get(table)] if table else list(document.get("aerodynamics", {}).values())
    for found in tables:
        if isinstance(found, dict) and isinstance(found.get(key), float):
            found[key] = {"value": found[key], "free": False}


def _with_many_terms(document: Document) -> Document:
    """Add products of powers to all coefficients."""
    powers = [(i, j, k) for i in range(4) for j in range(4) for k in range(3) if i + j + k > 1]
    for number in range(MANY):
        coefficient = ("CL", "CD", "CQ", "Cl", "Cm", "Cn")[number % 6]
        i, j, k = powers[number // 6]
        term = f"alpha^{i} * beta^{j} * q^{k}"
        document["aerodynamics"][coefficient][f"{coefficient}x{number}"] = {
            "term": term,
            "value": 0.0,
            "bounds": [-1.0, 1.0],
            "free": True,
        }
    return document


@cache
def flight(name: str) -> Flight:
    """Return the sound flight of a vehicle, with noise."""
    return simulate_flight(vehicle(name), parse_maneuver(MANEUVERS[name], name), 1, name="flight")


@cache
def record(name: str) -> Record:
    """Return the sound flight of a vehicle as a table."""
    time, data = flight(name).time, flight(name).data
    columns = {str(n): data[n].to_numpy() for n in data.data_vars if n in VARIABLES}
    if name == "glide":  # of which a polar needs the power
        columns |= {
            "voltage": 24.0 - 0.1 * time,
            "current": 40.0 + 5.0 * np.sin(time),
            "temperature": 0.0 * time + 290.0,
        }
    return Record(time, columns)


def hostile_record(rng: Random, name: str, most: int) -> tuple[str, Record]:
    """Draw a flight with up to so many edits; return the first edit, and the flight."""
    found, first = record(name), "sound"
    for number in range(rng.randint(0, most)):
        edit = rng.choice(tuple(FLIGHT_EDITS))
        first = edit if number == 0 else first
        with np.errstate(all="ignore"):
            found = FLIGHT_EDITS[edit](rng, found)
    return first, found


def _some(rng: Random, one: Record) -> list[str]:
    """Draw some of the channels."""
    names = sorted(one.columns)
    return rng.sample(names, rng.randint(1, len(names))) if rng.random() < 0.3 else rng.sample(names, 1)


def _each(change: Callable[[Random, FloatArray], FloatArray]) -> Callable[[Random, Record], Record]:
    """Make an edit of flights of one of a channel, which may be empty."""

    def edit(rng: Random, one: Record) -> Record:
        if not one.time.size:
            return one
        with np.errstate(all="ignore"):  # numbers beyond any size
            changed = (
                {name: change(rng, one.columns[name]) for name in _some(rng, one)} if one.columns else {}
            )
        return replace(one, columns={**one.columns, **changed})

    return edit


def _run(rng: Random, x: FloatArray) -> slice:
    """Draw a run of the samples."""
    begin = rng.randrange(x.size)
    return slice(begin, begin + rng.choice((1, 3, x.size // 3, x.size)))


def _with(x: FloatArray, part: slice | FloatArray, value: float) -> FloatArray:
    out = x.copy()
    out[part] = value
    return out


def _of_seed(rng: Random) -> np.random.Generator:
    return np.random.default_rng(rng.getrandbits(64))


def _zero_inputs(rng: Random, one: Record) -> Record:
    value = rng.choice((0.0, 0.0, 0.0, rng.choice(HOSTILE)))
    inputs = [n for n in one.columns if n in ("elevator", "aileron", "rudder") or n.startswith("motor_")]
    return replace(one, columns={**one.columns, **{n: np.full(one.time.size, value) for n in inputs}})


def _duplicate(rng: Random, one: Record) -> Record:
    source = one.columns[rng.choice(sorted(one.columns))] if one.columns else np.zeros(one.time.size)
    return replace(
        one, columns={**one.columns, **dict.fromkeys(_some(rng, one) if one.columns else [], source)}
    )


def _drop(rng: Random, one: Record) -> Record:
    dropped = _some(rng, one) if one.columns else []
    return replace(one, columns={n: x for n, x in one.columns.items() if n not in dropped})


def _leap(rng: Random, one: Record) -> Record:
    at = rng.randrange(one.time.size + 1)
    return replace(one, time=np.concatenate([one.time[:at], one.time[at:] + rng.choice(LEAPS)]))


def _rate(rng: Random, one: Record) -> Record:
    return replace(one, time=np.arange(one.time.size) / rng.choice(RATES) + rng.choice((0.0, 1e5, 1.7e9)))


def _jitter(rng: Random, one: Record) -> Record:
    return replace(
        one, time=one.time + _of_seed(rng).normal(0.0, rng.choice((1e-9, 0.01, 0.1)), one.time.size)
    )


FLIGHT_EDITS: Final[Mapping[str, Callable[[Random, Record], Record]]] = {
    "constant channel": _each(lambda rng, x: np.full(x.size, rng.choice((x[0], rng.choice(HOSTILE))))),
    "empty channel": _each(lambda rng, x: np.full(x.size, np.nan)),
    "run without numbers": _each(lambda rng, x: _with(x, _run(rng, x), np.nan)),
    "run of a hostile number": _each(lambda rng, x: _with(x, _run(rng, x), rng.choice(HOSTILE))),
    "hostile numbers": _each(
        lambda rng, x: np.where(_of_seed(rng).random(x.size) < 0.3, rng.choice(HOSTILE), x)
    ),
    "scaled": _each(lambda rng, x: x * rng.choice((-1.0, 57.3, 1e-3, 1e3, 1e-9, 1e9, 1e-300, 1e150, 1e300))),
    "offset": _each(lambda rng, x: x + rng.choice((1e-3, 1.0, 1e3, 1e9, 1e15))),
    "clipped": _each(lambda rng, x: np.clip(x, -abs(rng.gauss(0, 0.1)), abs(rng.gauss(0, 0.1)))),
    "rounded": _each(lambda rng, x: np.round(x, rng.choice((0, 1, 2)))),
    "noise": _each(lambda rng, x: _of_seed(rng).normal(0.0, rng.choice((1e-9, 0.1, 1e9)), x.size)),
    "shuffled": _each(lambda rng, x: _of_seed(rng).permutation(x)),
    "ramp": _each(lambda rng, x: np.linspace(0.0, 1.0, x.size) * rng.choice(HOSTILE)),
    "one number only": _each(lambda rng, x: _with(np.full(x.size, np.nan), slice(0, 1), x[0])),
    "denormal": _each(lambda rng, x: np.where(x > 0.0, 5e-324, -5e-324)),
    "duplicate": _duplicate,
    "fewer channels": _drop,
    "zero inputs": _zero_inputs,
    "few samples": lambda rng, one: one.cut(slice(0, rng.choice(COUNTS))),
    "gap": lambda rng, one: one.cut(_of_seed(rng).random(one.time.size) > rng.choice((0.1, 0.5, 0.95))),
    "leap of the clock": _leap,
    "other rate": _rate,
    "jitter of the clock": _jitter,
}  #: name -> edit


def as_files(rng: Random, one: Record, stem: str, odd: float) -> dict[str, bytes]:
    """Return a flight as a table with its mapping beside it, or as stoop's own file; its own path comes first.

    ``odd``: share of columns with an odd name.
    """
    if odd and rng.random() < 0.15 and one.columns:
        return {f"{stem}.nc": _own_file(one)}
    shown = {n: rng.choice(NAMES) + n if rng.random() < odd else n for n in one.columns}
    rows = np.column_stack([one.time, *one.columns.values()]).tolist()
    head = ",".join('"' + name.replace('"', '""') + '"' for name in ("t", *shown.values()))
    table = "\n".join([head, *(",".join(map(repr, row)).replace("nan", "") for row in rows), ""])
    mapping = {
        "time": {"column": "t", "unit": "s"},
        "variables": {n: {"column": shown[n], "unit": VARIABLES[n].unit} for n in one.columns},
    }
    return {f"{stem}.csv": table.encode(), f"{stem}.csv.toml": toml_text(mapping).encode()}


def _own_file(one: Record) -> bytes:
    """Return a flight as stoop's own file."""
    base, data = flight("short"), dataset(one.time, one.columns)
    period = float(one.time[1] - one.time[0]) if one.time.size > 1 else 0.0
    sources = dict.fromkeys(one.columns, next(iter(base.sources.values())))
    rate = 1.0 / period if period else base.rate
    with TemporaryDirectory(prefix="stoop-") as place:
        save(replace(base, data=data, rate=rate, sources=sources), Path(place, "flight.nc"))
        return Path(place, "flight.nc").read_bytes()


def toml_text(document: Document) -> str:
    """Return a document as TOML, one line per key at its top."""
    return "".join(f"{json.dumps(str(key))} = {_toml_value(value)}\n" for key, value in document.items())


def _toml_value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml_value(x)}" for key, x in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    return (
        json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        if isinstance(value, str | bool)
        else repr(value)
    )


def leaves(document: Any) -> list[Leaf]:
    """Return the places of all numbers of a document."""
    found: list[Leaf] = []
    pairs = document.items() if isinstance(document, dict) else enumerate(document)
    for key, value in pairs:
        if isinstance(value, dict | list):
            found += leaves(value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append((document, key))
    return found


def hostile_numbers(rng: Random, document: Document, most: int, numbers: tuple[float, ...] = HOSTILE) -> str:
    """Put up to so many hostile numbers into a document; return what the first of them is."""
    edit = "sound"
    for number in range(rng.randint(0, most)):
        places = leaves(document)
        if not places:
            break
        table, key = rng.choice(places)
        value = (
            rng.choice(numbers) if rng.random() < 0.7 else table[key] * rng.choice((-1, 0, 1e-9, 1e9, 1e300))
        )
        table[key] = value
        edit = "hostile number" if number == 0 else edit
    return edit


def hostile_vehicle(rng: Random, name: str, most: int = 3) -> tuple[str, str]:
    """Draw a vehicle file with hostile numbers, bounds and priors; return the first edit, and its text."""
    document = tomllib.loads(vehicle(name).text)
    edit = hostile_numbers(rng, document, most)
    if rng.random() < 0.4:
        tables = [*document.get("aerodynamics", {}).values(), document["mass"]]
        places = [
            (t, k) for t in tables for k, x in t.items() if isinstance(x, float | dict) and k != "inertia"
        ]
        for table, key in rng.sample(places, min(len(places), rng.choice((1, 2, 30)))):
            known = table[key] if isinstance(table[key], dict) else {"value": table[key]}
            table[key] = {**known, **_liberties(rng, float(known["value"]))}
        edit = "bounds and priors" if edit == "sound" else edit
    return edit, toml_text(document)


def _liberties(rng: Random, value: float) -> Document:
    """Draw bounds, freedom and prior of a number."""
    above = math.nextafter(value, math.inf)
    bounds = (
        (value, above), (value, value + 1.0), (-1e308, 1e308), (value - 1e-9, above), (value - 1e9, value + 1e9), (value, value),
    )  # fmt: skip
    out: Document = {"free": rng.random() < 0.8}
    if rng.random() < 0.7:
        out["bounds"] = list(rng.choice(bounds))
    if rng.random() < 0.5:
        out["prior"] = rng.choice((1e-300, 1e-9, 1.0, 1e9, 1e300))
    return out


def hostile_maneuver(rng: Random, name: str, most: int = 3) -> tuple[str, str]:
    """Draw a maneuver file; return the first edit, and its text."""
    document = tomllib.loads(MANEUVERS[name])
    edit = hostile_numbers(rng, document, most, (*HOSTILE, 0.04, 0.1, 3.0, 1e-6))
    if most and rng.random() < 0.3:
        document["noise"] = {
            channel: rng.choice(HOSTILE) for channel in rng.sample(("V", "alpha", "q", "az"), 2)
        }
        edit = "noise" if edit == "sound" else edit
    return edit, toml_text(document)

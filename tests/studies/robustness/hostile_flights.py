"""Sound flights, vehicles, maneuvers and results with hostile numbers put into them.

Each is made from a sound one, so that what is hostile meets code far behind the readers: channels without motion or
without numbers, clocks that jump, masses of no body, bounds that touch, and numbers whose squares leave float64.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np
from hypothesis import strategies as st
from studies.robustness.hostile import places, to_toml

from stoop.base.variables import VARIABLES
from stoop.flight import save
from stoop.flight.flight import dataset
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle

HOSTILE = (
    0.0, -0.0, 1.0, -1.0, 1e-9, 1e9, 1e-3, 1e5, 5e-324, 1e-308, 1e154, 1e200, 1e300, 1e308, -1e308, math.inf, -math.inf,
    math.nan, math.pi, 1.0 + 2.0**-52,
)  # fmt: skip
NAMES = ("", " ", "a b", "a,b", "名", "x" * 300, "\x1b[31m", "time", "%s", "{}", "=1+1", "nan", '"', "é")
STEP = '[[input]]\ncontrol = "{}"\nshape = "{}"\nstart = {}\nstep = {}\namplitude = {}\n'
WINGED = "duration = 6.0\nrate = 25.0\n" + STEP.format("elevator", "3-2-1-1", 0.5, 0.3, 0.1)
WINGED += STEP.format("aileron", "doublet", 3.0, 0.4, 0.1)
ON_ROTORS = "duration = 4.0\nrate = 25.0\naltitude = 100.0\n" + STEP.format(
    "roll", "3-2-1-1", 0.2, 0.15, 10.0
)
ON_ROTORS += STEP.format("heave", "doublet", 2.0, 0.4, 3.0)
MANEUVERS = {
    "twin-boom": WINGED, "short": WINGED.replace("aileron", "elevator"), "quad-x": ON_ROTORS, "hover": ON_ROTORS,
    "long": WINGED.replace("duration = 6.0", "duration = 24.0").replace("start = 3.0", "start = 12.0"),
    "glide": WINGED.replace("duration = 6.0", "duration = 65.0").replace("rate = 25.0", "rate = 10.0"),
    "long hover": ON_ROTORS.replace("duration = 4.0", "duration = 45.0"),
}  # fmt: skip  #: name of a flight and its vehicle -> maneuver file
FREED = {"short": ("CLalpha", "Cmalpha", "Cmelevator"), "hover": ("rotors.T2",)}
MANY = 170  #: further terms of the vehicle "many", which then has 200 free numbers


class Choices:
    """Choices of one command, drawn by Hypothesis."""

    tame = False  #: nothing is hostile

    def __init__(self, draw) -> None:
        self._draw = draw

    def one(self, *options):
        """Draw one of some."""
        return self._draw(st.sampled_from(options))

    def chance(self, share: float) -> bool:
        """Return true in a share of the cases."""
        return share > 0.0 and self._draw(st.integers(0, 99)) >= 100.0 * (1.0 - share)

    def count(self, least: int, most: int) -> int:
        """Draw a number of things."""
        return self._draw(st.integers(least, most))

    def noise(self) -> np.random.Generator:
        """Draw a generator of random numbers."""
        return np.random.default_rng(self.count(0, 2**32))


class SoundChoices(Choices):
    """The choices of a seed, of which nothing is hostile."""

    tame = True

    def __init__(self, seed: int | str) -> None:
        rng = Random(seed)  # noqa: S311  no secret
        self.one = lambda *options: rng.choice(options)
        self.chance = lambda share: rng.random() < share
        self.count = rng.randint


@dataclass(frozen=True, eq=False)
class Record:
    """A flight as columns of a table: time (n,) [s], and columns (n,) by variable."""

    time: np.ndarray
    columns: Mapping[str, np.ndarray]

    def cut(self, part) -> Record:
        """Return a part of the samples."""
        return Record(self.time[part], {name: x[part] for name, x in self.columns.items()})


@cache
def vehicle(name: str):
    """Return a sound vehicle: a built-in one; "short" and "hover", of few free numbers; "many", of 200."""
    if name in ("long", "glide", "long hover"):
        return vehicle("quad-x" if "hover" in name else "twin-boom")
    if name == "many":
        document = tomllib.loads(vehicle("twin-boom").text)
        powers = [(i, j, k) for i in range(4) for j in range(4) for k in range(3) if i + j + k > 1]
        for number in range(MANY):
            coefficient, (i, j, k) = ("CL", "CD", "CQ", "Cl", "Cm", "Cn")[number % 6], powers[number // 6]
            term = {
                "term": f"alpha^{i} * beta^{j} * q^{k}",
                "value": 0.0,
                "bounds": [-1.0, 1.0],
                "free": True,
            }
            document["aerodynamics"][coefficient][f"{coefficient}x{number}"] = term
        return parse_vehicle(to_toml(document).decode(), name)
    if name not in FREED:
        return resolve_vehicle(name)
    whole = resolve_vehicle("twin-boom" if name == "short" else "quad-x")
    document = tomllib.loads(whole.text) | {"sensors": {"estimate_biases": False}}
    if name == "short":
        document["model"] = {"reduce": "longitudinal"}
    for p in whole.parameters:
        table, _, key = p.name.rpartition(".")
        for found in [document.get(table)] if table else document.get("aerodynamics", {}).values():
            if (
                p.free
                and p.name not in FREED[name]
                and isinstance(found, dict)
                and isinstance(found.get(key), float)
            ):
                found[key] = {"value": found[key], "free": False}
    return parse_vehicle(to_toml(document).decode(), name)


@cache
def flight(name: str):
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


def _with(x, part, value):
    out = x.copy()
    out[part] = value
    return out


def _run(d, x) -> slice:
    begin = d.count(0, x.size - 1)
    return slice(begin, begin + d.one(1, 3, x.size // 3, x.size))


CHANNEL_EDITS = {
    "constant channel": lambda d, x: np.full(x.size, d.one(x[0], *HOSTILE)),
    "empty channel": lambda d, x: np.full(x.size, np.nan),
    "run without numbers": lambda d, x: _with(x, _run(d, x), np.nan),
    "run of a hostile number": lambda d, x: _with(x, _run(d, x), d.one(*HOSTILE)),
    "hostile numbers": lambda d, x: np.where(d.noise().random(x.size) < 0.3, d.one(*HOSTILE), x),
    "scaled": lambda d, x: x * d.one(-1.0, 57.3, 1e-3, 1e3, 1e-9, 1e9, 1e-300, 1e150, 1e300),
    "offset": lambda d, x: x + d.one(1e-3, 1.0, 1e3, 1e9, 1e15),
    "clipped": lambda d, x: np.clip(x, -d.one(0.01, 0.1), d.one(0.01, 0.1)),
    "rounded": lambda d, x: np.round(x, d.one(0, 1, 2)),
    "noise": lambda d, x: d.noise().normal(0.0, d.one(1e-9, 0.1, 1e9), x.size),
    "shuffled": lambda d, x: d.noise().permutation(x),
    "ramp": lambda d, x: np.linspace(0.0, 1.0, x.size) * d.one(*HOSTILE),
    "one number only": lambda d, x: _with(np.full(x.size, np.nan), slice(0, 1), x[0]),
    "denormal": lambda d, x: np.where(x > 0.0, 5e-324, -5e-324),
}  #: name -> edit of a channel that is not empty


def _leap(d, one: Record) -> Record:
    at, leap = d.count(0, one.time.size), d.one(1e-9, 0.5, 60.0, 3600.0, 1e6, 1e12, -1.0)
    return replace(one, time=np.concatenate([one.time[:at], one.time[at:] + leap]))


def _zero_inputs(d, one: Record) -> Record:
    value = d.one(0.0, 0.0, 0.0, *HOSTILE)
    inputs = [n for n in one.columns if n in ("elevator", "aileron", "rudder") or n.startswith("motor_")]
    return replace(one, columns={**one.columns, **{n: np.full(one.time.size, value) for n in inputs}})


FLIGHT_EDITS = {
    "duplicate": lambda d, one: replace(
        one, columns={**one.columns, **dict.fromkeys(some(d, one), one.columns[d.one(*one.columns)])}
    ),
    "fewer channels": lambda d, one: replace(
        one, columns={n: x for n, x in one.columns.items() if n not in some(d, one)}
    ),
    "zero inputs": _zero_inputs,
    "few samples": lambda d, one: one.cut(slice(0, d.one(0, 1, 2, 3, 4, 7, 13, 20, 51))),
    "gap": lambda d, one: one.cut(d.noise().random(one.time.size) > d.one(0.1, 0.5, 0.95)),
    "leap of the clock": _leap,
    "other rate": lambda d, one: replace(
        one, time=np.arange(one.time.size) / d.one(1e-3, 0.2, 1.0, 1e3, 1e5, 1e9) + d.one(0.0, 1e5, 1.7e9)
    ),
    "jitter of the clock": lambda d, one: replace(
        one, time=one.time + d.noise().normal(0.0, d.one(1e-9, 0.01, 0.1), one.time.size)
    ),
}  #: name -> edit of a flight that has a channel


def some(d, one: Record) -> list[str]:
    """Draw some of the channels: one of them, or up to three."""
    return [d.one(*one.columns) for _ in range(d.one(1, 1, 3))]


def edited(d, one: Record, edit: str) -> Record:
    """Return a flight with an edit; one that is empty stays as it is."""
    if not (one.time.size and one.columns):
        return one
    with np.errstate(all="ignore"):  # numbers beyond any size
        if edit in FLIGHT_EDITS:
            return FLIGHT_EDITS[edit](d, one)
        changed = {name: CHANNEL_EDITS[edit](d, one.columns[name]) for name in some(d, one)}
    return replace(one, columns={**one.columns, **changed})


def hostile_record(d, name: str, most: int) -> Record:
    """Draw a flight with up to so many edits."""
    found = record(name)
    for _ in range(d.count(0, most)):
        found = edited(d, found, d.one(*CHANNEL_EDITS, *FLIGHT_EDITS))
    return found


def as_files(d, one: Record, stem: str) -> dict[str, bytes]:
    """Return a flight as a table with its mapping beside it, or as stoop's own file; its own path comes first."""
    if not d.tame and one.columns and d.chance(0.15):
        return {f"{stem}.nc": _own_file(one)}
    odd = d.one(*one.columns) if not d.tame and one.columns and d.chance(0.15) else None
    shown = {n: d.one(*NAMES) + n if n == odd else n for n in one.columns}
    rows = np.column_stack([one.time, *one.columns.values()]).tolist()
    head = ",".join('"' + name.replace('"', '""') + '"' for name in ("t", *shown.values()))
    table = "\n".join([head, *(",".join(map(repr, row)).replace("nan", "") for row in rows), ""])
    lines = {n: {"column": shown[n], "unit": VARIABLES[n].unit} for n in one.columns}
    mapping = to_toml({"time": {"column": "t", "unit": "s"}, "variables": lines})
    return {f"{stem}.csv": table.encode(), f"{stem}.csv.toml": mapping}


def _own_file(one: Record) -> bytes:
    """Return a flight as stoop's own file."""
    base, data = flight("short"), dataset(one.time, one.columns)
    period = float(one.time[1] - one.time[0]) if one.time.size > 1 else 0.0
    sources = dict.fromkeys(one.columns, next(iter(base.sources.values())))
    with TemporaryDirectory(prefix="stoop-") as place:
        rate = 1.0 / period if period else base.rate
        save(replace(base, data=data, rate=rate, sources=sources), Path(place, "flight.nc"))
        return Path(place, "flight.nc").read_bytes()


def hostile_numbers(d, document, most: int, numbers=HOSTILE) -> None:
    """Put up to so many hostile numbers into a document."""
    for _ in range(d.count(0, most)):
        found = [(h, k) for h, k in places(document) if type(h[k]) in (int, float)]
        if found:
            holder, key = d.one(*found)
            holder[key] = d.one(*numbers, *(holder[key] * factor for factor in (-1, 0, 1e-9, 1e9, 1e300)))


def hostile_vehicle(d, name: str, most: int = 3) -> bytes:
    """Draw a vehicle file with hostile numbers, bounds and priors."""
    document = tomllib.loads(vehicle(name).text)
    hostile_numbers(d, document, most)
    if d.chance(0.4):
        tables = [*document.get("aerodynamics", {}).values(), document["mass"]]
        found = [
            (t, k) for t in tables for k, x in t.items() if isinstance(x, float | dict) and k != "inertia"
        ]
        for _ in range(d.one(1, 2, 30)):
            table, key = d.one(*found)
            known = table[key] if isinstance(table[key], dict) else {"value": table[key]}
            table[key] = {**known, **liberties(d, float(known["value"]))}
    return to_toml(document)


def liberties(d, value: float) -> dict:
    """Draw bounds, freedom and prior of a number."""
    above = math.nextafter(value, math.inf)
    bounds = (
        (value, above), (value, value + 1.0), (-1e308, 1e308), (value - 1e-9, above), (value - 1e9, value + 1e9), (value, value),
    )  # fmt: skip
    drawn = {
        "free": d.chance(0.8),
        "bounds": list(d.one(*bounds)),
        "prior": d.one(1e-300, 1e-9, 1.0, 1e9, 1e300),
    }
    return {key: x for key, x in drawn.items() if key == "free" or d.chance(0.6)}


def hostile_maneuver(d, name: str, most: int = 3) -> bytes:
    """Draw a maneuver file."""
    document = tomllib.loads(MANEUVERS[name])
    hostile_numbers(d, document, most, (*HOSTILE, 0.04, 0.1, 3.0, 1e-6))
    if most and d.chance(0.3):
        document["noise"] = {d.one("V", "alpha", "q", "az"): d.one(*HOSTILE) for _ in range(2)}
    return to_toml(document)

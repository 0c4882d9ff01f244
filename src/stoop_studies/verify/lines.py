"""Wrong lines of mappings: flights whose columns are not what their mapping says, and flights that are right.

A simulated flight is preceded by time on the ground, in which the estimator holds zeros, and written as a log with the names
and units of one of four kinds. Of a mangled flight one thing of one line is wrong; `stoop info` is to name that line, and
`stoop map` is not to draft it without a doubt. Right flights, simulated and real, are to be accused of nothing.
"""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop import logs
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.toml import quoted, quoted_key
from stoop.base.units import DEGREE, FACTORS, STANDARD_GRAVITY
from stoop.base.variables import EULER, POSITION, RATES, SPECIFIC_FORCE, VARIABLES, VELOCITY
from stoop.errors import StoopError
from stoop.flight import Flight, load_flight
from stoop.flight.air_data import RECONSTRUCTED
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop_draft.checks.entries import Line
from stoop_draft.checks.mapping import ContradictedError, check_mapping
from stoop_draft.mapping_corrections import corrected_mapping
from stoop_draft.mapping_draft import draft
from stoop_studies.findings import Findings, Setting, holds
from stoop_studies.verify import study
from stoop_studies.verify.scenes import LOG_GRID

Columns = Mapping[str, FloatArray]  #: variable -> (n,) SI
RATE: Final = 50.0  #: Hz
GROUND, DURATION = 15.0, 60.0  #: s, before take-off and in flight
ZEROS: Final = 10.0  #: s until the estimator starts
CALIBRATED: Final = 0.05  #: a factor that was found is no better
AIRCRAFT: Final = "twin-boom"
ROTORCRAFT: Final = ("quad-x", "hexa-x", "quad-plus")


@dataclass(frozen=True)
class Mangled:
    """What is wrong with the columns of a flight."""

    words: str
    lines: tuple[str, ...]  #: variables whose lines are wrong
    apply: Callable[[Columns], Columns]  #: what was measured -> what was recorded, as the mapping reads it
    #: what was measured -> what a right mapping reads, where the record does not show all
    shown: Callable[[Columns], Columns] = dict


def times(words: str, factor: float, *names: str) -> Mangled:
    """Return columns that are multiplied."""
    return Mangled(words, names, lambda x: {**x, **{n: factor * x[n] for n in names if n in x}})


def swap(one: str, other: str) -> Mangled:
    """Return columns that are exchanged."""
    return Mangled(
        f"{one} and {other} exchanged", (one, other), lambda x: {**x, one: x[other], other: x[one]}
    )


def lost(name: str) -> Mangled:
    """Return a column that lost its sign."""
    return times(f"sign of {name}", -1.0, name)


def _mangled(row: Sequence[Any]) -> Mangled:
    """Return a row of ``vehicles/lines.toml``."""
    return swap(*row[1:]) if row[0] == "exchanged" else times(*row)


def turned(words: str, *names: str, east: bool = False) -> Mangled:
    """Return columns along other axes: a body of forward, left, up; a ground of east (or north), north (or west), up.

    An attitude between them keeps its bank, reverses its pitch, and counts its heading from east (north) to the left.
    """

    def apply(x: Columns) -> Columns:
        out, turn = dict(x), 0.5 * np.pi if east else 0.0
        for vector in (RATES, SPECIFIC_FORCE, EULER, VELOCITY, POSITION):
            for name in set(vector[1:]) & set(names):
                out[name] = -x[name]
            if east and vector in (VELOCITY, POSITION) and vector[0] in names:
                out |= {vector[0]: x[vector[1]], vector[1]: x[vector[0]]}
        if "psi" in names:
            out["psi"] = np.angle(np.exp(1j * (turn - x["psi"])))
        return out

    return Mangled(words, names, apply)


def _quarter(x: Columns) -> Columns:
    """Return columns on a ground turned by a quarter: nothing shows where north is when all axes are unknown."""
    out = {**x, "psi": np.angle(np.exp(1j * (x["psi"] + 0.5 * np.pi)))}
    for north, east in (VELOCITY[:2], POSITION[:2]):
        if north in x:
            out |= {north: -x[east], east: x[north]}
    return out


_TABLES: Final = tomllib.loads(study.data_text("lines.toml"))
_KNOT, _FOOT = FACTORS["kt"], FACTORS["ft"]
#: lines that one recorder wrote wrong together
TOGETHER: Final = (
    times("all angles and rates in degrees", 1.0 / DEGREE, *EULER, *RATES),
    times("heading and rates in degrees", 1.0 / DEGREE, "psi", *RATES),
    times("vn and ve in knots", 1.0 / _KNOT, "vn", "ve"),
    times("all speeds in knots", 1.0 / _KNOT, *VELOCITY, "V"),
    Mangled(
        "altitude in feet, climb in ft/min",
        ("altitude", "vd"),
        lambda x: {**x, "altitude": x["altitude"] / _FOOT, "vd": x["vd"] * 60.0 / _FOOT},
    ),
    times("all rates 10 % high", 1.1, *RATES),
    times("all rates 10 % low", 0.9, *RATES),
)
COMMON, OF_AIRCRAFT = (tuple(map(_mangled, _TABLES[key])) for key in ("common", "of_aircraft"))
_IMU, _NAVIGATION = (*RATES[1:], *SPECIFIC_FORCE[1:]), (*VELOCITY, "pn", "pe")
FRAMES: Final = (
    turned("rates left and up", *RATES[1:]),
    turned("forces left and up", *SPECIFIC_FORCE[1:]),
    turned("rates and forces left and up", *_IMU),
    turned("attitude of flu in enu", "theta", "psi", east=True),
    turned("velocity and position in enu", *_NAVIGATION, east=True),
    turned("z up", "vd"),
    turned("all in flu and enu", *_IMU, "theta", "psi", *_NAVIGATION, east=True),
    replace(turned("all in flu and nwu", *_IMU, "theta", "psi", *_NAVIGATION), shown=_quarter),
)
OF_ROTORCRAFT: Final = (
    times("motor 1 in percent", 100.0, "motor_1"),
    Mangled("motor 2 in pulses", ("motor_2",), lambda x: {**x, "motor_2": 1000.0 + 1000.0 * x["motor_2"]}),
)
#: kind of log -> variable -> column and unit
NAMES: Final[Mapping[str, Mapping[str, tuple[str, str]]]] = _TABLES["names"]
DIALECTS: Final = tuple(NAMES)


def flown(seed: int, winged: bool) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return time (n,), s, and what the sensors of a flight in wind and gusts measure, from before take-off on."""
    rng = np.random.default_rng(seed)
    name = AIRCRAFT if winged else str(rng.choice(ROTORCRAFT))
    text = load_vehicle(name).text
    if rng.random() < 0.5 and "[turbulence]" not in text:
        gust = f"= {{ intensity = {rng.uniform(0.3, 1.0):.2f}, length = 50.0 }}\n"
        passing = f"\n[turbulence]\nairspeed = {35.0 if winged else 5.0}\n"
        text += passing + "".join(f"{axis} {gust}" for axis in "uvw")
    inputs = _wing_inputs(rng) if winged else _rotor_inputs(rng)
    wind = (*rng.uniform(-6.0, 6.0, 2).tolist(), 0.0)
    maneuver = Maneuver.model_validate({"duration": DURATION, "rate": RATE, "wind": wind, "input": inputs})
    flight = simulate_flight(parse_vehicle(text, name), maneuver, seed=seed, name="flight")
    return _with_ground(flight, rng)


def _wing_inputs(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Draw maneuvers about all axes, and a turn."""
    side = float(rng.choice((-1.0, 1.0)))
    bank = side * rng.uniform(0.03, 0.06)

    def steps(control: str, start: float, step: float, size: float) -> dict[str, Any]:
        shape, sign = str(rng.choice(("doublet", "3-2-1-1"))), float(rng.choice((-1.0, 1.0)))
        amplitude = sign * size * float(rng.uniform(0.7, 1.2))
        return {"control": control, "shape": shape, "start": start, "step": step, "amplitude": amplitude}

    turn = {
        "control": "aileron",
        "shape": "levels",
        "start": 9.0,
        "levels": (bank, 0.0, -bank),
        "lengths": (1.5, 32.0, 1.5),
    }
    return [
        steps("elevator", 4.5, 0.3, 0.12), turn, steps("rudder", 16.0, 0.6, 0.12), steps("elevator", 46.0, 0.4, 0.10),
        steps("aileron", 50.0, 0.4, 0.10), steps("rudder", 54.0, 0.5, 0.12),
    ]  # fmt: skip


def _rotor_inputs(rng: np.random.Generator) -> list[dict[str, Any]]:
    """Draw steps of velocity and of heading, and doublets about all axes."""

    def steps(control: str, start: float, step: float, size: float) -> dict[str, Any]:
        amplitude = float(rng.choice((-1.0, 1.0)) * size * rng.uniform(0.7, 1.2))
        return {"control": control, "shape": "doublet", "start": start, "step": step, "amplitude": amplitude}

    return [
        steps("north", 2.0, 4.0, 4.0), steps("east", 12.0, 4.0, 4.0), steps("roll", 22.0, 0.15, 12.0),
        steps("pitch", 26.0, 0.15, 12.0), steps("yaw", 30.0, 0.4, 1.5), steps("down", 36.0, 3.0, 2.0),
        steps("heading", 44.0, 4.0, 0.8),
    ]  # fmt: skip


def _with_ground(flight: Flight, rng: np.random.Generator) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Put time on the ground before a flight: sensors at rest, an estimator that holds zeros and then stands."""
    size, zeros = round(GROUND * RATE), round(ZEROS * RATE)
    data = {str(n): flight.column(str(n)) for n in flight.channels if not str(n).startswith("q") or n == "q"}
    data["altitude"] = data["altitude"] - data["altitude"][0] + 150.0
    out = {}
    for name, x in data.items():
        noise = np.diff(x, 2)
        scatter = float(np.median(np.abs(noise))) * 0.6
        rest = np.zeros(size)
        if name in (*RATES, *SPECIFIC_FORCE, "V", "alpha", "beta"):
            rest = rest + scatter * rng.standard_normal(size) - STANDARD_GRAVITY * (name == "az")
        elif name in (*EULER, *VELOCITY, "pn", "pe", "pd"):
            rest[zeros:] = 0.1 * scatter * rng.standard_normal(size - zeros)
        elif name == "altitude":
            rest = rest + 150.0
        out[name] = np.concatenate([rest, x])
    return np.arange(size + flight.time.size) / RATE, out


def write_log(
    folder: Path, dialect: str, time: FloatArray, columns: Columns
) -> tuple[Path, dict[str, tuple[str, str]]]:
    """Write a log of a kind; return its path, and the column and unit of each variable."""
    known = {**NAMES[dialect], **{f"motor_{n}": (f"motor{n}", "1") for n in range(1, 9)}}
    places = {name: known[name] for name in columns if name in known}
    table = {column: columns[name] / FACTORS[unit] for name, (column, unit) in places.items()}
    of_matlab = dialect == "MATLAB"
    return save({"t" if of_matlab else "t_s": time, **table}, folder, "mat" if of_matlab else "csv"), places


def save(table: Columns, folder: Path, kind: str) -> Path:
    """Write a table as a CSV or MATLAB file."""
    path = folder / f"log.{kind}"
    if kind == "mat":
        from scipy.io import savemat

        savemat(path, {n: x[:, None] for n, x in table.items()})
        return path
    np.savetxt(path, np.column_stack([*table.values()]), "%.9g", ",", header=",".join(table), comments="")
    return path


def mapping_text(dialect: str, places: Mapping[str, tuple[str, str]]) -> str:
    """Return the mapping that names and units of a log suggest."""
    return mapping_of(("t" if dialect == "MATLAB" else "t_s", "s"), places)


def mapping_of(clock: Sequence[str], rows: Mapping[str, Sequence[Any]]) -> str:
    """Return the mapping of variables by column, unit, scale and offset (SI); a scale of 1 and an offset of 0 are left out."""
    lines = ["[time]", f"column = {quoted(clock[0])}", f"unit = {quoted(clock[1])}", "", "[variables]"]
    for name, (column, unit, *more) in rows.items():
        given = [f"column = {quoted(column)}", f"unit = {quoted(unit)}"]
        usual = zip(("scale", "offset"), more, (1.0, 0.0), strict=False)
        given += [f"{key} = {value!r}" for key, value, neutral in usual if value != neutral]
        lines.append(f"{quoted_key(name)} = {{{', '.join(given)}}}")
    return "\n".join([*lines, ""])


def accusations(path: Path, mapping: Path | None) -> list[list[list[str]]]:
    """Return what `stoop info` says against a mapping: the lines of each edit of each finding."""
    try:
        flight = load_flight(path, mapping, LOG_GRID)
    except ContradictedError as error:
        return [[accused(error.notices[0])]]
    found = []
    for fault in flight.faults:
        if fault.kind in ("wrong unit", "wrong sign", "inconsistent"):
            text = str(fault.notice.values.get("suggestion", ""))
            rivals = [part for part in text.split(" or ")[1:] if "variables." in part]
            also = [
                [w.partition(".")[2].strip(",;") for w in r.split() if w.startswith("variables.")]
                for r in rivals
            ]
            found.append([accused(fault.notice), *also])
    return found


def accused(one: Notice) -> list[str]:
    """Return the lines that a notice accuses."""
    own = one.values.get("lines")
    return [str(name) for name in own] if isinstance(own, tuple) else [one.subject]


def verdict(found: Sequence[Sequence[Sequence[str]]], lines: Sequence[str]) -> str:
    """Return whether wrong lines were named: alone, among others that the data do not exclude, not, or another was."""
    if not found:
        return "silent"
    guilty = set(lines)
    first = [set(edit) for edit in found[0]]
    if first[0] & guilty and all(set(one[0]) & guilty for one in found):
        return "named" if all(edit & guilty for edit in first) else "ambiguous"
    return "ambiguous" if any(edit & guilty for edit in first) else "wrong"


def drafted(path: Path, columns: Columns, lines: Sequence[str]) -> dict[str, list[str]]:
    """Return what `stoop map` drafts wrong: with a doubt, and without one.

    A line is right when it reads what was measured, by column, unit and sign.
    """
    made = draft(path)
    doubted = {row.split(" = ")[0] for row in made.text.splitlines() if "# unsure" in row}
    wrong: dict[str, list[str]] = {"doubted": [], "sure": []}
    for name in misread(path, made.text, columns, lines):
        wrong["doubted" if name in doubted else "sure"].append(name)
    return wrong


def misread(
    path: Path, text: str, columns: Columns, lines: Iterable[str], tolerance: float = 1e-3
) -> list[str]:
    """Return the variables that a mapping does not read from a log as they were measured.

    Within a share of their range, and half a step of what the log holds.
    """
    entries = tomllib.loads(text).get("variables", {})
    if path.suffix == ".mat":
        table = dict(next(iter(logs.read(path).streams.values())).columns)
    else:
        with path.open() as file:
            names = file.readline().strip().split(",")
        table = dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    wrong = []
    for name in (one for one in lines if one in entries):
        entry = entries[name]
        unit = FACTORS[entry["unit"]] * entry.get("scale", 1.0)
        read = table[entry["column"]] * unit + entry.get("offset", 0.0)
        step = abs(unit) * float(np.min(np.diff(np.unique(table[entry["column"]])), initial=np.inf))
        apart = read - columns[name]
        if name == "psi":
            apart = np.angle(np.exp(1j * apart))
        near = tolerance * float(np.max(np.abs(columns[name]))) + (0.5 * step if np.isfinite(step) else 0.0)
        if np.max(np.abs(apart)) > near:
            wrong.append(name)
    return wrong


@study.work
def judge(case: str, seed: int, data: str = "") -> dict[str, Any]:
    """Write a flight as a log, and record what is said of its mapping."""
    if case == "real":
        return _real(seed, Path(data))
    rng = np.random.default_rng([seed, 7])
    winged, dialect = bool(rng.random() < 0.6), DIALECTS[seed % len(DIALECTS)]
    kinds = (*COMMON, *(OF_AIRCRAFT if winged else OF_ROTORCRAFT))
    if winged and rng.random() < 0.6:
        kinds = OF_AIRCRAFT
    time, truth = flown(seed, winged)
    kinds = {"frames": FRAMES, "together": TOGETHER}.get(case, kinds)
    mangled = kinds[int(rng.integers(len(kinds)))] if case != "clean" else times("right", 1.0)
    truth = {n: x for n, x in truth.items() if n != "pd"}
    of_radians = [n for n in mangled.lines if NAMES[dialect].get(n, ("", ""))[1] in ("rad", "rad/s")]
    if "in degrees" in mangled.words and of_radians:  # of several lines those that are not in degrees anyway
        mangled = times(mangled.words, 1.0 / DEGREE, *of_radians)
    elif "in degrees" in mangled.words and NAMES[dialect][mangled.lines[0]][1] == "deg":
        mangled = times(
            mangled.words.replace("in degrees", "in radians, declared deg"), DEGREE, *mangled.lines
        )
    with tempfile.TemporaryDirectory() as folder:
        path, places = write_log(Path(folder), dialect, time, mangled.apply(truth))
        mapping = Path(folder) / "m.toml"
        mapping.write_text(mapping_text(dialect, places))
        found = accusations(path, mapping)
        wrong = drafted(path, truth, mangled.lines or tuple(places))
        after = corrected_mapping(path, mapping)
        left = misread(path, after.text, mangled.shown(truth), places, CALIBRATED)
    said = verdict(found, mangled.lines) if case != "clean" else "accused" if found else "silent"
    vehicle = "aircraft" if winged else "multirotor"
    return {
        "words": mangled.words,
        "dialect": dialect,
        "vehicle": vehicle,
        "said": said,
        "found": found,
        "drafted": wrong,
        "left": left,
        "applied": len(after.applied),
    }


def _real(seed: int, folder: Path) -> dict[str, Any]:
    """Judge a real flight as if all lines of its ready mapping were the user's."""
    paths = real_flights(folder)
    if seed >= len(paths):
        return {"words": "", "dialect": "real", "vehicle": "", "said": "none", "found": [], "drafted": {}}
    path = paths[seed]
    found = accusations(path, None)
    if not found:
        flight = load_flight(path, rate=LOG_GRID)
        up = flight.in_flight()
        columns = {
            name: np.where(up, flight.column(name), np.nan)
            for name in flight.names
            if flight.sources[name].source != RECONSTRUCTED
        }
        own = {name: Line("", name, VARIABLES[name].unit) for name in columns}
        signals = {name: (flight.time, x) for name, x in columns.items()}
        judged = check_mapping(signals, columns, flight.rate, own)
        found = [[[one.subject]] for one in (*judged.refused, *judged.notices)]
    said = "accused" if found else "silent"
    return {
        "words": path.name,
        "dialect": "real",
        "vehicle": path.parent.name,
        "said": said,
        "found": found,
        "drafted": {},
    }


def real_flights(folder: Path) -> list[Path]:
    """Return the logs of the published flights."""
    names = (
        "altlnt-vtail-8kg-px4/flight2",
        "mit-solar-surfer-px4csv",
        "px4-ulog-reader-samples/sample_log_small.ulg",
    )
    single = [folder / name for name in names]
    found = [path for path in (*single, *sorted(folder.glob("crazypad*/*.usd"))) if path.exists()]
    if not found:
        raise StoopError("lines: the published flights are missing; name their folder by --data")
    return found


CASES: Final = ("mangled", "frames", "together", "clean", "real")
SAID: Final = (
    "named",
    "ambiguous",
    "wrong",
    "silent",
    "accused",
)  #: of wrong lines; of right ones silent or accused


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how often the wrong line was named, and what right flights were accused of."""
    mangled = [*samples["mangled"], *samples["frames"], *samples["together"]]
    clean = [r for case in ("clean", "real") for r in samples[case] if r["said"] != "none"]
    named = sum(r["said"] in ("named", "ambiguous") for r in mangled)
    alone, wrong = (sum(r["said"] == word for r in mangled) for word in ("named", "wrong"))
    accused = [r["words"] for r in clean if r["said"] != "silent"]
    sure = sum(bool(r["drafted"].get("sure")) for r in mangled)
    followed = [r for r in mangled if r["said"] == "named" and r["applied"]]
    right = sum(not r["left"] for r in followed)
    claims = [
        holds(
            "The wrong line is named in nine of ten mangled flights",
            named >= 0.9 * len(mangled),
            f"{named} of {len(mangled)}, {alone} of them alone; another line in {wrong}",
        ),
        holds(
            "Where a line is named alone, the flight is right once the advice is applied, in 95 %",
            right >= 0.95 * len(followed),
            f"{right} of {len(followed)}",
        ),
        holds("No right flight is accused", not accused, f"{len(accused)} of {len(clean)}"),
        holds(
            "stoop map drafts no wrong line without a doubt in nine of ten mangled flights",
            sure <= 0.1 * len(mangled),
            f"{sure} of {len(mangled)} with a wrong line that is not marked",
        ),
    ]
    records = [
        {
            **{key: r[key] for key in ("words", "vehicle", "dialect", "said")},
            "case": case,
            "draft": _draft_word(r["drafted"]),
            "followed": "" if not r.get("applied") else "wrong" if r["left"] else "right",
        }
        for case, results in samples.items()
        for r in results
        if r["said"] != "none"
    ]
    return Findings.of("Wrong lines of mappings", claims, records, summary=_summary(records))


def _summary(records: Sequence[Mapping[str, str]]) -> list[dict[str, str | int]]:
    """Return how many flights of each case and kind of vehicle were judged how, and how many advices were followed."""
    kinds = dict.fromkeys((r["case"], r["vehicle"] if r["case"] != "real" else "") for r in records)
    table: list[dict[str, str | int]] = []
    for case, vehicle in kinds:
        own = [r for r in records if r["case"] == case and (not vehicle or r["vehicle"] == vehicle)]
        counts = {word: sum(r["said"] == word for r in own) for word in SAID}
        drafts = {f"draft {word}": sum(r["draft"] == word for r in own) for word in ("doubted", "wrong")}
        followed = {
            f"followed, {word}": sum(r["followed"] == word for r in own) for word in ("right", "wrong")
        }
        table.append({"case": case, "vehicle": vehicle, "flights": len(own), **counts, **drafts, **followed})
    return table


def _draft_word(drafted: Mapping[str, Sequence[str]]) -> str:
    return "wrong" if drafted.get("sure") else "doubted" if drafted.get("doubted") else "right"


EXPERIMENT: Final = study.Verification("lines", show, runs=60, work="judge", cases=CASES, reads_data=True)

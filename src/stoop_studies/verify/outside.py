"""Flights of other people's models by recorders of other people, from log to model by the defaults alone.

A case is a vehicle of a simulator that nobody here made; a seed draws its maneuvers, wind, and the habits of a recorder. The log
goes through the verbs as a new user would use them. A third of vehicles and recorders is kept for one last run: seeds from
`ONCE` on fly these, and only these.
"""

from __future__ import annotations

import json
import re
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, cast
from zlib import crc32

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

import stoop
from stoop.base.arrays import FloatArray
from stoop.base.extras import install
from stoop.base.notices import Notice
from stoop.base.units import FACTORS
from stoop.base.variables import VARIABLES
from stoop.checks.vehicle import check_vehicle
from stoop.errors import StoopError
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.vehicle.checks import is_body
from stoop.workflow.fitted_model import FittedModel
from stoop_draft.mapping_corrections import contradictions, corrected_mapping
from stoop_draft.mapping_draft import draft
from stoop_studies.findings import Claim, Findings, Setting, counted, holds
from stoop_studies.verify import defaults, lines, outside_aircraft, outside_rotors, recorders, study, truths
from stoop_studies.verify.instruments import Defect
from stoop_studies.verify.made_up import MadeUp
from stoop_studies.verify.outside_aircraft import TABLES, OutsideFlight
from stoop_studies.verify.pilots import Columns

AIRCRAFT: Final = {n: outside_aircraft.Model(model=n, title=n, **row) for n, row in TABLES["jsbsim"].items()}
ROTORS: Final = {f"{of}_{name}": (of, name) for of, names in TABLES["rotors"].items() for name in names}
CASES: Final = (*AIRCRAFT, *ROTORS)
WIND: Final = 1.5  #: m/s, standard deviation of either component
INSTALL: Final = install("outside")
ONCE: Final = 1000  #: first seed of the last run
KNOWN: Final = ("J3Cub", "rotorpy_hummingbird")  #: before the zoo was


def kept(name: str) -> bool:
    """Whether a vehicle or a kind of log is among the third that only the last run flies."""
    return bool(np.random.default_rng([13, crc32(name.encode())]).random() < 1.0 / 3.0)


KEPT: Final = frozenset(c for c in CASES if kept(c) and c not in KNOWN)
KEPT_DIALECTS: Final = tuple(d for d in recorders.DIALECTS if kept(d))
PAIRS: Final = ((1, 2), (1, 3), (2, 4))  #: of motors that are exchanged
_ROWS: Final = (*lines.COMMON, *lines.OF_AIRCRAFT)
#: kind of a planted fault -> what is wrong
PLANTED: Final[Mapping[str, tuple[lines.Mangled, ...]]] = {
    "unit": tuple(m for m in _ROWS if " in " in m.words or "declared" in m.words),
    "sign": (*(m for m in _ROWS if m.words.startswith("sign")), lines.lost("aileron")),
    "frame": lines.FRAMES,
    "axis": tuple(m for m in _ROWS if "exchanged" in m.words),
    "order": tuple(lines.swap(f"{of}_{i}", f"{of}_{k}") for of in ("motor", "rotor") for i, k in PAIRS),
}
ARM: Final = 0.05  #: chords (arms), standard deviation of the accelerometer's place
FAR: Final = 6.0  #: standard errors
FINE: Final = 5e-4  #: s, of what was commanded
#: variables by which the same is read
EQUAL: Final = {"V": ("airspeed_pitot",), "control_throttle": ("throttle",), "altitude": ("pd",)}


def fly(case: str, seed: int) -> OutsideFlight:
    """Fly a vehicle; a `StoopError` says that it leaves its flight, or that the package of its simulator is missing."""
    rng = np.random.default_rng([52, crc32(case.encode()), seed])
    gusts = str(rng.choice(list(TABLES["gusts"])))
    try:
        if case in AIRCRAFT:
            return outside_aircraft.fly(AIRCRAFT[case], seed, gusts)
        return outside_rotors.fly(*ROTORS[case], seed, WIND * rng.standard_normal(2), gusts)
    except ModuleNotFoundError as error:
        why = f"outside: {case} needs the package {error.name}, which is not installed; {INSTALL}"
        raise StoopError(why) from None


def drawn(
    case: str, seed: int, tape: Mapping[str, float]
) -> tuple[recorders.Recorder, FloatArray, np.random.Generator]:
    """Return the recorder of a case and seed, the place (3,) of its accelerometer, m, and the generator of its noise."""
    rng = np.random.default_rng([53, crc32(case.encode()), seed])
    own = [d for d in recorders.DIALECTS if d not in KEPT_DIALECTS]
    dialects = own if seed < ONCE else recorders.DIALECTS if case in KEPT else KEPT_DIALECTS
    recorder = recorders.draw(rng, "chord" in tape, dialects)
    return recorder, ARM * tape.get("chord", 0.5 * tape["span"]) * rng.standard_normal(3), rng


def logged(
    case: str, seed: int, flight: OutsideFlight, folder: Path, mangled: lines.Mangled | None = None
) -> recorders.Log:
    """Write the log of a flight and the mapping that reads it right into a folder; ``mangled`` is what is wrong with it."""
    recorder, arm, rng = drawn(case, seed, flight.tape)
    log = recorders.write(flight, recorder, arm, folder, rng, mangled.apply if mangled else dict)
    (folder / "right.toml").write_text(log.mapping, encoding="utf-8")
    return log


def mapped(log: recorders.Log, folder: Path) -> tuple[Path, dict[str, list[str]]]:
    """Do `stoop map` and `stoop map --apply`; return the mapping to go on with, and what had to be edited in it by hand."""
    mapping = folder / "mapping.toml"
    mapping.write_text(draft(log.path).text, encoding="utf-8")
    wrong, own = ["all"], {}
    try:
        text = corrected_mapping(log.path, mapping).text
        mapping.write_text(text, encoding="utf-8")
        own = tomllib.loads(text).get("variables", {})
        free = scaled(log, own)
        wrong = min(
            (lines.misread(log.path, text, x, {*x} - free, lines.CALIBRATED) for x in turned(log.shown)),
            key=len,
        )
    except (StoopError, KeyError):
        pass
    known = {*log.lines, *sum(EQUAL.values(), ())}
    read = {own[n].get("column") for n in log.lines if n in own}
    edits = {
        "wrong": wrong, "missing": [n for n in log.lines if n not in own and not set(EQUAL.get(n, ())) & set(own)],
        "others": [n for n, one in own.items() if n not in known and one.get("column") not in read],
    }  # fmt: skip
    if any(edits.values()):
        mapping.write_text(log.mapping, encoding="utf-8")
    return mapping, edits


def scaled(log: recorders.Log, own: Mapping[str, Any]) -> set[str]:
    """Return the commands that a mapping reads of the right pulses about the right neutral ones.

    No log shows over which range a transmitter moves: a command in another unit, and what moves counts in that.
    """
    right, out = tomllib.loads(log.mapping)["variables"], set()
    for name in (n for n in right.keys() & own.keys() if VARIABLES[n].kind == "command"):
        both = own[name], right[name]
        scales, offsets = ([one.get(key, 0.0) for one in both] for key in ("scale", "offset"))
        same_column = len({one.get("column") for one in both}) == 1
        if same_column and min(scales) > 0.0 and np.isclose(*np.divide(offsets, scales)):
            out.add(name)
    return out


def turned(shown: Columns) -> Iterator[Columns]:
    """Yield what a log shows, with north in each of four directions: a flight is the same in all of them."""
    for k, (s, c) in enumerate(((0, 1), (1, 0), (0, -1), (-1, 0))):
        out = {"pd": -shown["altitude"], **shown} if "altitude" in shown else dict(shown)
        out |= {"psi": shown["psi"] + 0.5 * np.pi * k} if "psi" in shown else {}
        for n, e in (("vn", "ve"), ("pn", "pe")):
            if {n, e} <= shown.keys():
                out |= {n: c * shown[n] - s * shown[e], e: s * shown[n] + c * shown[e]}
        yield out


def planted(case: str, seed: int, flight: OutsideFlight, folder: Path) -> dict[str, Any]:
    """Make one thing of a line of a log wrong; return what is said of it, and what is left once the advice was followed."""
    rng, place = np.random.default_rng([55, crc32(case.encode()), seed]), folder / "planted"
    place.mkdir()
    sound = logged(case, seed, flight, place)
    able = {
        kind: [m for m in several if set(m.lines) <= set(sound.lines)] for kind, several in PLANTED.items()
    }
    able = {kind: several for kind, several in able.items() if several}
    kind = list(able)[seed % len(able)]
    mangled = able[kind][int(rng.integers(len(able[kind])))]
    unit = str(tomllib.loads(sound.mapping)["variables"][mangled.lines[0]]["unit"])
    if kind == "unit" and FACTORS[unit] != 1.0:  # the column holds SI
        words = f"{', '.join(mangled.lines)} in SI, declared {unit}"
        mangled = lines.times(words, FACTORS[unit], *mangled.lines)
    log, mapping = logged(case, seed, flight, place, mangled), place / "right.toml"
    told = contradictions(log.path, log.mapping, mapping)
    after = corrected_mapping(log.path, mapping)
    left = lines.misread(log.path, after.text, mangled.shown(log.shown), log.lines, lines.CALIBRATED)
    named, codes = lines.accusations(log.path, mapping), [(one.code, lines.accused(one)) for one in told]
    if kind == "order":  # a mapping says nothing of places
        known = stoop.load_flight(log.path, mapping)
        vehicle = drafted(flight, known)
        against = moments(vehicle, known)
        also, left = exchanged(vehicle, against, mangled.lines)
        named += also
        codes += [(one.code, own[0]) for one, own in zip(against, also, strict=True)]
    return {
        "kind": kind, "words": mangled.words, "said": lines.verdict(named, mangled.lines),
        "applied": len(after.applied), "left": " ".join(left),
        "codes": [[code, bool(set(own) & set(mangled.lines))] for code, own in codes],
    }  # fmt: skip


def drafted(flight: OutsideFlight, known: Flight) -> Vehicle:
    """Return the vehicle file that a user drafts from a log and a tape."""
    answers: dict[str, Any] = {**flight.tape, **flight.asked}
    return stoop.new_vehicle(known, **answers).vehicle


def moments(vehicle: Vehicle, flight: Flight) -> list[Notice]:
    """Return what the motion of a flight says against the rotors of a vehicle."""
    found = check_vehicle(vehicle, {flight.name: flight})
    return [one for one in found if one.code == "moments-contradicted"]


def exchanged(
    vehicle: Vehicle, told: Sequence[Notice], pair: Sequence[str]
) -> tuple[list[list[list[str]]], list[str]]:
    """Return the channels that each finding on the rotors accuses, and those that the first advice, followed, leaves wrong.

    `pair` are the two channels that were exchanged.
    """
    of = {f"rotor.{name}": rotor.channel for name, rotor in vehicle.file.rotor.items()}
    advice = [cast("tuple[str, ...]", one.values["alternatives"]) for one in told]
    named = [[[of[r] for r in re.findall(r"\[(rotor\.\w+)\]", text)] for text in own] for own in advice]
    written = re.findall(r'"(\w+)" in \[(rotor\.\w+)\]', advice[0][0] if advice else "")
    followed = of | {rotor: channel for channel, rotor in written}
    right = dict(zip(pair, reversed(pair), strict=True))
    return named, [c for rotor, c in of.items() if followed[rotor] != right.get(c, c)]


def record(case: str, seed: int, folder: Path) -> dict[str, Any]:
    """Fly, record and identify by the defaults.

    In the folder stay the log, ``right.toml`` (a mapping that reads it right), ``mapping.toml`` (the one that was used: drafted
    and applied, or the right one where it had to be edited), ``vehicle.toml``, ``result``, and ``record.json`` (what is returned:
    of each number its estimate, standard error, truth, whether it is at a bound, and whether the flight shows it).
    """
    flight = fly(case, seed)
    recorder, log = drawn(case, seed, flight.tape)[0], logged(case, seed, flight, folder)
    out: dict[str, Any] = {n: getattr(recorder, n) for n in ("dialect", "rate", "held")}
    out |= {"missing": list(recorder.missing), "planted": planted(case, seed, flight, folder), "stopped": ""}
    out["accused"] = [one.code for one in contradictions(log.path, log.mapping, folder / "right.toml")]
    began, worked = time.perf_counter(), time.process_time()
    mapping, out["edits"] = mapped(log, folder)
    try:
        known = stoop.load_flight(log.path, mapping)
        vehicle = drafted(flight, known)
        (folder / "vehicle.toml").write_text(vehicle.text, encoding="utf-8")
        job = defaults.identified(known, vehicle, folder / "result")
    except Exception as error:  # a traceback is a finding
        out["stopped"] = str(error) if isinstance(error, StoopError) else f"traceback: {error!r}"
    out |= {"seconds": time.perf_counter() - began, "processor": time.process_time() - worked}
    if not out["stopped"]:
        out["accused"] += [one.code for one in moments(vehicle, known)]
        out["refused_by"] = refusals(folder / "result" / "vehicle.toml")
        true = flown(case, seed, flight, log, job)
        out |= defaults.compared(true, job)
        # what the flight control does to a command has no number of its own, and what is no body has no moments of inertia
        without = (".lag",) * ("control_pitch" in log.lines) + (".inertia.",) * (
            not is_body(true.vehicle.vehicle)
        )
        numbers = outside_rotors.with_sum(out["numbers"], job.result.covariance)
        out["numbers"] = {n: row for n, row in numbers.items() if not any(part in n for part in without)}
    (folder / "record.json").write_text(json.dumps(out, indent=1), encoding="utf-8")
    return out


def flown(
    case: str, seed: int, flight: OutsideFlight, log: recorders.Log, job: FittedModel
) -> defaults.Flown:
    """Return a flight as `defaults` compares it: surfaces as they were when their commands were recorded."""
    recorder, arm, _ = drawn(case, seed, flight.tape)
    x, y, z = (arm / flight.tape.get("chord", 0.5 * flight.tape["span"])).tolist()
    sticks = "control_pitch" in log.lines
    true = flight.by_sticks() if sticks else dict(flight.columns)
    clock = np.arange(len(true["p"])) / flight.rate
    instants = log.start + clock
    # of what is not linear, the slopes and curvatures over what was flown there
    fitted = np.any([(instants >= w.start) & (instants <= w.stop) for w in job.windows()], axis=0)
    truth = flight.truth(job.vehicle, {n: x[fitted] for n, x in true.items()}, sticks)
    ahead = early(job, instants, true)
    # a receiver reads the last step of the simulation; a surface follows its stick in the next one
    gps = float(np.ceil(recorder.latency["gps"] * flight.rate - 1e-6)) / flight.rate
    late = {"velocity": gps, "commands": ahead + sticks / flight.rate}
    if "rotors.delay" in truth.rows:
        of = next(iter(truth.file.rotor.values())).channel.split("_")[0]
        steps = flight.late.get(of, 0.0) - 0.5 / flight.rate  # instead of the hold that `early` takes
        truth = truth.with_numbers({"rotors.delay": {"value": ahead + steps}})
    for surface in set(truth.controls) & set(true):
        moved = np.interp(clock + ahead, clock, true[surface])
        true[surface] = moved + truth.value(f"controls.{surface}.offset", 0.0)
    made = MadeUp(seed, flight.asked["template"], "csv", truth, {}, flight.tape)
    airspeed = float(np.mean(true["V"])) if "V" in true else 0.0
    defect = Defect("", delay=late, arm=(x, y, z))
    return defaults.Flown(made, log.path, case, "", defect, instants, true, airspeed)


def early(job: FittedModel, clock: FloatArray, true: Columns) -> float:
    """Return by how much the commands of a log, behind the lag that was estimated, are ahead of what moved, s.

    How a recorder samples, holds or interpolates a command, and what a flight control does to it, is all in the record.
    """
    file, flight = job.vehicle, job.flights[0]
    name = "elevator" if "elevator" in file.controls else next(c for c in file.inputs if c in true)
    own = truths.recorded_deflection(file, flight, name) if name in file.controls else flight.column(name)
    known, fine = np.isfinite(own), np.arange(clock[0], clock[-1], FINE)
    share = float(np.exp(-FINE / max(file.value(f"controls.{name}.lag", 0.0), FINE / 10.0)))
    behind = lfilter([1.0 - share], [1.0, -share], np.interp(fine, flight.time[known], own[known]))
    moved = true[name][np.searchsorted(clock, fine, "right") - 1]  # the simulator holds it over its step
    inside = slice(round(1.0 / FINE), -round(1.0 / FINE))

    def missed(delay: float) -> float:
        read = np.interp(fine[inside] - delay, fine, behind)
        return float(np.sum((np.polyval(np.polyfit(read, moved[inside], 1), read) - moved[inside]) ** 2))

    coarse = min(np.arange(-0.1, 0.5, 0.01), key=missed)
    box = (coarse - 0.01, coarse + 0.01)
    return float(minimize_scalar(missed, bounds=box, method="bounded", options={"xatol": 1e-6}).x)


def refusals(path: Path) -> list[str]:
    """Return which of the other verbs refuse a vehicle file that was written."""
    out = []
    for name, more in (("trim", {}), ("linearize", {}), ("derivatives", {"dimensional": True})):
        try:
            getattr(stoop, name)(stoop.load_vehicle(path), **more)
        except StoopError as error:
            out.append(f"{name}: {str(error).replace(str(path), path.name)}")
    return out


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it in a folder of its own; what is kept for the last run is not flown."""
    if seed < ONCE and case in KEPT:
        return {"kept": True}
    with tempfile.TemporaryDirectory(prefix="stoop-outside-") as folder:
        return record(case, seed, Path(folder))


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return the figures of each vehicle, flights, planted faults, and how often each notice was right."""
    rows = [{"case": c, **r} for c, records in samples.items() for r in records if "kept" not in r]
    table = [
        defaults.summary(c, own) | {"unedited": sum(map(unedited, own)), "accused": sum(bool(r["accused"]) for r in own)}
        for c in samples if (own := [r for r in rows if r["case"] == c])
    ]  # fmt: skip
    keys = ("case", "dialect", "rate", "held", "stopped", "grade", "method", "seconds")
    flights = [
        {**{k: r.get(k) for k in keys}, "edits": sum(map(len, r["edits"].values())),
         "refused": "; ".join(r.get("refused_by", ())), "right": None if r["stopped"] else defaults.right(r)}
        for r in rows
    ]  # fmt: skip
    faults = [
        {k: {**r, **r["planted"]}[k] for k in ("case", "kind", "words", "said", "applied", "left")}
        for r in rows
    ]
    said = [
        pair for r in rows for pair in (*r["planted"]["codes"], *((code, False) for code in r["accused"]))
    ]
    notices = [
        {"code": c, "times": sum(n == c for n, _ in said), "right": sum(hit for n, hit in said if n == c)}
        for c in sorted({n for n, _ in said})
    ]
    parts = {"flights": flights, "planted": faults, "notices": notices}
    return Findings.of("Flights of other people's models", list(_claims(table, rows)), table, parts)


def unedited(one: Mapping[str, Any]) -> bool:
    """Whether the mapping of a flight was right as it was drafted and applied."""
    return not any(one["edits"].values())


def _claims(table: Sequence[Mapping[str, Any]], rows: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    done, whole = [r for r in rows if not r["stopped"]], defaults.summary("all", rows)
    rms, lowest = whole["rms"] or np.inf, min((row["coverage"] or 0.0 for row in table), default=0.0)
    yield study.within("95 % intervals hold", (0.9, 0.98), whole["coverage"] or 0.0, f"of {whole['numbers']}")
    yield holds("No vehicle is below 75 %", lowest >= 0.75, f"the lowest {100 * lowest:.0f} %")
    yield holds("Root-mean-square error at most 1.3 standard errors", rms <= 1.3, f"{rms:.2f}")
    near = [
        r["grade"] == "do not use" or bool(np.all(np.abs(defaults.scores([r], "numbers")[0]) <= FAR))
        for r in done
    ]
    named = [r for r in rows if r["planted"]["said"] == "named"]
    asked = (
        (f"No number is {FAR:g} standard errors off unless the verdict refuses", 1.0, near),
        ("The verdict is right in 92 %", 0.92, [defaults.right(r) for r in done]),
        ("The wrong line is named in 95 %", 0.95, [r in named for r in rows]),
        ("Where the wrong line is named, the flight is right by the advice", 1.0, [not r["planted"]["left"] for r in named]),
        ("No sound flight is accused", 1.0, [not r["accused"] for r in rows]),
        ("Every written vehicle file is loaded by the other verbs", 1.0, [not r["refused_by"] for r in done]),
        ("Nothing is edited by hand in 90 %", 0.9, [unedited(r) for r in rows]),
        ("Log to report takes at most 60 s in 95 %", 0.95, [r["seconds"] <= 60.0 for r in rows]),
    )  # fmt: skip
    for words, share, held in asked:
        yield holds(words, sum(held) >= share * len(held), f"{counted(sum(held), len(held))} so")


EXPERIMENT: Final = study.Verification(
    "outside", show, runs=8, work="examine", cases=CASES, parts=("flights", "planted", "notices")
)

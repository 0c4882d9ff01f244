"""Flights of other people's models by recorders of other people, from log to model by the defaults alone.

A case is a vehicle of a simulator that nobody here made; a seed draws its maneuvers, wind, and the habits of a recorder. The log
goes through the verbs as a new user would use them. A third of vehicles and recorders is kept for one last run: seeds from
`ONCE` on fly these, and only these.
"""

from __future__ import annotations

import json
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.extras import install
from stoop.base.notices import Notice
from stoop.base.units import FACTORS
from stoop.errors import StoopError
from stoop.flight import load, without_faults
from stoop.flight.mapping_corrections import contradictions, corrected_mapping
from stoop.flight.mapping_draft import draft as draft_mapping
from stoop.input_design.windows import find_windows
from stoop.simulation import trim
from stoop.vehicle import Vehicle, load_vehicle
from stoop.vehicle_draft.draft import draft
from stoop.vehicle_draft.request import Request
from stoop.workflow.derivatives import derivatives
from stoop.workflow.flying import linearize
from stoop.workflow.identification import identify
from stoop_studies.findings import Claim, Findings, Setting, counted, holds
from stoop_studies.verify import defaults, lines, outside_aircraft, outside_rotors, recorders, study
from stoop_studies.verify.fleet import MadeUp
from stoop_studies.verify.instruments import Defect
from stoop_studies.verify.outside_aircraft import OutsideFlight
from stoop_studies.verify.pilots import Columns

_TABLES: Final = tomllib.loads(study.data_text("outside.toml"))
AIRCRAFT: Final = {name: outside_aircraft.Model(name=name, **row) for name, row in _TABLES["jsbsim"].items()}
ROTORS: Final[Mapping[str, tuple[str, str]]] = {
    f"{simulator}_{name}": (simulator, name)
    for simulator, names in _TABLES["rotors"].items()
    for name in names
}
CASES: Final = (*AIRCRAFT, *ROTORS)
GUSTS: Final = {
    "calm": 0.0,
    "light": 0.3,
    "moderate": 0.8,
}  #: m/s, standard deviation of those that multirotors fly in
WIND: Final = 1.5  #: m/s, standard deviation of either component
INSTALL: Final = install("outside")
ONCE: Final = 1000  #: first seed of the last run


def kept(name: str) -> bool:
    """Whether a vehicle or a kind of log is among the third that only the last run flies."""
    return bool(np.random.default_rng([13, crc32(name.encode())]).random() < 1.0 / 3.0)


KEPT: Final = frozenset(
    c for c in CASES if kept(c) and c not in ("J3Cub", "rotorpy_hummingbird")
)  # these two are known
KEPT_DIALECTS: Final = tuple(d for d in recorders.DIALECTS if kept(d))
#: kind of a planted fault -> what is wrong
PLANTED: Final[Mapping[str, tuple[lines.Mangled, ...]]] = {
    "unit": tuple(
        m for m in (*lines.COMMON, *lines.OF_AIRCRAFT) if " in " in m.words or "declared" in m.words
    ),
    "sign": tuple(
        m for m in (*lines.COMMON, *lines.OF_AIRCRAFT, lines.lost("aileron")) if m.words.startswith("sign")
    ),
    "frame": lines.FRAMES,
    "axis": tuple(m for m in (*lines.COMMON, *lines.OF_AIRCRAFT) if "exchanged" in m.words),
    "order": tuple(
        lines.swap(f"{of}_{i}", f"{of}_{k}") for of in ("motor", "rotor") for i, k in ((1, 2), (1, 3), (2, 4))
    ),
}
ARM: Final = 0.05  #: chords (arms), standard deviation of the accelerometer's place
FAR: Final = 6.0  #: standard errors
EQUAL: Final = {
    "V": ("airspeed_pitot",),
    "control_throttle": ("throttle",),
    "altitude": ("pd",),
}  #: variables by which the same is read


def fly(case: str, seed: int) -> OutsideFlight:
    """Fly a vehicle.

    Raises
    ------
    StoopError
        It leaves its flight, or the package of its simulator is not installed.
    """
    rng = np.random.default_rng([52, crc32(case.encode()), seed])
    gusts = str(rng.choice(list(GUSTS)))
    try:
        if case in AIRCRAFT:
            return outside_aircraft.fly(AIRCRAFT[case], seed, gusts)
        return outside_rotors.fly(*ROTORS[case], seed, WIND * rng.standard_normal(2), GUSTS[gusts])
    except ModuleNotFoundError as error:
        raise StoopError(
            f"outside: {case} needs the package {error.name}, which is not installed; {INSTALL}"
        ) from None


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
    mapping.write_text(draft_mapping(log.path).text, encoding="utf-8")
    wrong, own = ["all"], {}
    try:
        text = corrected_mapping(log.path, mapping).text
        mapping.write_text(text, encoding="utf-8")
        own = tomllib.loads(text).get("variables", {})
        wrong = min(
            (lines.misread(log.path, text, x, x.keys(), lines.CALIBRATED) for x in turned(log.shown)), key=len
        )
    except (StoopError, KeyError):
        pass
    edits = {
        "wrong": wrong, "missing": [n for n in log.lines if n not in own and not set(EQUAL.get(n, ())) & set(own)],
        "others": [n for n in own if n not in log.lines and n not in sum(EQUAL.values(), ())],
    }  # fmt: skip
    if any(edits.values()):
        mapping.write_text(log.mapping, encoding="utf-8")
    return mapping, edits


def turned(shown: Columns) -> Iterator[Columns]:
    """Yield what a log shows, with north in each of four directions: a flight is the same in all of them."""
    for k in range(4):
        s, c = (0, 1, 0, -1)[k], (1, 0, -1, 0)[k]
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
    held = logged(case, seed, flight, place).lines
    kinds = {kind: [m for m in several if set(m.lines) <= set(held)] for kind, several in PLANTED.items()}
    able = [kind for kind, several in kinds.items() if several]
    kind = able[seed % len(able)]
    mangled = kinds[kind][int(rng.integers(len(kinds[kind])))]
    rows = tomllib.loads((place / "right.toml").read_text(encoding="utf-8"))["variables"]
    unit = str(rows[mangled.lines[0]]["unit"])
    if kind == "unit" and FACTORS[unit] != 1.0:  # the column holds SI
        words = f"{', '.join(mangled.lines)} in SI, declared {unit}"
        mangled = lines.times(words, FACTORS[unit], *mangled.lines)
    log, mapping = logged(case, seed, flight, place, mangled), place / "right.toml"
    told = [(one.code, _named(one)) for one in contradictions(log.path, log.mapping, mapping)]
    after = corrected_mapping(log.path, mapping)
    left = lines.misread(log.path, after.text, mangled.shown(log.shown), log.lines, lines.CALIBRATED)
    said = lines.verdict(lines.accusations(log.path, mapping), mangled.lines)
    codes = [[code, bool(named & set(mangled.lines))] for code, named in told]
    return {
        "kind": kind,
        "words": mangled.words,
        "said": said,
        "applied": len(after.applied),
        "left": " ".join(left),
        "codes": codes,
    }


def _named(one: Notice) -> set[str]:
    """Return the lines that a notice accuses."""
    own = one.values.get("lines")
    return set(map(str, own)) if isinstance(own, tuple) else {one.subject}


def record(case: str, seed: int, folder: Path) -> dict[str, Any]:
    """Fly, record and identify by the defaults.

    In the folder stay the log, ``right.toml`` (a mapping that reads it right), ``mapping.toml`` (the one that was used: drafted
    and applied, or the right one where it had to be edited), ``vehicle.toml``, ``result``, and ``record.json`` (what is returned:
    of each number its estimate, standard error, truth, whether it is at a bound, and whether the flight shows it).
    """
    out = _recorded(case, seed, folder)
    (folder / "record.json").write_text(json.dumps(out, indent=1), encoding="utf-8")
    return out


def _recorded(case: str, seed: int, folder: Path) -> dict[str, Any]:
    flight = fly(case, seed)
    (recorder, arm, _), log = drawn(case, seed, flight.tape), logged(case, seed, flight, folder)
    about: dict[str, Any] = {
        "dialect": recorder.dialect,
        "rate": recorder.rate,
        "held": recorder.held,
        "missing": list(recorder.missing),
    }
    about["accused"] = [one.code for one in contradictions(log.path, log.mapping, folder / "right.toml")]
    about["planted"] = planted(case, seed, flight, folder)
    began, worked = time.perf_counter(), time.process_time()
    mapping, about["edits"] = mapped(log, folder)
    try:
        known = load(log.path, mapping)
        request = Request(
            flight.asked["template"], flight.tape["mass"], flight.tape["span"], flight.tape.get("chord"),
            engine=flight.asked.get("engine"),
        )  # fmt: skip
        vehicle = draft(request, [known], case).vehicle
        (folder / "vehicle.toml").write_text(vehicle.text, encoding="utf-8")
        windows = find_windows({known.name: without_faults(known)}, vehicle)
        job = identify(vehicle, [known], windows.texts("fit"), windows.texts("validate"))
        job.save(folder / "result", overwrite=True)
    except Exception as error:  # a traceback is a finding
        stopped = str(error) if isinstance(error, StoopError) else f"traceback: {error!r}"
        spent = {"seconds": time.perf_counter() - began, "processor": time.process_time() - worked}
        return {**about, "stopped": stopped, **spent}
    about |= {
        "stopped": "",
        "seconds": time.perf_counter() - began,
        "processor": time.process_time() - worked,
        "refused_by": refusals(folder / "result" / "vehicle.toml"),
    }
    hold = 0.5 / recorder.rates["commands"] if recorder.held else 0.0  # by which rows that repeat it are late
    late = {"velocity": recorder.latency["gps"], "commands": recorder.latency["commands"] - hold}
    shares = arm / flight.tape.get("chord", 0.5 * flight.tape["span"])
    defect = Defect("", delay=late, arm=(float(shares[0]), float(shares[1]), float(shares[2])))
    compared = defaults.compared(flown(case, seed, flight, log, vehicle, defect), job)
    if "control_pitch" in log.lines:  # what the flight control does to a command has no number of its own
        compared["numbers"] = {n: row for n, row in compared["numbers"].items() if not n.endswith(".lag")}
    return {**about, **compared}


def flown(
    case: str, seed: int, flight: OutsideFlight, log: recorders.Log, file: Vehicle, defect: Defect
) -> defaults.Flown:
    """Return a flight as `defaults` compares it: surfaces as they were when their commands were recorded."""
    truth, true = flight.truth(file), dict(flight.columns)
    clock = np.arange(len(true["p"])) / flight.rate
    for surface in set(truth.controls) & set(true):
        at = clock + defect.delay["commands"]
        true[surface] = np.interp(at, clock, true[surface]) + truth.value(f"controls.{surface}.offset", 0.0)
    made = MadeUp(seed, flight.asked["template"], "csv", truth, {}, flight.tape)
    airspeed = float(np.mean(true["V"])) if "V" in true else 0.0
    return defaults.Flown(made, log.path, case, "", defect, log.start + clock, true, airspeed)


def refusals(path: Path) -> list[str]:
    """Return which of the other verbs refuse a vehicle file that was written."""
    try:
        vehicle = load_vehicle(path)
    except StoopError as error:
        return [f"load: {error}"]
    out = []
    about = partial(derivatives, dimensional=True)
    verbs: Mapping[str, Callable[[Vehicle], Any]] = {
        "trim": trim,
        "linearize": linearize,
        "derivatives": about,
    }
    for name, verb in verbs.items():
        try:
            verb(vehicle)
        except StoopError as error:
            out.append(f"{name}: {error}")
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
    flown = {c: [r for r in records if "kept" not in r] for c, records in samples.items()}
    table = [defaults.summary(case, records) | _extra(records) for case, records in flown.items() if records]
    every = [r for records in flown.values() for r in records]
    flights = [
        {"case": c, **{k: r.get(k) for k in ("dialect", "rate", "held", "stopped", "grade", "method", "seconds")},
         "edits": sum(map(len, r["edits"].values())), "refused": "; ".join(r.get("refused_by", ())),
         "right": None if r["stopped"] else defaults.right(r)}
        for c, records in flown.items() for r in records
    ]  # fmt: skip
    keys = ("kind", "words", "said", "applied", "left")
    faults = [
        {"case": c, **{k: r["planted"][k] for k in keys}} for c, records in flown.items() for r in records
    ]
    said = [
        (code, hit)
        for r in every
        for code, hit in (*r["planted"]["codes"], *((code, False) for code in r["accused"]))
    ]
    notices = [
        {"code": c, "times": sum(n == c for n, _ in said), "right": sum(hit for n, hit in said if n == c)}
        for c in sorted({n for n, _ in said})
    ]
    parts = {"flights": flights, "planted": faults, "notices": notices}
    return Findings.of("Flights of other people's models", list(_claims(table, every)), table, parts)


def _extra(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what `defaults.summary` does not count."""
    return {
        "unedited": sum(not any(r["edits"].values()) for r in records), "accused": sum(bool(r["accused"]) for r in records),
        "loaded": sum(not r["refused_by"] for r in records if not r["stopped"]),
    }  # fmt: skip


def _claims(table: Sequence[Mapping[str, Any]], every: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    done = [r for r in every if not r["stopped"]]
    whole = defaults.summary("all", every)
    share, rms = whole["coverage"] or 0.0, whole["rms"] or np.inf
    lowest = min((row["coverage"] or 0.0 for row in table), default=0.0)
    yield study.within("95 % intervals hold", (0.9, 0.98), share, f"of {whole['numbers']}")
    yield holds("No vehicle is below 75 %", lowest >= 0.75, f"the lowest {100 * lowest:.0f} %")
    yield holds("Root-mean-square error at most 1.3 standard errors", rms <= 1.3, f"{rms:.2f}")
    far = sum(
        bool(np.any(np.abs(defaults.scores([r], "numbers")[0]) > FAR))
        for r in done
        if r["grade"] != "do not use"
    )
    yield holds(
        f"No number is {FAR:g} standard errors off unless the verdict refuses",
        not far,
        counted(far, len(done)),
    )
    yield holds(
        "The verdict is right in 92 %", whole["right"] >= 0.92 * len(done), counted(whole["right"], len(done))
    )
    named = sum(r["planted"]["said"] == "named" for r in every)
    followed = [r for r in every if r["planted"]["said"] == "named"]
    mended = sum(not r["planted"]["left"] for r in followed)
    yield holds("The wrong line is named in 95 %", named >= 0.95 * len(every), counted(named, len(every)))
    yield holds(
        "A flight whose wrong line was named is right once the advice is applied",
        mended == len(followed),
        counted(mended, len(followed)),
    )
    accused = sum(bool(r["accused"]) for r in every)
    yield holds("No sound flight is accused", not accused, counted(accused, len(every)))
    loaded = sum(not r["refused_by"] for r in done)
    yield holds(
        "Every written vehicle file is loaded by the other verbs",
        loaded == len(done),
        counted(loaded, len(done)),
    )
    plain = sum(not any(r["edits"].values()) for r in every)
    yield holds("Nothing is edited by hand in 90 %", plain >= 0.9 * len(every), counted(plain, len(every)))
    quick = sum(r["seconds"] <= 60.0 for r in every)
    yield holds(
        "Log to report takes at most 60 s in 95 %", quick >= 0.95 * len(every), counted(quick, len(every))
    )


EXPERIMENT: Final = study.Verification(
    "outside", show, runs=8, work="examine", cases=CASES, parts=("flights", "planted", "notices")
)

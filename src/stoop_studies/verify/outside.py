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
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

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
from stoop_studies.verify import defaults, lines, outside_aircraft, outside_rotors, recorders, study
from stoop_studies.verify.fleet import MadeUp
from stoop_studies.verify.instruments import Defect
from stoop_studies.verify.outside_aircraft import OutsideFlight

_TABLES: Final = tomllib.loads(study.data_text("outside.toml"))
AIRCRAFT: Final = {name: outside_aircraft.Model(name=name, **row) for name, row in _TABLES["jsbsim"].items()}
ROTORS: Final[Mapping[str, tuple[str, str]]] = {
    f"{simulator}_{name}": (simulator, name) for simulator, names in _TABLES["rotors"].items() for name in names
}
CASES: Final = (*AIRCRAFT, *ROTORS)
GUSTS: Final = {"calm": 0.0, "light": 0.3, "moderate": 0.8}  #: m/s, standard deviation of those that multirotors fly in
WIND: Final = 1.5  #: m/s, standard deviation of either component
ONCE: Final = 1000  #: first seed of the last run
ARM: Final = 0.05  #: chords (arms), standard deviation of the accelerometer's place
EQUAL: Final = {"V": ("airspeed_pitot",), "control_throttle": ("throttle",)}  #: variables by which the same is read


def fly(case: str, seed: int) -> OutsideFlight:
    """Fly a vehicle."""
    rng = np.random.default_rng([52, CASES.index(case), seed])
    gusts = str(rng.choice(list(GUSTS)))
    if case in AIRCRAFT:
        return outside_aircraft.fly(AIRCRAFT[case], seed, gusts)
    return outside_rotors.fly(*ROTORS[case], seed, WIND * rng.standard_normal(2), GUSTS[gusts])


def logged(case: str, seed: int, folder: Path, mangle: Any = dict) -> tuple[OutsideFlight, recorders.Recorder, recorders.Log]:
    """Fly a case and write its log and the mapping that reads it right into a folder."""
    flight = fly(case, seed)
    rng = np.random.default_rng([53, CASES.index(case), seed])
    winged = "chord" in flight.tape
    recorder = recorders.draw(rng, winged)
    arm = ARM * flight.tape.get("chord", 0.5 * flight.tape["span"]) * rng.standard_normal(3)
    log = recorders.write(flight.columns, flight.rate, recorder, winged, arm, folder, rng, mangle)
    (folder / "right.toml").write_text(log.mapping, encoding="utf-8")
    return flight, recorder, log


def mapped(log: recorders.Log, folder: Path) -> tuple[Path, dict[str, list[str]]]:
    """Do `stoop map` and `stoop map --apply`; return the mapping to go on with, and what had to be edited in it by hand."""
    mapping = folder / "mapping.toml"
    mapping.write_text(draft_mapping(log.path).text, encoding="utf-8")
    wrong, own = ["all"], {}
    try:
        text = corrected_mapping(log.path, mapping).text
        mapping.write_text(text, encoding="utf-8")
        own = tomllib.loads(text).get("variables", {})
        wrong = lines.misread(log.path, text, log.shown, log.lines, lines.CALIBRATED)
    except (StoopError, KeyError):
        pass
    edits = {
        "wrong": wrong, "missing": [n for n in log.lines if n not in own and not set(EQUAL.get(n, ())) & set(own)],
        "others": [n for n in own if n not in log.lines and n not in sum(EQUAL.values(), ())],
    }  # fmt: skip
    if any(edits.values()):
        mapping.write_text(log.mapping, encoding="utf-8")
    return mapping, edits


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
    flight, recorder, log = logged(case, seed, folder)
    about = {"dialect": recorder.dialect, "rate": recorder.rate, "held": recorder.held, "missing": list(recorder.missing)}
    about["accused"] = [one.code for one in contradictions(log.path, log.mapping, folder / "right.toml")]
    began = time.perf_counter()
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
    except StoopError as error:
        return {**about, "stopped": str(error), "seconds": time.perf_counter() - began}
    about |= {"stopped": "", "seconds": time.perf_counter() - began, "refused_by": refusals(folder / "result" / "vehicle.toml")}
    late = {"velocity": recorder.latency["gps"], "commands": recorder.latency["commands"]}
    return {**about, **defaults.compared(flown(case, seed, flight, log, vehicle, Defect("", delay=late)), job)}


def flown(case: str, seed: int, flight: OutsideFlight, log: recorders.Log, file: Vehicle, defect: Defect) -> defaults.Flown:
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
    for verb in (trim, linearize, derivatives):
        try:
            verb(vehicle, **({"dimensional": True} if verb is derivatives else {}))
        except StoopError as error:
            out.append(f"{verb.__name__}: {error}")
    return out


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="stoop-outside-") as folder:
        return record(case, seed, Path(folder))

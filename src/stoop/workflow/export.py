"""Export in one call: a vehicle or an identification as files of another tool, all made before any is written."""

from __future__ import annotations

import importlib.util
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.files import check_targets, make_folder, write_files
from stoop.base.notices import notice
from stoop.base.variables import VARIABLES
from stoop.errors import SimulationError, StoopError
from stoop.exporters import (
    fmu,
    fmu_flight,
    gazebo_autopilots,
    gazebo_files,
    jsbsim_aircraft,
    matlab,
    rotorpy_flight,
    rotorpy_model,
)
from stoop.exporters.gazebo_flight import flown_alphas, fly_gazebo
from stoop.exporters.gazebo_model import gazebo_model, unsupported_rotor_numbers
from stoop.exporters.gazebo_wing import unsupported_wing_terms
from stoop.exporters.jsbsim_flight import (
    PLANET,
    Comparison,
    Host,
    Record,
    compare,
    file_name,
    frames_per_sample,
    jsbsim_readings,
    own_readings,
    relative_differences,
    without_turbulence,
)
from stoop.exporters.jsbsim_model import THRUST, channel
from stoop.exporters.matlab import ParameterCovariance
from stoop.exporters.reference_flight import (
    ReferenceFlight,
    reference_flight,
    reference_record,
    steady_start,
    with_restarts,
)
from stoop.exporters.sitl import autopilot_commands
from stoop.exporters.sitl_folders import BACKENDS, Backend, assumptions
from stoop.problem import Piece
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.report.models import EXPORT_PAGE, export_page
from stoop.results.result import Result
from stoop.simulation import Trim, trim
from stoop.simulation.linearize import held_numbers, left_out
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.vehicle.vehicle import leaves, slope_input
from stoop.workflow.outputs import RESULT, read_identified
from stoop.workflow.summary import refusal

NOT_FLOWN: Final = "Not flown: the package jsbsim is not installed; pip install 'stoop[jsbsim]'."

SLOPES: Final = (
    "The reaction of rotors without a lag to their spin-up is computed from the last step of JSBSim, so it is a step late "
    "({}); give rotors.lag to have it exactly."
)


@dataclass(frozen=True)
class Condition:
    """The steady flight: m/s (the vehicle's V* when absent), m (the flight's), rad."""

    airspeed: float | None = None
    altitude: float | None = None
    climb_angle: float = 0.0


DEFAULT: Final = Condition()


@dataclass(frozen=True, eq=False)
class Subject:
    """What is exported: a vehicle, and of an identification what is known of its numbers and its flight."""

    vehicle: Vehicle
    known: ParameterCovariance | None = None  #: its numbers' covariance
    maneuvers: tuple[Record, ...] = ()  #: of the flight that it was identified from
    altitude: float = 200.0  #: m
    density: float | None = None  #: kg/m3, of that flight
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Exported:
    """Files by their place below the output folder, the main one, and notes for the user."""

    files: Mapping[str, bytes]
    main: str
    notes: tuple[str, ...]


def read_subject(text: str) -> Subject:
    """Read a built-in vehicle, a vehicle file, or an identification: its folder or its ``result.json``.

    Raises `StoopError`: it is none of these, or damaged.
    """
    path = Path(text)
    if not (path.is_dir() or path.name == RESULT):
        vehicle, notices = without_turbulence(resolve_vehicle(text))
        return Subject(vehicle, notes=tuple(map(str, notices)))
    found = read_identified(path)
    vehicle, notices = without_turbulence(found.vehicle)
    notes = tuple(map(str, [*refusal(found.result, text), *notices]))
    covariance = found.result.covariance
    # What is known of the numbers that the vehicle has; those of its gusts are left with them.
    kept = [i for i, name in enumerate(covariance.names) if name in vehicle.rows]
    names = tuple(covariance.names[i] for i in kept)
    matrix = covariance.matrix[np.ix_(kept, kept)].copy()
    for i, name in enumerate(names):  # a standard error that is the prior's is no evidence of the flight
        if not found.result.parameters[name].identifiable:
            matrix[i], matrix[:, i] = np.nan, np.nan
            matrix[i, i] = np.inf
    known = ParameterCovariance(names, matrix) if kept else None
    windows = [Window(m.flight, m.start, m.stop, m.loading or None) for m in found.result.maneuvers]
    try:
        flights = found.flights()
        parts = [prepare(vehicle, flights, [window]).pieces for window in windows]
        maneuvers = tuple(
            _maneuver(vehicle, found.result, index, segment, piece)
            for index, pieces in enumerate(parts)
            for segment, piece in enumerate(pieces)
        )
    except StoopError as error:
        return Subject(vehicle, known, notes=(*notes, f"No comparison with the flight: {error}."))
    first, density = parts[0][0], None
    if "density" in vehicle.inputs:
        density = float(np.mean(first.inputs[:, vehicle.inputs.index("density")]))
    return Subject(vehicle, known, maneuvers, first.start["h"], density, notes)


def _maneuver(vehicle: Vehicle, result: Result, index: int, segment: int, piece: Piece) -> Record:
    """Put the estimated start and biases of a fitted maneuver in place of those that are read off the flight."""
    start = dict(piece.start)
    for initial in result.initial_states:
        if (initial.maneuver, initial.segment) == (index, segment):
            start |= {name: q.estimate for name, q in initial.values.items()}
    changes = {name: {"value": value} for name, value in piece.changes.items()}
    changes |= {
        f"sensors.{channel}.bias": {"value": q.estimate}
        for biases in result.biases
        if biases.maneuver == index
        for channel, q in biases.values.items()
    }
    flown = result.maneuvers[index]
    span = f"{piece.time[0]:.2f} to {piece.time[-1]:.2f} s"
    title = f"{flown.flight}, {span} ({'fitted' if flown.role == 'fit' else 'predicted'})"
    vehicle = vehicle.with_numbers(changes)
    return Record(vehicle, start, piece.time, piece.inputs, title, piece.measured, bool(piece.changes))


def export(subject: Subject, target: str, condition: Condition = DEFAULT) -> Exported:
    """Make the files of a target.

    Raises `StoopError`: the vehicle cannot be exported so, or no steady flight is found.
    """
    return TARGETS[target](subject, condition)


def write(exported: Exported, folder: Path, overwrite: bool = False) -> None:
    """Write the files, all or none.

    Raises `OutputError`: a file is there already, or the folder cannot be written.
    """
    check_targets(folder, tuple(exported.files), overwrite)
    make_folder(folder)
    write_files(folder, exported.files)


def steady(subject: Subject, condition: Condition) -> Trim:
    """Return the steady flight of a condition."""
    altitude = subject.altitude if condition.altitude is None else condition.altitude
    return trim(subject.vehicle, condition.airspeed, altitude, condition.climb_angle, subject.density)


def _jsbsim(subject: Subject, condition: Condition) -> Exported:
    """Return the aircraft, and the page of how it flies; without a steady flight there is no start to give."""
    vehicle, notes = subject.vehicle, list(subject.notes)
    # The properties that drive the aircraft are what a session with JSBSim sets.
    driving = {channel(n): VARIABLES[n].unit if n in VARIABLES else "1" for n in vehicle.recorded}
    if vehicle.file.propulsion is not None and vehicle.file.propulsion.kind == "constant":
        driving[THRUST] = "N"
    if driving:
        named = [place if unit == "1" else f"{place} ({unit})" for place, unit in driving.items()]
        notes.append(f"To be set in flight: {', '.join(named)}.")
    if vehicle.sloped:
        notes.append(SLOPES.format(", ".join(vehicle.sloped)))
    try:
        point = steady(subject, condition)
    except SimulationError as error:
        point = None
        notes.append(f"No start and no script: {error}.")
    texts = jsbsim_aircraft.folder(vehicle, None if point is None else steady_start(vehicle, point))
    name = file_name(vehicle.name)
    aircraft = f"aircraft/{name}/{name}.xml"
    if importlib.util.find_spec("jsbsim") is None:
        return Exported(_encoded(texts), aircraft, (*notes, NOT_FLOWN))
    # The files are flown before they are written where the user wants them; another loading is exported with its maneuver.
    maneuvers = [with_restarts(maneuver) for maneuver in subject.maneuvers]
    record = None if point is None else reference_record(vehicle, point)
    if record is not None:
        maneuvers.insert(0, record)
    flown: list[Comparison] = []
    for maneuver in maneuvers:
        loaded = jsbsim_aircraft.folder(maneuver.vehicle, None) if maneuver.loaded else texts
        with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
            write_files(Path(root), loaded)
            try:
                flown.append(compare(Path(root), maneuver))
            except SimulationError as error:  # the model cannot hold it open loop; the others are flown
                notes.append(f"{maneuver.title}: {error}.")
    page = export_page(vehicle, texts[aircraft], name, flown, notes)
    return Exported(_encoded({**texts, EXPORT_PAGE: page}), EXPORT_PAGE, (*notes, *map(str, flown)))


def _sitl(backend: Backend, subject: Subject, condition: Condition) -> Exported:
    """Return the folder of an autopilot, flown in JSBSim by the properties that the autopilot writes."""
    notes = _notes(subject)
    altitude = subject.altitude if condition.altitude is None else condition.altitude
    commands = autopilot_commands(subject.vehicle, condition.airspeed, altitude, subject.density)
    texts, aircraft = backend.folder(commands)
    notes += assumptions(commands)
    out = Exported(_encoded(texts), "README.md", ())
    if importlib.util.find_spec("jsbsim") is None:
        return replace(out, notes=(*notes, NOT_FLOWN))
    name = Path(aircraft).stem
    planet = jsbsim_aircraft.flat_planet(commands.vehicle.value("environment.gravity"))
    steady_flights = (commands.wings, commands.hover if backend.rotors else None)
    for point in steady_flights:
        record = None if point is None else reference_record(commands.vehicle, point)
        if record is None:
            continue
        with tempfile.TemporaryDirectory(prefix="stoop-export-") as folder:
            root = Path(folder)
            write_files(root, {f"aircraft/{name}/{name}.xml": texts[aircraft], PLANET: planet})
            hosts = (
                (root / PLANET, Host(to_commands=commands.settings)),
                (None, Host(backend.rate, {}, commands.settings)),
            )
            flown = [jsbsim_readings(root, name, record, place, host) for place, host in hosts]
        own = own_readings(record)
        exact, theirs = (max(relative_differences(record.vehicle, own, y).values()) for y in flown)
        notes.append(
            f"{record.title}, by the properties that {backend.title} writes: JSBSim within {exact:.1e} of each channel's "
            f"maximum; with {frames_per_sample(record.dt, backend.rate) / record.dt:g} steps per second ({backend.title} "
            f"takes {backend.rate:g}), Euler's method for rotation and the round Earth {theirs:.1e}."
        )
    return replace(out, notes=tuple(notes))


def _state_space(subject: Subject, condition: Condition) -> Exported:
    """Return A, B, C, D as JSON and as ``.mat``."""
    found = matlab.state_space(subject.vehicle, steady(subject, condition), subject.known)
    name = file_name(subject.vehicle.name)
    files = {
        f"{name}.json": matlab.json_text(found).encode("utf-8"),
        f"{name}.mat": matlab.mat_bytes(matlab.variables(found)),
    }
    return Exported(files, f"{name}.json", (*subject.notes, *map(str, left_out(subject.vehicle))))


def _simulink(subject: Subject, condition: Condition) -> Exported:
    """Return MATLAB functions, the script that builds a Simulink model, and the numbers."""
    vehicle, point = subject.vehicle, steady(subject, condition)
    found = matlab.matlab(vehicle, point, matlab.state_space(vehicle, point, subject.known))
    files = _encoded(found.texts) | {f"{found.name}.mat": matlab.mat_bytes(found.variables)}
    actuators = held_numbers(vehicle, ("dead_zone", "rate_limit", "delay"))
    notes = [notice("functions-without-actuators", numbers=actuators)] if actuators else []
    if vehicle.sloped:  # who gives the slopes that spin rotors up
        notes.append(notice("slopes-of-channels", channels=tuple(map(slope_input, vehicle.sloped))))
    notes += left_out(vehicle)
    return Exported(files, f"{found.name}_simulink.m", (*subject.notes, *map(str, notes)))


def _fmu(subject: Subject, condition: Condition) -> Exported:
    """Return units of both versions of the interface, flown by FMPy where it is installed."""
    vehicle, point = subject.vehicle, steady(subject, condition)
    made, compiler = fmu.make_unit(vehicle, point, subject.known), fmu.find_compiler()
    name = file_name(vehicle.name)
    files = {f"{name}-fmi{v[0]}.fmu": fmu.unit_bytes(made, v, compiler) for v in fmu.VERSIONS}
    notes, actuators = _notes(subject), held_numbers(vehicle, ("dead_zone", "rate_limit", "delay"))
    if actuators:
        notes.append(str(notice("functions-without-actuators", numbers=actuators)))
        notes += cost_without_actuators(subject)
    if compiler is None:
        notes.append("The units hold sources only, no C compiler was found: fmpy compile NAME.fmu")
    elif not fmu_flight.installed():
        notes.append(f"Not flown: the package fmpy is not installed; {fmu_flight.INSTALL}.")
    elif (flight := _reference(vehicle, point, notes)) is not None:
        with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
            write_files(Path(root), files)
            for version, place in zip(fmu.VERSIONS, files, strict=True):
                found = flight.differences(fmu_flight.fly_unit(Path(root) / place, flight))
                notes.append(f"FMI {version} in FMPy, {_agreement(flight, found)}.")
    return Exported(files, f"{name}-fmi3.fmu", tuple(notes))


def _rotorpy(subject: Subject, condition: Condition) -> Exported:
    """Return RotorPy's parameters and the script with both vehicles, flown by RotorPy where it is installed."""
    vehicle, point = subject.vehicle, steady(subject, condition)
    made, notes = rotorpy_model.rotorpy_model(vehicle, point), _notes(subject)
    files, script = _encoded(made.texts), f"{made.name}_rotorpy.py"
    actuators = held_numbers(vehicle, ("dead_zone", "rate_limit", "delay"))
    if actuators:
        notes.append(f"RotorPy has no {', '.join(actuators)}: give it channels as rotors receive them.")
        notes += cost_without_actuators(subject)
    flight = _reference(vehicle, point, notes)
    if flight is None:
        return Exported(files, script, tuple(notes))
    for name, (share, channel_name) in rotorpy_flight.costs(flight, rotorpy_model.limits(vehicle)).items():
        notes.append(
            f"RotorPy's own model has no {name}: {100.0 * share:.2g} % of {channel_name} (rms over the compared flight)."
        )
    if not rotorpy_flight.installed():
        notes.append(f"Not flown: the package rotorpy is not installed; {rotorpy_flight.INSTALL}.")
        return Exported(files, script, tuple(notes))
    with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
        write_files(Path(root), files)
        module = rotorpy_flight.load_script(Path(root) / script)
        ours = rotorpy_flight.motion(rotorpy_flight.held_flight(flight))
        for title, stock in (("the identified equations", False), ("RotorPy's own model", True)):
            found = rotorpy_flight.differences(ours, rotorpy_flight.fly_rotorpy(module, flight, stock))
            notes.append(f"RotorPy with {title}, {_agreement(flight, found)}.")
    return Exported(files, script, tuple(notes))


def _gazebo(subject: Subject, condition: Condition) -> Exported:
    """Return models for PX4 and ArduPilot in Gazebo, flown by the equations of its systems."""
    notes, reduced = _notes(subject), subject.vehicle.reduce
    if reduced != "full":
        subject = replace(subject, vehicle=subject.vehicle.reduced("full"))
        notes.append(
            f"The equations of the fit are {reduced}; the models have all six degrees of freedom, the others with the "
            "numbers of the vehicle file."
        )
    vehicle, point, alphas = subject.vehicle, steady(subject, condition), flown_alphas(subject.maneuvers)
    made = {
        title: gazebo_model(vehicle, point, alphas, title == "ArduPilot") for title in ("PX4", "ArduPilot")
    }
    px4 = made["PX4"]
    actuators = held_numbers(vehicle, ("dead_zone", "rate_limit", "delay"))
    if actuators:
        notes.append(f"Not exported: {', '.join(actuators)}.")
        notes += cost_without_actuators(subject)
    for start, unsupported in ((px4.hover, unsupported_rotor_numbers), (px4.cruise, unsupported_wing_terms)):
        flight = None if start is None else _reference(vehicle, start, notes)
        if flight is None:
            continue
        for name, (share, channel_name) in rotorpy_flight.costs(flight, unsupported(vehicle)).items():
            notes.append(
                f"Gazebo omits {name} or keeps only its slope at the steady flight; the term is {100.0 * share:.2g} % of "
                f"{channel_name} (rms over the compared flight)."
            )
        ours = rotorpy_flight.motion(flight)
        for title, model in made.items():
            found = rotorpy_flight.differences(ours, fly_gazebo(model, flight))
            notes.append(f"Gazebo's equations for {title}, {_agreement(flight, found)}.")
    notes += gazebo_autopilots.notes(made["ArduPilot"])
    files = gazebo_files.folders(px4, made["ArduPilot"])
    return Exported(_encoded(files), f"{px4.name}/model.sdf", tuple(notes))


def _notes(subject: Subject) -> list[str]:
    """Return the notes of a subject, and which of its numbers the flight does not determine."""
    lost = () if subject.known is None else subject.known.not_identified
    more = (
        [f"Not identified by the flight: {', '.join(lost)}; these numbers are the vehicle file's."]
        if lost
        else []
    )
    return [*subject.notes, *more]


def _reference(vehicle: Vehicle, point: Trim, notes: list[str]) -> ReferenceFlight | None:
    """Return a flight to compare with; None, with a note, where there is none."""
    try:
        flight = reference_flight(vehicle, point)
    except SimulationError as error:
        notes.append(f"Not flown: {error}.")
        return None
    if flight is None:
        notes.append("Not flown: the open loop diverges within 3 s.")
    return flight


def _agreement(flight: ReferenceFlight, found: Mapping[str, float]) -> str:
    worst = max(found, key=lambda name: found[name])
    return f"{flight.title}: within {found[worst]:.1e} of each channel's maximum ({worst})"


def cost_without_actuators(subject: Subject) -> list[str]:
    """Return how far the fitted maneuvers move where dead zones, rate limits and delays are left out, one line each."""
    notes = []
    for maneuver in subject.maneuvers:
        own = {n: {"value": neutral} for n, neutral in _without_actuators(maneuver.vehicle).items()}
        try:
            whole = own_readings(maneuver)
            less = own_readings(replace(maneuver, vehicle=maneuver.vehicle.with_numbers(own)))
        except SimulationError as error:
            notes.append(f"{maneuver.title}: {error}.")
            continue
        shares = relative_differences(maneuver.vehicle, whole, less)
        worst = max(shares, key=lambda name: shares[name])
        notes.append(
            f"{maneuver.title}: without them readings move by up to {100.0 * shares[worst]:.2g} % of a channel's "
            f"maximum ({worst})."
        )
    return notes


def _without_actuators(vehicle: Vehicle) -> dict[str, float]:
    """Return the numbers of dead zones, rate limits and delays, and values at which they do nothing."""
    idle, own = {"dead_zone": 0.0, "rate_limit": math.inf, "delay": 0.0}, dict(leaves(vehicle.file))
    untied = [n for n in vehicle.rows if n in own and own[n].tie is None]  # the others follow
    return {n: idle[end] for n in untied if (end := n.rpartition(".")[2]) in idle}


def _encoded(texts: Mapping[str, str]) -> dict[str, bytes]:
    return {place: text.encode("utf-8", errors="replace") for place, text in texts.items()}


TARGETS: Final[Mapping[str, Callable[[Subject, Condition], Exported]]] = {
    "jsbsim": _jsbsim,
    **{target: partial(_sitl, backend) for target, backend in BACKENDS.items()},
    "state-space": _state_space,
    "simulink": _simulink,
    "fmu": _fmu,
    "rotorpy": _rotorpy,
    "gazebo": _gazebo,
}

"""Export in one call: files of another tool, all made before any is written."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from stoop.base.files import write_bytes_atomic
from stoop.errors import OutputError, SimulationError
from stoop.export import jsbsim_aircraft, simulink, state_space
from stoop.export.jsbsim_model import THRUST, channel
from stoop.export.record import excitation_record, file_name, steady_record
from stoop.flight import VARIABLES
from stoop.simulate import Trim, trim
from stoop.simulate.linearize import left_out
from stoop.vehicle import Vehicle
from stoop.vehicle.vehicle import slope_input
from stoop.workflow.export_page import PAGE, Comparison, compare, page_text, verdict
from stoop.workflow.export_subject import Maneuver, Subject

NOT_FLOWN: Final = "Not flown: the package jsbsim is not installed; pip install 'stoop[jsbsim]'."


@dataclass(frozen=True)
class Condition:
    """The steady flight: m/s (the vehicle's V* when absent), m (the flight's), rad."""

    airspeed: float | None = None
    altitude: float | None = None
    climb_angle: float = 0.0


DEFAULT: Final = Condition()


@dataclass(frozen=True)
class Exported:
    """Files by their place below the output folder, the main one, and what to tell the user."""

    files: Mapping[str, bytes]
    main: str
    notes: tuple[str, ...]


def export(subject: Subject, target: str, condition: Condition = DEFAULT) -> Exported:
    """Make the files of a target.

    Parameters
    ----------
    subject : Subject
        See :func:`stoop.workflow.export_subject.read_subject`.
    target : str
        One of :data:`TARGETS`.
    condition : Condition

    Raises
    ------
    StoopError
        The vehicle cannot be exported so, or no steady flight is found.
    """
    return TARGETS[target](subject, condition)


def write(exported: Exported, folder: Path, overwrite: bool = False) -> None:
    """Write the files, each whole or not at all.

    Raises
    ------
    OutputError
        A file is there already, or the folder cannot be written.
    """
    check(folder, exported, overwrite)
    _place(folder, exported.files)


def _place(folder: Path, files: Mapping[str, bytes]) -> None:
    for place, content in files.items():
        path = folder / place
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"{path.parent}: cannot be made ({error.strerror}); choose another folder"
            ) from None
        write_bytes_atomic(path, content)


def check(folder: Path, exported: Exported, overwrite: bool) -> None:
    """Refuse a folder that holds one of the files already."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder with -o")
    there = next((folder / place for place in exported.files if (folder / place).exists()), None)
    if there is not None and not overwrite:
        raise OutputError(f"{there}: exists already; add --overwrite or name another folder")


def _steady(subject: Subject, condition: Condition) -> Trim:
    altitude = subject.altitude if condition.altitude is None else condition.altitude
    return trim(subject.vehicle, condition.airspeed, altitude, condition.climb_angle, subject.density)


def _jsbsim(subject: Subject, condition: Condition) -> Exported:
    """Return the aircraft, and the page of how it flies; without a steady flight there is no start to give."""
    vehicle, notes = subject.vehicle, [*subject.notes, *_inputs(subject.vehicle)]
    try:
        point = _steady(subject, condition)
    except SimulationError as error:
        point = None
        notes.append(f"No start and no script: {error}.")
    steady = None if point is None else steady_record(vehicle, point)
    texts = jsbsim_aircraft.folder(vehicle, steady)
    name = file_name(vehicle.name)
    aircraft = f"aircraft/{name}/{name}.xml"
    if importlib.util.find_spec("jsbsim") is None:
        return Exported(_encoded(texts), aircraft, (*notes, NOT_FLOWN))
    flown, failed = _flown(subject, point, texts)
    notes += failed
    page = page_text(vehicle, texts[aircraft], name, flown, notes)
    return Exported(_encoded({**texts, PAGE: page}), PAGE, (*notes, *map(verdict, flown)))


def _inputs(vehicle: Vehicle) -> list[str]:
    """Return the properties that drive the aircraft, as a note: what a session with JSBSim sets."""
    known = {channel(name): VARIABLES[name].unit if name in VARIABLES else "1" for name in vehicle.recorded}
    if vehicle.file.propulsion is not None and vehicle.file.propulsion.kind == "constant":
        known[THRUST] = "N"
    named = [place if unit == "1" else f"{place} ({unit})" for place, unit in known.items()]
    return [f"To be set in flight: {', '.join(named)}."] if named else []


def _flown(
    subject: Subject, point: Trim | None, texts: Mapping[str, str]
) -> tuple[list[Comparison], list[str]]:
    """Fly the files before they are written where the user wants them; one with another loading is exported with that.

    A maneuver that the model cannot hold open loop is a note, and the others are flown.
    """
    out: list[Comparison] = []
    failed: list[str] = []
    for maneuver in (*_excited(subject, point), *subject.maneuvers):
        loaded = jsbsim_aircraft.folder(maneuver.record.vehicle, None) if maneuver.loaded else texts
        with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
            _place(Path(root), _encoded(loaded))
            try:
                out.append(compare(Path(root), maneuver))
            except SimulationError as error:
                failed.append(f"{maneuver.title}: {error}.")
    return out, failed


def _excited(subject: Subject, point: Trim | None) -> list[Maneuver]:
    record = None if point is None else excitation_record(subject.vehicle, point)
    if record is None:
        return []
    span = record.time[-1] - record.time[0]
    return [Maneuver(f"{span:g} s open loop from the steady flight, every control in turn", record)]


def _state_space(subject: Subject, condition: Condition) -> Exported:
    """Return A, B, C, D as JSON and as ``.mat``."""
    found = state_space.state_space(subject.vehicle, _steady(subject, condition), subject.known)
    name = file_name(subject.vehicle.name)
    files = {
        f"{name}.json": state_space.json_text(found).encode("utf-8"),
        f"{name}.mat": state_space.mat_bytes(state_space.variables(found)),
    }
    return Exported(files, f"{name}.json", (*subject.notes, *left_out(subject.vehicle)))


def _simulink(subject: Subject, condition: Condition) -> Exported:
    """Return MATLAB functions, the script that builds a Simulink model, and the numbers."""
    point = _steady(subject, condition)
    found = simulink.matlab(
        subject.vehicle, point, state_space.state_space(subject.vehicle, point, subject.known)
    )
    files = _encoded(found.texts) | {f"{found.name}.mat": state_space.mat_bytes(found.variables)}
    return Exported(files, f"{found.name}_simulink.m", (*subject.notes, *_slopes(subject.vehicle)))


def _slopes(vehicle: Vehicle) -> tuple[str, ...]:
    """Say who gives the slopes that spin rotors up."""
    if not vehicle.sloped:
        return ()
    named = ", ".join(map(slope_input, vehicle.sloped))
    fed = f"{named}: the function that flies works them out; in Simulink feed them beside their channels."
    return (fed, *left_out(vehicle))


def _encoded(texts: Mapping[str, str]) -> dict[str, bytes]:
    return {place: text.encode("utf-8", errors="replace") for place, text in texts.items()}


TARGETS: Final[Mapping[str, Callable[[Subject, Condition], Exported]]] = {
    "jsbsim": _jsbsim,
    "state-space": _state_space,
    "simulink": _simulink,
}

"""The output folder, written whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import tomlkit
from tomlkit.items import InlineTable, Table

from stoop.base.files import check_targets
from stoop.errors import OutputError
from stoop.flight import save
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.defaults import COEFFICIENTS

if TYPE_CHECKING:
    from stoop.workflow.identification import Job

RESULT: Final = "result.json"  #: moved into place last: where it is, the others are
DIGITS: Final = 10  #: of the estimates in the vehicle file
ATTACHED: Final = ("posterior.nc",)  #: files that some results have


def output_names(flights: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all files that are written for flights of these names, in the order of moving."""
    return ("vehicle.toml", *(flight_file(name, len(flights)) for name in flights), "report.html", RESULT)


def flight_file(name: str, count: int) -> str:
    """Return the name of a flight's file, one of so many."""
    return "flight.nc" if count == 1 else f"flight-{name}.nc"


def check_folder(
    folder: Path,
    flights: Sequence[str],
    overwrite: bool = False,
    inputs: Sequence[Path] = (),
    more: Sequence[str] = (),
) -> None:
    """Refuse a folder that cannot take the outputs, before any work is done; make it if it is not there.

    Parameters
    ----------
    folder : Path
    flights : sequence of str
        Names of the flights.
    overwrite : bool
        Whether earlier outputs may be replaced.
    inputs : sequence of Path
        Files that are read: never written over.
    more : sequence of str
        Names of further files that will be written.

    Raises
    ------
    OutputError
        It holds an input or an earlier output of the same name, is no folder, or cannot be made.
    """
    check_targets(folder, (RESULT, *output_names(flights), *more), overwrite, inputs)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".stoop-", dir=folder):
            pass
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); name another folder with -o"
        ) from None


def write_outputs(job: Job, folder: Path, overwrite: bool = False) -> Path:
    """Check the folder, then write result, identified vehicle, flights and report.

    Raises
    ------
    OutputError
        See :func:`check_folder` and :func:`place_outputs`.
    """
    names = [flight.name for flight in job.flights]
    check_folder(folder, names, overwrite, job.files, tuple(job.attachments))
    return place_outputs(job, folder, overwrite)


def place_outputs(job: Job, folder: Path, overwrite: bool = False) -> Path:
    """Write into a folder that was checked, maybe hours ago; all is made first, then moved into place.

    Raises
    ------
    OutputError
        The folder cannot be written; or another run has written there since, and this one's lies beside it.
    """
    names = (*job.attachments, *output_names([flight.name for flight in job.flights]))
    working = folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        working = Path(tempfile.mkdtemp(prefix=".stoop-", dir=folder))
        _make(job, working)
        if not overwrite:
            _check_unchanged(working, names)
        _move(working, folder, names)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); free some space or name another folder"
        ) from None
    finally:
        if working != folder:
            shutil.rmtree(working, ignore_errors=True)
    return folder


def _make(job: Job, working: Path) -> None:
    from stoop.report import write_report

    text = with_values(job.fit.problem.layout.vehicle, job.fit.estimates)
    (working / "vehicle.toml").write_text(text, encoding="utf-8")
    for flight in job.flights:
        save(flight, working / flight_file(flight.name, len(job.flights)))
    for name, content in job.attachments.items():
        (working / name).write_bytes(content)
    write_report(job.identification, working / "report.html")
    job.identification.result.save(working / RESULT)


def _check_unchanged(working: Path, names: Sequence[str]) -> None:
    """Put the result beside that of another run which has written meanwhile: hours may lie in either."""
    if any((working.parent / name).exists() for name in names):
        aside = working.with_name(working.name.removeprefix("."))
        working.replace(aside)
        raise OutputError(
            f"{aside.parent}: another run has written there meanwhile; this one's result is in {aside}"
        )


def _move(working: Path, folder: Path, names: Sequence[str]) -> None:
    if (folder / RESULT).exists():
        (folder / RESULT).unlink()  # an old mark must not stand beside new files
        for name in set(ATTACHED) - set(names):
            (folder / name).unlink(missing_ok=True)  # nor an old posterior beside a new result
    for name in names:
        (working / name).replace(folder / name)


def with_values(vehicle: Vehicle, values: dict[str, float]) -> str:
    """Return the text of a vehicle file with some numbers replaced or added; comments and order stay."""
    document = tomlkit.parse(vehicle.text)
    for name, value in values.items():
        _set(document, _place(vehicle, name), float(f"{value:.{DIGITS}g}"))
    if parse_vehicle(vehicle.text, vehicle.where).reduce != vehicle.reduce:
        _set(document, ["model", "reduce"], vehicle.reduce)
    return tomlkit.dumps(document)


def _place(vehicle: Vehicle, name: str) -> list[str]:
    """Return the keys that lead to a number."""
    for coefficient in COEFFICIENTS:
        if name in getattr(vehicle.file.aerodynamics, coefficient):
            return ["aerodynamics", coefficient, name]
    return name.split(".")


def _set(document: Any, keys: list[str], value: float | str) -> None:
    table = document
    for key in keys[:-1]:
        if key not in table:
            table.add(key, tomlkit.table())
        table = table[key]
    last: Any = keys[-1]
    if isinstance(table, list):
        last = "xyz".index(keys[-1])
    current = table[last] if isinstance(table, list) or last in table else None
    if isinstance(current, InlineTable | Table):
        current["value"] = value
    else:
        table[last] = value

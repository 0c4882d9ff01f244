"""The output folder, written whole or not at all; and what a result was made from: flights, hashes, versions."""

from __future__ import annotations

import hashlib
import platform
import shutil
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import tomlkit
from tomlkit.items import InlineTable, Table

from stoop.base.files import check_targets
from stoop.errors import FlightError, OutputError
from stoop.flight import Flight, save
from stoop.logs.csv_tables import mapping_beside
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.defaults import COEFFICIENTS

if TYPE_CHECKING:
    from stoop.workflow.identification import Job

RESULT: Final = "result.json"  #: moved into place last: where it is, the others are
ATTACHED: Final = ("posterior.nc",)  #: files that some results have
PACKAGES: Final = ("stoop", "numpy", "scipy", "numba", "sympy", "xarray")
TABLES: Final = (".csv", ".csv.gz")  #: endings of the files that are read of a folder, beside its mapping


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

    `flights` and `more` are names of flights and of further files; `inputs` are never written over.

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


def place_outputs(job: Job, folder: Path, overwrite: bool = False) -> Path:
    """Write into a folder that was checked, maybe hours ago; all is made first, then moved into place.

    Raises
    ------
    OutputError
        The folder cannot be written; or another run has written there since, and this one's lies beside it.
    """
    from stoop import report

    flights = job.flights
    names = (*job.attachments, *output_names([flight.name for flight in flights]))
    working = folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        working = Path(tempfile.mkdtemp(prefix=".stoop-", dir=folder))
        text = with_values(job.fit.problem.layout.vehicle, job.fit.estimates)
        (working / "vehicle.toml").write_text(text, encoding="utf-8")
        for flight in flights:
            save(flight, working / flight_file(flight.name, len(flights)))
        for name, content in job.attachments.items():
            (working / name).write_bytes(content)
        report.write_report(job.identification, working / "report.html")
        job.result.save(working / RESULT)
        if not overwrite and any((folder / name).exists() for name in names):
            # Hours may lie in either: the result is put beside that of the other run.
            aside = working.with_name(working.name.removeprefix("."))
            working.replace(aside)
            raise OutputError(
                f"{folder}: another run has written there meanwhile; this one's result is in {aside}"
            )
        if (folder / RESULT).exists():
            (folder / RESULT).unlink()  # an old mark must not stand beside new files
            for name in set(ATTACHED) - set(names):
                (folder / name).unlink(missing_ok=True)  # nor an old posterior beside a new result
        for name in names:
            (working / name).replace(folder / name)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); free some space or name another folder"
        ) from None
    finally:
        if working != folder:
            shutil.rmtree(working, ignore_errors=True)
    return folder


def with_values(vehicle: Vehicle, values: dict[str, float]) -> str:
    """Return the text of a vehicle file with some numbers replaced or added; comments and order stay."""
    document, aerodynamics = tomlkit.parse(vehicle.text), vehicle.file.aerodynamics
    for name, value in values.items():
        owner = next((c for c in COEFFICIENTS if name in getattr(aerodynamics, c)), None)
        keys = name.split(".") if owner is None else ["aerodynamics", owner, name]
        _set(document, keys, float(f"{value:.10g}"))
    if parse_vehicle(vehicle.text, vehicle.where).reduce != vehicle.reduce:
        _set(document, ["model", "reduce"], vehicle.reduce)
    return tomlkit.dumps(document)


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


def by_name(flights: Sequence[Flight], verb: str) -> dict[str, Flight]:
    """Return flights by their names.

    Raises
    ------
    FlightError
        Two have the same name.
    """
    out: dict[str, Flight] = {}
    for flight in flights:
        if flight.name in out:
            raise FlightError(f"{verb}: two flights are called '{flight.name}'; rename one of the files")
        out[flight.name] = flight
    return out


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in PACKAGES}}


def input_hashes(
    vehicle: Vehicle, flights: Mapping[str, Flight], others: Iterable[Path] = ()
) -> dict[str, str]:
    """Return the SHA-256 of the vehicle file, of every flight's files and of all others, by name."""
    own = {Path(vehicle.where).name: hashlib.sha256(vehicle.text.encode()).hexdigest()}
    return own | file_hashes([*flight_files(flights.values()), *others], own)


def flight_files(flights: Iterable[Flight]) -> list[Path]:
    """Return the files or folders of flights, and the mappings that are found beside them."""
    logs = [flight.path for flight in flights if flight.path is not None]
    mappings = [mapping_beside(path) for path in logs if path.is_file()]
    return [path for path in [*logs, *mappings] if path.exists()]


def file_hashes(paths: Iterable[Path], taken: Iterable[str] = ()) -> dict[str, str]:
    """Return the SHA-256 of files by their names, by their paths where a name is taken.

    Of a folder the sorted names and contents of its tables and mapping are hashed, not of results beside them.
    """
    out: dict[str, str] = {}
    for path in dict.fromkeys(paths):
        digest, files = hashlib.sha256(), [path]
        if path.is_dir():
            read = (p for p in path.iterdir() if p.name.lower().endswith(TABLES) or p == mapping_beside(path))
            files = sorted(p for p in read if p.is_file())
        for file in files:
            if path.is_dir():
                digest.update(str(file.relative_to(path)).encode())
            with file.open("rb") as stream:
                while chunk := stream.read(1 << 20):
                    digest.update(chunk)
        out[str(path) if path.name in {*taken, *out} else path.name] = digest.hexdigest()
    return out

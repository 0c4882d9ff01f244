"""The output folder of an identification, written whole or not at all; hashes and versions."""

from __future__ import annotations

import hashlib
import platform
import uuid
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import tomlkit

from stoop.base.files import check_targets, scratch, write_files
from stoop.base.numbers import MAX_NUMBER
from stoop.errors import FlightError, OutputError
from stoop.flight import Flight, flight_bytes
from stoop.logs.csv_tables import mapping_beside
from stoop.results.result import to_json
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.document import write_entry, write_fields
from stoop.workflow.archive import Curves, packed_curves

if TYPE_CHECKING:
    from stoop.workflow.fitted_model import FittedModel

RESULT: Final = "result.json"  #: moved into place last: where it is, the others are
ESTIMATE, CURVES = ARCHIVES = ("estimate.npz", "traces.npz")
"""State of the estimate, and curves of the maneuvers, see `stoop.workflow.archive`."""
ATTACHED: Final = ("posterior.nc",)  #: files that some results have
PACKAGES: Final = ("stoop", "numpy", "scipy", "numba", "sympy", "xarray")
TABLES: Final = (".csv", ".csv.gz")  #: endings of the files that are read of a folder, beside its mapping


def output_names(flights: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all files that are written for flights of these names, in the order of moving."""
    kept = (flight_file(name, len(flights)) for name in flights)
    return ("vehicle.toml", *kept, *ARCHIVES, "report.html", RESULT)


def flight_file(name: str, count: int) -> str:
    """Return the name of a flight's file, one of so many; raises `OutputError` if it would lie in another folder."""
    if count > 1 and (name != Path(name).name or "\\" in name or "\0" in name):
        raise OutputError(f"flight '{name}': cannot name a file; give the flight another name")
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

    Raises `OutputError`: it holds an input or an earlier output of the same name, is no folder, or cannot be made.
    """
    check_targets(folder, (RESULT, *output_names(flights), *more), overwrite, inputs)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with scratch(folder):
            pass
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); name another folder with -o"
        ) from None


def place_outputs(model: FittedModel, folder: Path, overwrite: bool = False) -> Path:
    """Write into a folder that was checked, maybe hours ago; all is made first, then moved into place.

    Raises `OutputError`: the folder cannot be written; or another run has written there since, and this one's lies beside it.
    """
    from stoop.report.identification import render

    files: dict[str, bytes | str] = dict(model.attachments)
    files["vehicle.toml"] = with_values(model.vehicle, {n: p.estimate for n, p in model.parameters.items()})
    files |= {flight_file(flight.name, len(model.flights)): flight_bytes(flight) for flight in model.flights}
    if archive := model.evidence:
        files[ESTIMATE] = archive
    files[CURVES] = packed_curves(Curves(model.traces, model.convergence, model.command))
    files |= {"report.html": render(model), RESULT: to_json(model.result)}
    if not overwrite and any((folder / name).exists() for name in files):
        # Hours may lie in either: the result is put beside that of the other run.
        aside = folder / f"run-{uuid.uuid4().hex[:8]}"
        write_files(folder, {f"{aside.name}/{name}": content for name, content in files.items()})
        raise OutputError(
            f"{folder}: another run has written there meanwhile; this one's result is in {aside}"
        )
    # an old mark must not stand beside new files, nor an old posterior or estimate beside a new result
    obsolete: list[str] = []
    if (folder / RESULT).exists():
        read = [path for path in model.files if path.exists()]
        flights = flight_places(folder) if model.flights else []
        own = {place.name for place in flights if not any(place.samefile(path) for path in read)}
        obsolete = [RESULT, *sorted({*ATTACHED, *ARCHIVES, *own} - set(files))]
    write_files(folder, files, obsolete)
    return folder


def flight_places(folder: Path) -> list[Path]:
    """Return the files of flights that a folder of a result holds, by name."""
    return sorted([*folder.glob("flight.nc"), *folder.glob("flight-*.nc")])


def with_values(vehicle: Vehicle, values: dict[str, float]) -> str:
    """Return the text of a vehicle file with some numbers replaced or added; comments and order stay.

    A fit that begins from it is of the same problem: priors stay about their own means, so that each counts once, and what was
    set, freed or fixed since the file was read is written.
    """
    document, original = tomlkit.parse(vehicle.text), parse_vehicle(vehicle.text, vehicle.where)
    written = original.quantities
    for name, q in vehicle.quantities.items():
        before = written.get(name)
        if q.tie is not None or before is None or before.tie is not None:
            continue
        value, keys = values.get(name, q.value), vehicle.keys_of(name)
        fields: dict[str, Any] = {} if q.free in (None, before.free) else {"free": q.free}
        if q.prior is not None and (name in values or q.prior != before.prior):
            fields |= {"prior": q.prior, "mean": q.prior_mean}
        if fields or name in values or value != before.value:
            low, high = q.bounds or (-MAX_NUMBER, MAX_NUMBER)
            # estimates are read back from result.json; numbers that were set are nowhere else
            rounded = float(f"{value:.10g}") if name in values else value
            write_entry(document, keys, min(max(rounded, low), high))
        if fields:
            write_fields(document, keys, fields)
    if original.reduce != vehicle.reduce:
        write_entry(document, ["model", "reduce"], vehicle.reduce)
    return tomlkit.dumps(document)


def by_name(flights: Sequence[Flight], verb: str) -> dict[str, Flight]:
    """Return flights by their names; raises `FlightError` if two have the same."""
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
    return own | file_hashes([*flights.values(), *others], own)


def flight_files(flights: Iterable[Flight]) -> list[Path]:
    """Return the files or folders of flights, and the mappings that are found beside them."""
    logs = [flight.path for flight in flights if flight.path is not None]
    mappings = [mapping_beside(path) for path in logs if path.is_file()]
    return [path for path in [*logs, *mappings] if path.exists()]


def file_hashes(inputs: Iterable[Flight | Path], taken: Iterable[str] = ()) -> dict[str, str]:
    """Return the SHA-256 of files, and of those of flights, by their names, by their paths where a name is taken.

    Of a folder the sorted names and contents of its tables and mapping are hashed, not of results beside them.
    """
    out: dict[str, str] = {}
    paths = [path for one in inputs for path in (flight_files([one]) if isinstance(one, Flight) else [one])]
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

"""Inputs of a result: flights by name, file hashes, versions of packages."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.logs.csv_tables import mapping_beside
from stoop.vehicle import Vehicle

PACKAGES = ("stoop", "numpy", "scipy", "numba", "sympy", "xarray")
TABLES = (".csv", ".csv.gz")  #: endings of the files that are read of a folder, beside its mapping


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
    """Return the SHA-256 of files by their names, by their paths where a name is taken."""
    out: dict[str, str] = {}
    for path in dict.fromkeys(paths):
        out[str(path) if path.name in {*taken, *out} else path.name] = _hash_path(path)
    return out


def _hash_path(path: Path) -> str:
    """Hash a file; of a folder the sorted names and contents of its tables and mapping, not of results beside them."""
    digest = hashlib.sha256()
    files = [path]
    if path.is_dir():
        read = (p for p in path.iterdir() if p.name.lower().endswith(TABLES) or p == mapping_beside(path))
        files = sorted(p for p in read if p.is_file())
    for file in files:
        if path.is_dir():
            digest.update(str(file.relative_to(path)).encode())
        with file.open("rb") as stream:
            while chunk := stream.read(1 << 20):
                digest.update(chunk)
    return digest.hexdigest()

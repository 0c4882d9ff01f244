"""From what a result was made: versions and input hashes."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path

from stoop.flight import Flight
from stoop.logs.table import beside
from stoop.vehicle import Vehicle

_PACKAGES = ("stoop", "numpy", "scipy", "numba", "sympy", "xarray")
_CHUNK = 1 << 20
_TABLES = (".csv", ".csv.gz")  #: what a folder's readers read, its mapping aside


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in _PACKAGES}}


def input_hashes(
    vehicle: Vehicle, flights: Mapping[str, Flight], others: Iterable[Path] = ()
) -> dict[str, str]:
    """Return the SHA-256 of the vehicle file, of every flight's files and of all others, by name."""
    own = {Path(vehicle.where).name: hashlib.sha256(vehicle.text.encode()).hexdigest()}
    return own | file_hashes([*flight_files(flights.values()), *others], own)


def flight_files(flights: Iterable[Flight]) -> list[Path]:
    """Return the files or folders of flights, and the mappings that are found beside them."""
    logs = [flight.path for flight in flights if flight.path is not None]
    mappings = [beside(path) for path in logs if path.is_file()]
    return [path for path in [*logs, *mappings] if path.exists()]


def file_hashes(paths: Iterable[Path], taken: Iterable[str] = ()) -> dict[str, str]:
    """Return the SHA-256 of files by their names, by their paths where a name is taken."""
    out: dict[str, str] = {}
    for path in dict.fromkeys(paths):
        out[str(path) if path.name in {*taken, *out} else path.name] = _hash_path(path)
    return out


def _hash_path(path: Path) -> str:
    """Hash a file, or a folder as the sorted names and contents of the files that are read of it."""
    digest = hashlib.sha256()
    for file in [path] if path.is_file() else _of_folder(path):
        if path.is_dir():
            digest.update(str(file.relative_to(path)).encode())
        with file.open("rb") as stream:
            while chunk := stream.read(_CHUNK):
                digest.update(chunk)
    return digest.hexdigest()


def _of_folder(path: Path) -> list[Path]:
    """Return tables and mapping, and no results that were written into the folder since."""
    files = (p for p in path.iterdir() if p.name.lower().endswith(_TABLES) or p == beside(path))
    return sorted(p for p in files if p.is_file())

"""From what a result was made: versions and input hashes."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

from stoop.flight import Flight
from stoop.vehicle import Vehicle

_PACKAGES = ("stoop", "numpy", "scipy", "numba", "sympy", "xarray")
_CHUNK = 1 << 20


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in _PACKAGES}}


def input_hashes(vehicle: Vehicle, flights: Mapping[str, Flight]) -> dict[str, str]:
    """Return the SHA-256 of the vehicle file and of every flight's files, by name."""
    out = {Path(vehicle.where).name: hashlib.sha256(vehicle.text.encode()).hexdigest()}
    for flight in flights.values():
        if flight.path is not None and flight.path.exists():
            out[flight.path.name] = _hash_path(flight.path)
    return out


def _hash_path(path: Path) -> str:
    """Hash a file, or a folder as the sorted names and contents of its files."""
    digest = hashlib.sha256()
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    for file in files:
        if path.is_dir():
            digest.update(str(file.relative_to(path)).encode())
        with file.open("rb") as stream:
            while chunk := stream.read(_CHUNK):
                digest.update(chunk)
    return digest.hexdigest()

"""What results depend on beside the plan: versions, processor, sources."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

LIBRARIES: Final = (
    "stoop",
    "numpy",
    "scipy",
    "xarray",
    "pydantic",
    "pymoo",
    "cma",
    "ioh",
    "pygmo",
)  #: that make numbers
ROOMS: Final = (
    "assessment", "base", "data", "estimate", "flight", "kernels", "logs", "optimize", "problem", "results", "simulation",
    "vehicle",
)  # fmt: skip  #: folders and files of stoop that make numbers; those of a work function's own count by `work_sources`
_SHOWN = 40  #: characters; what is longer is not quoted in an error
_HERE = Path(__file__).parents[1]


@functools.cache
def environment() -> Mapping[str, str]:
    """Return name and value of everything that results depend on beside the plan.

    A library that is not installed is left out: runs that need it say so themselves.
    """
    from stoop.kernels import environment as compiled

    rooms = {"sources of stoop": source_digest(*(_HERE / room for room in ROOMS))}
    return MappingProxyType({**dict(compiled()), **_versions(), **rooms})


def _versions() -> dict[str, str]:
    from importlib import metadata

    found = {}
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def source_digest(*places: Path) -> str:
    """Return one hash of Python and TOML files, and of those in folders; a plan may keep it among its settings.

    Parameters
    ----------
    places : files or folders
    """
    digest = hashlib.sha256()
    for place in places:
        files = [place] if place.is_file() else [p for p in place.rglob("*") if p.suffix in (".py", ".toml")]
        for path in sorted(files):
            digest.update(f"{path.relative_to(place.parent).as_posix()}\n".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Return in words where two environments differ in what both have; empty if they agree."""
    unlike = [name for name in here if name in there and here[name] != there[name]]
    return ", ".join(_told(name, here[name], there[name]) for name in unlike)


def _told(name: str, here: str, there: str) -> str:
    if max(len(here), len(there)) > _SHOWN:
        return name
    return f"{name} {here} here, {there} there"

"""Vehicles that come with the package, by name."""

from __future__ import annotations

import difflib
import tomllib
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Final

from stoop.base.toml import read_source
from stoop.errors import VehicleError
from stoop.vehicle.load import parse_vehicle
from stoop.vehicle.vehicle import Vehicle

BUILT_IN: Final = {
    name: f"{name.replace('-', '_')}.toml"
    for name in ("twin-boom", "quad-x", "quad-plus", "hexa-x", "octo-x", "quadplane")
}  #: name -> file in stoop/data


def load_vehicle(name_or_path: str | Path | Vehicle) -> Vehicle:
    """Return a vehicle of the package by its name, or read a vehicle file.

    A name of the package wins over a file of the same name; write ``./twin-boom`` for the file.

    Parameters
    ----------
    name_or_path : str, Path or Vehicle
        "twin-boom", "quad-x", "quad-plus", "hexa-x", "octo-x" or "quadplane", or where the file is; a vehicle is returned.

    Raises
    ------
    VehicleError
        There is no such vehicle, or what is wrong in its file.
    """
    given: object = name_or_path
    if isinstance(name_or_path, Vehicle):
        return name_or_path
    if not isinstance(given, str | Path):
        kind = type(given).__name__
        raise VehicleError(f"a vehicle is expected first, not a {kind}; give the vehicle, then the flights")
    name = str(name_or_path)
    if name in BUILT_IN:
        return builtin_vehicle(name)
    with suppress(OSError):  # a name that is too long for a file
        if not Path(name_or_path).exists():
            raise VehicleError(f"{Path(name_or_path)}: there is no such vehicle file; {_advice(name)}")
    return parse_vehicle(read_source(name_or_path, "vehicle", VehicleError), name)


def builtin_vehicle(name: str) -> Vehicle:
    """Return a vehicle of the package; messages name it, not its path."""
    return parse_vehicle(builtin_text(name), name)


def builtin_text(name: str) -> str:
    """Return the file of a vehicle of the package with its comments; a VehicleError lists the names."""
    if name not in BUILT_IN:
        raise VehicleError(f"{name}: there is no such built-in vehicle; {_advice(name)}")
    return (files("stoop.data") / BUILT_IN[name]).read_text(encoding="utf-8")


def builtin_title(name: str) -> str:
    """Return a description of a vehicle of the package in one line."""
    return str(tomllib.loads(builtin_text(name))["name"])


def _advice(name: str) -> str:
    if near := difflib.get_close_matches(name.removesuffix(".toml").replace("_", "-"), BUILT_IN, 1):
        return f"did you mean the built-in vehicle {near[0]}?"
    with suppress(OSError):
        beside = [p.name for p in Path(name).parent.iterdir()]
        if near := difflib.get_close_matches(Path(name).name, beside, 1):
            return f"did you mean {Path(name).with_name(near[0])}?"
    return f"check the path, draft it by stoop vehicle new, or use a built-in vehicle ({', '.join(BUILT_IN)})"

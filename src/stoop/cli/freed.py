"""``--free`` and ``--fix``: which numbers of the vehicle file are estimated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from stoop.errors import IdentificationError

if TYPE_CHECKING:
    from stoop.vehicle import Vehicle


def freed(vehicle: Vehicle, free: Sequence[str], fix: Sequence[str]) -> Vehicle:
    """Return the vehicle with numbers freed and fixed as the command line says.

    Raises
    ------
    StoopError
        A number that does not exist, is tied to another, is not in the equations, or has no bounds.
    """
    both = set(free) & set(fix)
    if both:
        raise IdentificationError(f"--free and --fix both name '{min(both)}'; keep one of them")
    for option, names in (("--free", free), ("--fix", fix)):
        for name in names:
            _check(vehicle, option, name)
    changes: dict[str, dict[str, Any]] = {name: {"free": True} for name in free} | {
        name: {"free": False} for name in fix
    }
    changed = vehicle.with_numbers(changes) if changes else vehicle
    for p in changed.parameters:
        if p.name in free and not p.lower < p.upper:
            raise IdentificationError(
                f"--free {p.name}: it has no bounds and its value is {p.value:g}; write bounds = [low, high] in {vehicle.where}"
            )
    return changed


def _check(vehicle: Vehicle, option: str, name: str) -> None:
    """Refuse what would have no effect."""
    own = {p.name: i for i, p in enumerate(vehicle.parameters)}
    row = vehicle.rows.get(name)
    if row is None and _unwritten(vehicle, name):
        room, _, last = name.rpartition(".")
        raise IdentificationError(
            f"{option} {name}: {vehicle.where} does not say it; write {last} = {{ value = ..., bounds = [low, high] }} into "
            f"[{room}]"
        )
    if row is not None and name not in own:
        raise IdentificationError(f"{option} {name}: tied to {vehicle.parameters[row].name}; name that one")
    if name in own and not _in_equations(vehicle, name):
        raise IdentificationError(
            f"{option} {name}: the equations of {vehicle.where} ({vehicle.reduce}) do not contain it; leave it out"
        )


def _unwritten(vehicle: Vehicle, name: str) -> bool:
    """Tell whether a file may say a number that this one leaves out."""
    *rooms, last = name.split(".")
    here: Any = vehicle.file
    for room in rooms:
        here = here.get(room) if isinstance(here, Mapping) else getattr(here, room, None)
    return last in getattr(type(here), "model_fields", ()) and getattr(here, last) is None


def _in_equations(vehicle: Vehicle, name: str) -> bool:
    """Tell whether the kept equations hold a number: a reduced model drops terms, controls and channels."""
    from stoop.vehicle.defaults import COEFFICIENTS
    from stoop.vehicle.schema import CHANNELS, WIND

    room, _, rest = name.partition(".")
    part = rest.partition(".")[0]
    if room == "controls":
        return part in vehicle.controls
    if room == "turbulence":
        return part in vehicle.gusts
    if room == "sensors" and part in (*CHANNELS, *WIND):
        return part in vehicle.outputs
    return not any(
        name in getattr(vehicle.file.aerodynamics, c) for c in COEFFICIENTS if c not in vehicle.terms
    )

"""What leaves a vehicle before it is exported: gusts are weather, not aircraft."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from stoop.vehicle import Vehicle

LEFT_OUT: Final = "The vehicle's turbulence is left out: gusts are the simulator's weather."


def still(vehicle: Vehicle) -> tuple[Vehicle, tuple[str, ...]]:
    """Return the vehicle in still air, and what to tell the user."""
    if getattr(vehicle.file, "turbulence", None) is None:
        return vehicle, ()
    loadings = {
        loading: {name: value for name, value in numbers.items() if not name.startswith("turbulence.")}
        for loading, numbers in vehicle.file.loadings.items()
    }
    changes = {"turbulence": None, "loadings": loadings}
    return replace(vehicle, file=vehicle.file.model_copy(update=changes)), (LEFT_OUT,)

"""`stoop vehicle new`: logs, mass and dimensions to a vehicle file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stoop.flight import Flight, load
from stoop.vehicle_draft.draft import Drafted, draft
from stoop.vehicle_draft.request import Request


def read_flights(paths: Sequence[Path], mapping: Path | None) -> tuple[Flight, ...]:
    """Read the logs of a vehicle."""
    return tuple(load(path, mapping) for path in paths)


def new_vehicle(request: Request, flights: Sequence[Flight] = (), where: str = "vehicle") -> Drafted:
    """Draft a vehicle file from what a person gives and what flights tell; see `stoop.vehicle_draft.draft.draft`."""
    return draft(request, flights, where)

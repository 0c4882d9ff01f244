"""The vehicle file that mass, dimensions and a log give: every line with what it is, where it is from, how sure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stoop.base.notices import Notice, distinct
from stoop.base.text import Summarized
from stoop.flight import Flight
from stoop.vehicle.load import parse_vehicle
from stoop.vehicle.vehicle import Vehicle
from stoop.vehicle_draft import plausibility
from stoop.vehicle_draft.airplane import Airplane
from stoop.vehicle_draft.geometry import WINGED
from stoop.vehicle_draft.request import Request, completed, evidence
from stoop.vehicle_draft.rotorcraft import Multirotor


@dataclass(frozen=True, eq=False, repr=False)
class Drafted(Summarized):
    """A vehicle file that was drafted."""

    text: str  #: TOML
    vehicle: Vehicle
    notices: tuple[Notice, ...]  #: what speaks against it


def draft(request: Request, flights: Sequence[Flight] = (), where: str = "vehicle") -> Drafted:
    """Draft a vehicle file.

    Parameters
    ----------
    request : Request
    flights : sequence of Flight
        Of this vehicle; the first with parameters of an autopilot tells the mixers.
    where : str
        Names the file in messages.

    Raises
    ------
    VehicleError
        Something is missing, or contradicts itself.
    """
    seen, given = evidence(flights), request.geometry is not None or request.template is not None
    request = completed(request, seen)
    file = Airplane(request, seen) if request.template in WINGED else Multirotor(request, seen)
    text = file.text()
    vehicle = parse_vehicle(text, where)
    of_template = plausibility.of_template(str(request.template), given, seen)
    notices = distinct([*of_template, *file.notices()])
    return Drafted(text, vehicle, notices)

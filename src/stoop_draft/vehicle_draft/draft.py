"""The vehicle file that mass, dimensions and a log give: every line with what it is, where it is from, how sure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stoop import Flight, Notice, Vehicle
from stoop.extend.errors import VehicleError
from stoop.extend.text import Summarized
from stoop.extend.vehicles import parse_vehicle
from stoop_draft.vehicle_draft import inertia, plausibility
from stoop_draft.vehicle_draft.airplane import Airplane
from stoop_draft.vehicle_draft.geometry import WINGED
from stoop_draft.vehicle_draft.power import USUAL, Lift, running_rotors
from stoop_draft.vehicle_draft.request import ROTORCRAFT, Request, completed, evidence
from stoop_draft.vehicle_draft.steady import steady_flight
from stoop_draft.vehicle_draft.tables import PRIORS, FileText, body_drag, rotor_tables


class Multirotor(FileText):
    """A multirotor."""

    def text(self) -> str:
        """Return the file."""
        lift, mass = self._known_lift(), self.mass
        self.head(f"{lift.size():.3g} m between the motors that are farthest apart")
        self.mass_table(inertia.of_multirotor(mass, [rotor.position for rotor in lift.rotors]))
        self.environment()
        rotor_tables(self.sheet, lift, mass, steady_flight(self.seen.flights, wings=False))
        body_drag(self.sheet, mass, 1.5 * USUAL.body * mass)
        self.sensor_places(PRIORS.frame * lift.size())
        return self.sheet.text()

    def _known_lift(self) -> Lift:
        if self.lift is not None:
            return self.lift
        flight, count = self.seen.flight, ROTORCRAFT[self.template]
        running = running_rotors(flight)[0] if flight is not None else []
        name = flight.name if flight is not None else "the log"
        channels = f" ({', '.join(running)})" if running else ""
        raise VehicleError(
            f"--template {self.template}: has {count} rotors, but {len(running)} motors run in {name}"
            f"{channels}; choose another template, or check the mapping"
        )

    def notices(self) -> list[Notice]:
        """Return what speaks against the draft."""
        lift = self._known_lift()
        found = plausibility.of_rotors(self.mass, lift)
        found += plausibility.of_flights([rotor.channel for rotor in lift.rotors], {}, self.seen)
        return [*found, *plausibility.of_excitation(self.seen)]


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
        Of this vehicle; the mixers are those of the first with parameters of an autopilot.
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
    notices = tuple(dict.fromkeys([*of_template, *file.notices()]))
    return Drafted(text, vehicle, notices)

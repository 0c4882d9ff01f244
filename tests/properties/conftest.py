import pytest

from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.workflow import FittedModel
from stoop.workflow.demo import MANEUVER
from stoop.workflow.identification import finish, search

FREE = ("Cm0", "Cmalpha", "Cmelevator")


@pytest.fixture(scope="session")
def lacking() -> FittedModel:
    """Return the fit of three numbers of pitch to a flight whose pitching moment also has a term of alpha squared."""
    more = '[aerodynamics.Cm]\nCmsquare = { term = "alpha*alpha", value = 6.0 }'
    text = builtin_text("twin-boom").replace("[aerodynamics.Cm]", more)
    truth = parse_vehicle(text, "truth").reduced("longitudinal")
    flight = simulate_flight(truth, parse_maneuver(MANEUVER, "flown"), seed=3, name="sim")
    vehicle = builtin_vehicle("twin-boom").reduced("longitudinal")
    held = {p.name: {"free": p.name in FREE} for p in vehicle.parameters if p.free}
    return finish(search(vehicle.with_numbers(held), flight, ["0:8"]))

"""No clean flight is accused: simulated airplanes and multirotors, in wind and gusts, with and without maneuvers."""

import numpy as np
import pytest
from helpers.flown import maneuver

from stoop import check
from stoop.base.variables import VARIABLES
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop_draft.checks.entries import Line
from stoop_draft.checks.mapping import check_mapping

OWN = {name: Line("M.toml", f"variables.{name}", known.unit) for name, known in VARIABLES.items()}
ROTORS = (("roll", 12, 0.15), ("pitch", 12, 0.15), ("yaw", 1.5, 0.4), ("heave", 2.5, 0.3), ("north", 2, 1.5))
WINGS = (("elevator", 0.08, 0.3), ("aileron", 0.08, 0.5), ("rudder", 0.08, 0.6))
NAMES = ("quad-x", "twin-boom", "hexa-x", "twin-boom", "octo-x", "quadplane")


def accused(seed: int) -> list[str]:
    """Return what is said of one clean flight, as if every line of its mapping were the user's; the file knows no gusts."""
    rng = np.random.default_rng(seed)
    name = NAMES[seed % len(NAMES)]
    winged = name == "twin-boom"
    text, duration = load_vehicle(name).text, float(rng.choice([14, 30, 60]))
    if rng.random() < 0.5 and "[turbulence]" not in text:
        gusts = f"= {{ intensity = {rng.uniform(0.3, 1.5):.2f}, length = 30.0 }}\n"
        text += f"\n[turbulence]\nairspeed = {35.0 if winged else 5.0}\nu {gusts}v {gusts}w {gusts}"
    more = {"wind": [*rng.uniform(-4, 4, 2).round(2), 0.0]}
    more |= {"airspeed": round(rng.uniform(30, 40), 1)} if winged else {}
    inputs = []
    for control, size, step in WINGS if winged else ROTORS:
        if rng.random() < 0.7:
            shape, start = rng.choice(["doublet", "3-2-1-1"]), round(rng.uniform(1.0, duration - 6.0), 2)
            step = round(step * rng.uniform(0.7, 1.4), 3)
            inputs.append((control, str(shape), start, step, round(size * rng.uniform(-1.0, 1.0), 4)))
    flown = maneuver(duration, *inputs, rate=100.0, **more)
    flight = simulate_flight(parse_vehicle(text, name), flown, seed=seed, name="sim")
    data = {channel: flight.column(channel) for channel in flight.channels}
    signals = {channel: (flight.time, x) for channel, x in data.items()}
    judged = check_mapping(signals, data, flight.rate, OWN)
    return [str(one) for one in (*judged.refused, *judged.notices, *check(flight, load_vehicle(name)))]


def test_a_clean_flight_is_not_accused() -> None:
    assert accused(0) == []


@pytest.mark.parametrize("seed", range(1, 36))
def test_none_of_many_clean_flights_is_accused(seed: int) -> None:
    assert accused(seed) == []

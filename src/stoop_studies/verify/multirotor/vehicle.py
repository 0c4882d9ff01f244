"""What stoop is told of the F450: mass, arms, which way rotors turn, moment of inertia in yaw, drag along the thrust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.vehicle import Vehicle
from stoop.vehicle.load import parse_vehicle
from stoop_studies.verify.jsbsim_truth.machine import EARTH_RATE, FOOT
from stoop_studies.verify.multirotor.craft import ROTORS, Craft
from stoop_studies.verify.multirotor.flight import MOTORS, TURNS, Recording

NOISE: Final = {
    "vn": 0.1, "ve": 0.1, "vd": 0.1, "p": 0.02, "q": 0.02, "r": 0.02,
    "phi": 0.01, "theta": 0.01, "psi": 0.01, "ax": 0.3, "ay": 0.3, "az": 0.3,
}  #: one standard deviation of the white noise on each channel: m/s, rad/s, rad, m/s2  # fmt: skip
GUESSED: Final = {"xx": 0.03, "yy": 0.03}  #: kg m2, where the search for the moments of inertia starts
KNOWN: Final = (
    "mass.inertia.zz",
    "body_drag.quadratic.z",
)  #: told; the flight cannot separate them from others
FILE: Final = """
format = "stoop-vehicle/1"
name = "F450 of JSBSim"

[mass]
mass = {mass!r}
[mass.inertia]
xx = {{ value = {xx!r}, free = true, bounds = [0.005, 0.1] }}
yy = {{ value = {yy!r}, free = true, bounds = [0.005, 0.1] }}
zz = {zz!r}

[environment]
gravity = {gravity!r}

[rotors]
drive = "speed"
{channel}
inertia = {{ value = 2e-5, free = true, bounds = [1e-6, 3e-4] }}
T2 = {T2_start!r}
inflow = 0.0
translational = 0.0
torque_ratio = 0.01

[body_drag]
linear = [0.0, 0.0, {{ value = 0.0, free = false }}]
quadratic = [0.0, 0.0, {{ value = {drag!r}, free = false }}]
rotation = [{turning}, {turning}, {turning}]
"""
BY_COMMAND: Final = """\
lag = {{ value = 0.1, free = true, bounds = [0.005, 0.3] }}
gain = {gain!r}
idle = {idle!r}"""
TURNING: Final = "{ value = 0.0, bounds = [-0.1, 0.1] }"


def vehicle_of(
    craft: Craft, flown: Recording, truth: Mapping[str, float], motor: Mapping[str, float] | None
) -> Vehicle:
    """Return the vehicle with guesses for all that is to be found.

    Of ``truth`` only `KNOWN` is read.
    """
    x = float(np.mean([flown.columns[c].mean() for c in TURNS]))
    share = craft.mass * flown.gravity / 4.0
    text = FILE.format(
        mass=craft.mass, **GUESSED, zz=truth["mass.inertia.zz"], gravity=gravity(craft, flown),
        channel="" if motor is None else BY_COMMAND.format(**motor), T2_start=share / x**2,
        drag=truth["body_drag.quadratic.z"],
        turning=TURNING,
    )  # fmt: skip
    return parse_vehicle(
        "\n".join([text, *_rotors(craft, TURNS if motor is None else MOTORS), _sensors()]), "jsbsim F450"
    )


def gravity(craft: Craft, flown: Recording) -> float:
    """Return what acts on a body at rest over the equator: attraction, less what the turning of the Earth takes."""
    return flown.gravity - EARTH_RATE**2 * craft["position/radius-to-vehicle-ft"] * FOOT


def _rotors(craft: Craft, channels: tuple[str, ...]) -> list[str]:
    return [
        f'[rotor.{name}]\nchannel = "{channels[i]}"\nposition = {list(craft.position(i))}\nspin = "{craft.sense(i)}"'
        for i, name in enumerate(ROTORS)
    ]


def _sensors() -> str:
    return "\n".join(f"[sensors.{channel}]\nsigma = {sigma!r}" for channel, sigma in NOISE.items())

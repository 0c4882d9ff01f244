"""Known truth, sensor noise, wind and turbulence: quadrotors and hexacopters with a weak rotor, all come back.

Mass is known; inertia, center of gravity, lag, delay, thrust, torque, drag and the factor of the weak rotor are free and
start up to 20 % off. Each window's wind is constant, so gusts that change within it are noise of the method, which the
error bars know: squares of (estimate - truth) / standard error average about one in calm air and in gusts of 0.5 m/s. The
sixteen estimates of a flight err together (most in the level of thrust and inertia), so single flights average 0.3 to 3.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np
import pytest
from unit.estimate.fits import deviations
from unit.flown import maneuver

from stoop.assessment.covariance import NORMAL_95
from stoop.estimate.fit import Options
from stoop.estimate.multiple_shooting import fit
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle

SECONDS = 40.0
Flights = Mapping[str, range]
AIR: tuple[tuple[str, float, Flights, float, float], ...] = (
    ("calm", 0.0, {"quad-x": range(4), "hexa-x": range(4, 8)}, 3.5, 1.5),
    ("turbulence of 0.5 m/s", 0.5, {"quad-x": range(8), "hexa-x": range(8, 16)}, 4.0, 1.8),
)
"""Air; m/s; seeds, none twice, for of one seed gusts are alike whatever flies through them; most of |z|, of a mean square."""
CENTER = ("mass.center_of_gravity.x", "mass.center_of_gravity.y")
GUSTS = "\n[turbulence]\nairspeed = 5.0\n" + "".join(
    f"{a} = {{{{ intensity = {{0}}, length = {length} }}}}\n"
    for a, length in (("u", 50.0), ("v", 50.0), ("w", 20.0))
)


LEGS = [
    (control, shape, 10.0 * k + start, step, amplitude * ((-1) ** k if control == "north" else 1.0))
    for k in range(4)
    for control, shape, start, step, amplitude in (
        ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
        ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("north", "doublet", 4.5, 2.0, 2.5), ("east", "doublet", 5.0, 2.0, 2.5),
        ("down", "doublet", 5.5, 2.0, 1.0), ("heading", "doublet", 6.0, 1.5, 0.6),
    )
]  # fmt: skip


def vehicles(name: str, gusts: float) -> tuple[Vehicle, Vehicle]:
    """Return the truth, in gusts, and the same in calm air; one rotor is weak, the center of gravity off."""
    text = resolve_vehicle(name).text.replace("lag = ", "delay = 0.012\nlag = ", 1)
    text = re.sub(r"(\[rotor\.m3\][^\n]*\n)", r"\1factor = 0.85\n", text)
    text = text.replace("[rotors]", "center_of_gravity = [0.01, -0.006, 0.0]\n\n[rotors]", 1)
    blown = text + GUSTS.format(gusts) if gusts else text
    return parse_vehicle(blown, name), parse_vehicle(text, name)


def misled(vehicle: Vehicle, seed: int) -> tuple[Vehicle, dict[str, float]]:
    """Return a start up to 20 % off, and the truth."""
    rng, inertia = np.random.default_rng(seed + 100), [f"mass.inertia.{a}" for a in ("xx", "yy", "zz")]
    own = [p.name for p in vehicle.parameters if p.free and not p.name.startswith("sensors.")]
    free = (*own, "rotors.lag", "rotors.delay", "rotor.m3.factor", *CENTER, *inertia)
    truth = {n: vehicle.value(n) for n in free}
    changes = {n: {"free": True, "value": v * rng.uniform(0.8, 1.2)} for n, v in truth.items()}
    for n in inertia:
        changes[n]["bounds"] = (truth[n] / 3.0, truth[n] * 3.0)
    for n in CENTER:
        changes[n]["bounds"] = (-0.05, 0.05)
    return vehicle.with_numbers(changes), truth


def flown(name: str, gusts: float, seed: int) -> np.ndarray:
    true, calm = vehicles(name, gusts)
    flight = simulate_flight(
        true, maneuver(SECONDS, *LEGS, rate=100.0, wind=[2.0, -1.0, 0.0]), seed=seed, name="sim"
    )
    start, truth = misled(calm, seed)
    found = fit(start, {"sim": flight}, [Window("sim", 0.0, SECONDS)], Options(seed=seed))
    assert found.outcome.status == "converged"
    return deviations(found, {p.name: truth[p.name] for p in found.problem.layout.parameters})


def test_a_quadrotor_comes_back_in_calm_air() -> None:
    z = flown("quad-x", 0.0, 0)
    assert len(z) == 16
    assert np.abs(z).max() < 3.5
    assert np.mean(z**2) < 3.0


@pytest.mark.parametrize(("air", "gusts", "flights", "worst", "most"), AIR)
def test_error_bars_are_right(air: str, gusts: float, flights: Flights, worst: float, most: float) -> None:
    found = {name: np.array([flown(name, gusts, seed) for seed in seeds]) for name, seeds in flights.items()}
    assert all(0.5 < np.mean(z**2) < most for z in found.values()), air
    pooled = np.concatenate(list(found.values()))
    assert np.abs(pooled).max() < worst  # of 128 or 256
    assert 0.7 < np.mean(pooled**2) < 1.3
    assert 0.90 < np.mean(np.abs(pooled) < NORMAL_95) < 0.98

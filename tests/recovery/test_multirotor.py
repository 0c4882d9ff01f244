"""Known truth, sensor noise, wind and turbulence: multirotors with a weak rotor, and rotors as each autopilot logs them.

Mass is known; all else is free and starts up to 20 % off. Each window's wind is constant, so gusts that change within it are
noise of the method, which the error bars know: squares of (estimate - truth) / standard error average about one. The sixteen
estimates of a flight err together (most in the level of thrust and inertia), so single flights average 0.3 to 3.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.fits import deviations
from helpers.flown import maneuver

import stoop
from stoop import Options, Vehicle, load_vehicle, simulate_flight, trim
from stoop.assessment.covariance import NORMAL_95
from stoop.base.variables import EULER
from stoop.estimate.multiple_shooting import fit
from stoop.problem.windows import Window
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.schema import WIND
from stoop_analysis.performance.effectiveness import Balance, Hover, Reference, assess, hover, judge

SECONDS, Flights = 40.0, Mapping[str, range]
AIR: tuple[tuple[str, float, Flights, float, float], ...] = (
    ("calm", 0.0, {"quad-x": range(4), "hexa-x": range(4, 8)}, 3.5, 1.5),
    ("turbulence of 0.5 m/s", 0.5, {"quad-x": range(8), "hexa-x": range(8, 16)}, 4.0, 1.8),
)
"""Air; m/s; seeds, none twice, for of one seed gusts are alike whatever flies through them; most of |z|, of a mean square."""
CENTER = ("mass.center_of_gravity.x", "mass.center_of_gravity.y")
BLOWN = "\n[turbulence]\nairspeed = 5.0\n"
GUSTS = BLOWN + "".join(
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
LEGS_ROTORS = (("roll", "3-2-1-1", 4.0, 0.15, 10.0), ("north", "doublet", 10.0, 3.0, 2.0))
WINDY = maneuver(25.0, *LEGS_ROTORS, rate=100.0, altitude=100.0, wind=[2.0, -1.0, 0.0])


def vehicles(name: str, gusts: float) -> tuple[Vehicle, Vehicle]:
    """Return the truth, in gusts, and the same in calm air; one rotor is weak, the center of gravity off."""
    text = load_vehicle(name).text.replace("lag = ", "delay = 0.012\nlag = ", 1)
    text = re.sub(r"(\[rotor\.m3\][^\n]*\n)", r"\1factor = 0.85\n", text)
    text = text.replace("[rotors]", "center_of_gravity = [0.01, -0.006, 0.0]\n\n[rotors]", 1)
    return parse_vehicle(text + GUSTS.format(gusts) if gusts else text, name), parse_vehicle(text, name)


def misled(vehicle: Vehicle, seed: int) -> tuple[Vehicle, dict[str, float]]:
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
    legs = maneuver(SECONDS, *LEGS, rate=100.0, wind=[2.0, -1.0, 0.0])
    flight = simulate_flight(true, legs, seed=seed, name="sim")
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


GUSTS_ROTORS = BLOWN + "".join(f"{a} = {{ intensity = 0.3, length = 5.0 }}\n" for a in "uvw")
WRONG_SMALL = {
    "rotors.T1": 0.8, "rotors.lag": 0.5, "rotors.torque_ratio": 1.3, "mass.inertia.xx": 1.4, "mass.inertia.yy": 0.7,
}  # fmt: skip


TUMBLING = [
    (control, "3-2-1-1", 10.0 * k + start, step, sign * amplitude)
    for k, sign in enumerate((1.0, -1.0))
    for control, start, step, amplitude in (
        ("roll", 1.0, 0.1, 40.0), ("pitch", 3.5, 0.1, 40.0), ("yaw", 6.0, 0.25, 3.0), ("heave", 8.0, 0.2, 2.5),
    )
]  # fmt: skip


def test_the_default_needs_no_state() -> None:
    text = (Path(__file__).parents[2] / "examples" / "crazyflie.toml").read_text()
    text = text.replace('drive = "command"', 'drive = "command"\nlag = 0.06', 1)
    truth, gusty = (parse_vehicle(text + more, "crazyflie.toml") for more in ("", GUSTS_ROTORS))
    flight = simulate_flight(gusty, maneuver(20.0, *TUMBLING, rate=100.0), seed=1)
    sensed = replace(flight, data=flight.data.drop_vars([*WIND, *EULER], errors="ignore"))
    wrong = {n: {"value": f * truth.value(n), "free": True, "bounds": None} for n, f in WRONG_SMALL.items()}
    result = stoop.fit(truth.with_numbers(wrong), sensed, ["0.5:19.5"]).result
    assert (result.method, result.status) == ("equation-error", "converged")
    assert "no-states-recorded" in {n.code for n in result.notices}
    found = {name: result.parameters[name].estimate for name in WRONG_SMALL}
    assert found == {name: pytest.approx(truth.value(name), rel=0.05) for name in WRONG_SMALL}
    assert np.isfinite([p.std_error for p in result.parameters.values()]).all()


ROTORS = ((1, 0.15, 0.15, "ccw"), (2, -0.15, -0.15, "ccw"), (3, 0.15, -0.15, "cw"), (4, -0.15, 0.15, "cw"))
SPINNING = """
name = "quad"
[mass]
mass = 1.4
inertia = { xx = 0.019, yy = 0.019, zz = 0.03 }
[rotors]
drive = "speed"
gain = 1000.0
lag = 0.0
delay = 0.013
T2 = 1.3e-5
inflow = 3e-4
torque_ratio = 0.019
inertia = 6e-5
""" + "".join(
    f'[rotor.m{i}]\nchannel = "motor_{i}"\nposition = [{x}, {y}, 0.0]\nspin = "{spin}"\n'
    for i, x, y, spin in ROTORS
)
SPINS = maneuver(
    16.0, ("roll", "doublet", 1.0, 0.15, 8.0), ("pitch", "doublet", 2.0, 0.15, 8.0), ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0), ("yaw", "doublet", 7.0, 0.2, 2.0), ("north", "doublet", 8.0, 2.0, 2.5),
    ("east", "doublet", 11.0, 2.0, 2.5), rate=100.0,
)  # fmt: skip
WRONG = {
    "rotors.inertia": {"value": 2e-5, "free": True, "bounds": (1e-6, 3e-4)}, "rotors.torque_ratio": {"value": 0.012},
    "rotors.delay": {"value": 0.005, "free": True, "bounds": (0.0, 0.05)}, "rotors.T2": {"value": 1.2e-5},
}  # fmt: skip


@pytest.mark.parametrize("method", ["equation-error", ""])
def test_what_spins_rotors_up_is_found(method: str) -> None:
    true = parse_vehicle(SPINNING, "quad")
    flight = simulate_flight(true, SPINS, seed=3, name="sim")
    found = stoop.fit(true.with_numbers(WRONG), flight, ["0:16"], options=Options(method=method))
    parameters = found.result.parameters
    assert set(WRONG) <= set(parameters)
    for name, p in parameters.items():
        assert abs(p.estimate - true.value(name)) < 3.5 * p.std_error, name
        assert p.std_error < 0.05 * true.value(name), name


ROTOR, LIFT = 1.3, 0.2  #: true coefficients
LOW_QUAD = builtin_text("quad-x") + f"\n[ground_effect]\nradius = 0.127\nrotor = {ROTOR}\n"
LOW_WING = builtin_text("twin-boom") + f"\n[ground_effect]\nlift = {LIFT}\n"
LOW_HOVER = maneuver(
    20.0, ("down", "doublet", 1.0, 1.5, 0.2), ("roll", "doublet", 6.0, 0.15, 6.0), ("pitch", "doublet", 7.5, 0.15, 6.0),
    ("yaw", "doublet", 9.0, 0.4, 1.0), ("heave", "3-2-1-1", 11.0, 0.25, 1.5), ("down", "doublet", 14.0, 1.5, 0.2),
    altitude=0.45, rate=100.0,
)  # fmt: skip
LOW_PASS = maneuver(
    20.0, ("elevator", "3-2-1-1", 1.0, 0.3, 0.05), ("height", "doublet", 5.0, 2.0, 0.3), ("elevator", "doublet", 12.0, 0.5, 0.05),
    ("height", "doublet", 14.0, 1.5, 0.3), altitude=0.6, rate=100.0,
)  # fmt: skip


@pytest.mark.parametrize(
    ("method", "name", "value", "share"),
    [("equation-error", "rotor", ROTOR, 0.2), ("", "rotor", ROTOR, 0.2), ("", "lift", LIFT, 0.3)],
)
def test_the_ground_effect_is_recovered(method: str, name: str, value: float, share: float) -> None:
    if name == "rotor":
        true, flown, wrong = parse_vehicle(LOW_QUAD, "quad"), LOW_HOVER, {"value": 0.5}
    else:
        true, flown = parse_vehicle(LOW_WING, "wing").reduced("longitudinal"), LOW_PASS
        wrong = {"value": 0.0, "bounds": (-1.0, 1.0)}
    flight = simulate_flight(true, flown, seed=1 if name == "rotor" else 2, name="low")
    start = true.with_numbers({f"ground_effect.{name}": wrong})
    result = stoop.fit(start, flight, ["0:20"], options=Options(method=method)).result
    found = result.parameters[f"ground_effect.{name}"]
    assert abs(found.estimate - value) < 3.5 * found.std_error
    assert found.std_error < share * value


def test_near_the_ground_less_command_holds_the_vehicle_and_far_above_as_much_as_ever() -> None:
    """Cheeseman and Bennett: T / T_free = 1 + (R/4z)^2 to first order, so the hover command falls by that thrust."""
    true, free = parse_vehicle(LOW_QUAD, "quad"), parse_vehicle(builtin_text("quad-x"), "quad")
    near, far = (trim(true, altitude=z) for z in (0.2, 500.0))
    columns = [i for i, c in enumerate(true.recorded) if c.startswith("motor_")]
    np.testing.assert_allclose(far.inputs[columns], trim(free, altitude=500.0).inputs[columns], rtol=1e-6)
    x, quarter2 = near.inputs[columns[0]], (0.127 / 4) ** 2
    sea_level = 4 * (2.5 * x + 6.0 * x * x) * (1.0 + ROTOR * quarter2 / (0.2**2 + quarter2))
    assert sea_level == pytest.approx(1.5 * 9.80665, rel=1e-3)


def with_factor(factor: float) -> Vehicle:
    """The template with one more number, whose value does not change the equations: one kernel for all."""
    head, _, tail = builtin_text("quad-x").partition("[rotor.m3]")
    return parse_vehicle(f"{head}[rotor.m3]\nfactor = {factor}{tail}", "quad.toml")


def hovering(balance: Balance, factor: float, seed: int) -> Hover:
    return hover(simulate_flight(with_factor(factor), WINDY, seed=seed, name=f"{factor}"), balance)


@pytest.mark.parametrize("factor", [0.9, 0.7])
def test_a_known_loss_comes_back(factor: float) -> None:
    balance = Balance(with_factor(1.0))
    reference = Reference(balance, tuple(hovering(balance, 1.0, seed) for seed in (1, 2, 3)))
    found = assess(hovering(balance, factor, 4), reference)
    assert (judge(found).kind, judge(found).rotors) == ("weak or mass", ("m3",))
    assert abs(1.0 - found.suspected.size - factor) < found.suspected.std
    assert judge(assess(hovering(balance, 1.0, 5), reference)).kind == "healthy"

"""NASA NESC 6-DoF check cases (TM-2015-218675): tumbling brick, falling sphere.

Data: simulators 01, 02 and 04 at 10 Hz, see SOURCE.md beside them, over a rotating ellipsoid. What our flat Earth at rest lacks
is subtracted: gravity grows by 2 g / R per metre of fall (g^2 t^3 / 3 R), the rotating Earth holds up omega^2 R of it and turns
the velocity east, omega g t^2. Euler angles are not compared: the NESC's turn with the local vertical.
"""

import csv
from pathlib import Path

import numpy as np
import pytest

from stoop.base.atmosphere import standard_density
from stoop.base.units import DEGREE, FOOT, POUND_FORCE, SLUG
from stoop.vehicle import Vehicle, parse_vehicle

EARTH_RATE = 7.292115e-5  #: rad/s, WGS 84
EQUATOR = 6378137.0  #: m, WGS 84
DENSITY = SLUG / FOOT**3
TOP = 30000.0 * FOOT  #: m, where every case begins, above the equator
Record, Numbers = dict[str, np.ndarray], dict[str, float]
AXES = ("Roll", "Pitch", "Yaw")

# brick_inertia.dml and brick_aero.dml: a 5 lb face brick, rate damping only
BRICK = f"""
name = "NESC brick"
environment.density = "log"
[mass]
mass = {0.155404754 * SLUG!r}
inertia = {{ xx = {0.00189422 * SLUG * FOOT**2!r}, yy = {0.006211019 * SLUG * FOOT**2!r}, zz = {0.007194665 * SLUG * FOOT**2!r} }}
[reference]
area = {0.22222 * FOOT**2!r}
span = {0.33333 * FOOT!r}
chord = {0.66667 * FOOT!r}
airspeed = 100.0
rate_normalization = "actual"
[aerodynamics]
default = false
Cl = {{ Clp = {{ term = "p", value = -1.0 }} }}
Cm = {{ Cmq = {{ term = "q", value = -1.0 }} }}
Cn = {{ Cnr = {{ term = "r", value = -1.0 }} }}
"""
# cannonball_inertia.dml and cannonball_aero.dml: one slug, six inches across, drag only
SPHERE = f"""
name = "NESC cannonball"
mass = {{ mass = {SLUG!r}, inertia = {{ {", ".join(f"{axes} = {3.6 * SLUG * FOOT**2!r}" for axes in ("xx", "yy", "zz"))} }} }}
reference = {{ area = {0.1963495 * FOOT**2!r}, span = 1.0, chord = 1.0, airspeed = 100.0 }}
environment = {{ density = "log" }}
aerodynamics = {{ default = false, CD = {{ CD0 = {{ term = "1", value = 0.1 }} }} }}
"""


def record(shared_data: Path, case: str, simulator: str) -> Record:
    folder = next((shared_data / "nesc-checkcases" / "Atmospheric_checkcases").glob(f"Atmos_{case}_*"))
    with (folder / f"Atmos_{case}_sim_{simulator}.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def speed(data: Record) -> np.ndarray:
    """Return airspeed, m/s (the air turns with the Earth, and there is no wind)."""
    return np.sqrt(sum(data[f"feVelocity_ft_s_{axis}"] ** 2 for axis in "XYZ")) * FOOT


def rates(data: Record) -> np.ndarray:
    return np.array([data[f"bodyAngularRateWrtEi_deg_s_{axis}"] for axis in AXES]).T


def flown(vehicle: Vehicle, data: Record, start: Numbers, changes: Numbers, parts: int) -> np.ndarray:
    t = data["time"]
    fine = np.linspace(t[0], t[-1], (len(t) - 1) * parts + 1)
    density = np.interp(fine, t, data["airDensity_slug_ft3"] * DENSITY)[:, None]
    rows = vehicle.parameter_rows(changes)
    # a body at rest in the air has no direction of flow: begin with a micrometre per second, downwards
    x = vehicle.initial_states({"V": 1e-6, "alpha": np.pi / 2, "h": TOP} | start, rows, density[0])
    return vehicle.kernel().trajectories(rows, x, density, (t[1] - t[0]) / parts)[0, ::parts]


def tumble(data: Record, changes: Numbers, parts: int) -> np.ndarray:
    vehicle = parse_vehicle(BRICK, "brick")
    y = flown(vehicle, data, {"p": 10 * DEGREE, "q": 20 * DEGREE, "r": 30 * DEGREE}, changes, parts)
    return np.degrees(y[:, [vehicle.outputs.index(c) for c in "pqr"]])


def effective_gravity(data: Record) -> float:
    """Return what accelerates the body at the start, m/s2: gravity less omega^2 R."""
    return float(data["localGravity_ft_s2"][0] * FOOT - EARTH_RATE**2 * (EQUATOR + TOP))


def test_02_and_03_tumbling(shared_data: Path) -> None:
    """Without damping within 1e-8 deg/s over 30 s; with it within 7e-4 of 30 deg/s, as gravity is taken as constant."""
    free, damped = (record(shared_data, case, "04") for case in ("02", "03"))
    found = tumble(free, {"Clp": 0.0, "Cmq": 0.0, "Cnr": 0.0}, 100)
    assert np.abs(found - rates(free)).max() < 1e-8
    assert np.ptp(rates(free), axis=0).min() > 5.0, "it does tumble"
    found = tumble(damped, {"environment.gravity": effective_gravity(damped)}, 20)
    assert np.abs(found - rates(damped)).max() < 7e-4
    assert np.abs(rates(damped)[-1]).max() < 1e-4, "it has come to rest"


def test_03_moments_at_the_recorded_states(shared_data: Path) -> None:
    """No Earth model at all: simulator 04's moments to 1e-4 of the largest, its pitching moment to 1e-9."""
    data, vehicle = record(shared_data, "03", "04"), parse_vehicle(BRICK, "brick")
    n = len(data["time"]) - 1  # at the first sample there is no airspeed
    p, q, r = rates(data)[1:].T * DEGREE
    u = (data["airDensity_slug_ft3"] * DENSITY)[None, 1:]
    rows = vehicle.parameter_rows(None, n)
    start = {"V": speed(data)[1:], "alpha": 0.3, "beta": 0.2, "p": p, "q": q, "r": r}
    x = vehicle.initial_states(start, rows, u)
    turning = vehicle.kernel().evaluate(rows, x, u)[0][[vehicle.states.index(c) for c in "pqr"]]
    inertia = np.array([vehicle.value(f"mass.inertia.{a}") for a in ("xx", "yy", "zz")])[:, None]
    omega = np.array([p, q, r])
    moment = inertia * turning + np.cross(omega, inertia * omega, axis=0)
    for i, (axis, tolerance) in enumerate((("L", 2e-4), ("M", 1e-9), ("N", 2e-4))):
        printed = data[f"aero_bodyMoment_ftlbf_{axis}"][1:] * POUND_FORCE * FOOT
        assert np.abs(moment[i] - printed).max() < tolerance * np.abs(printed).max(), axis


def falling(data: Record, density: str, changes: Numbers) -> np.ndarray:
    vehicle = parse_vehicle(SPHERE.replace('"log"', f'"{density}"'), "sphere")
    return flown(vehicle, data, {}, changes, 10)[:, vehicle.outputs.index("V")]


def test_01_drop_without_drag(shared_data: Path) -> None:
    """The flat-earth part, and what the Earth adds, each by its formula."""
    data = record(shared_data, "01", "04")
    g = effective_gravity(data)
    down, t = falling(data, "log", {"environment.gravity": g, "CD0": 0.0}), data["time"]
    assert down == pytest.approx(g * t, abs=1e-5), "free fall"
    growing = g * g * t**3 / (3 * (EQUATOR + TOP))  # gravity over the fall
    their = data["feVelocity_ft_s_Z"] * FOOT
    assert np.abs(their - down).max() == pytest.approx(growing[-1], rel=2e-3)
    assert their == pytest.approx(down + growing, abs=2e-4)
    assert data["feVelocity_ft_s_Y"] * FOOT == pytest.approx(EARTH_RATE * g * t**2, abs=5e-4)


def test_06_drag_at_the_recorded_states(shared_data: Path) -> None:
    data, vehicle = record(shared_data, "06", "01"), parse_vehicle(SPHERE, "sphere")
    n = len(data["time"]) - 1
    u = (data["airDensity_slug_ft3"] * DENSITY)[None, 1:]
    rows = vehicle.parameter_rows(None, n)
    x = vehicle.initial_states({"V": speed(data)[1:], "alpha": np.pi / 2}, rows, u)
    felt = vehicle.kernel().evaluate(rows, x, u)[1][[vehicle.outputs.index(c) for c in ("ax", "ay", "az")]]
    force = np.linalg.norm(felt, axis=0) * vehicle.value("mass.mass")
    printed = np.sqrt(sum(data[f"aero_bodyForce_lbf_{axis}"][1:] ** 2 for axis in "XYZ")) * POUND_FORCE
    assert force == pytest.approx(printed, rel=1e-8, abs=1e-9)


def test_06_fall_in_the_standard_atmosphere(shared_data: Path) -> None:
    """The whole fall on a flat Earth: 0.11 m/s slower, 0.9 m higher after 4180 m, for want of growing gravity."""
    data = record(shared_data, "06", "04")
    V = falling(data, "standard", {"environment.gravity": effective_gravity(data)})
    printed = data["airDensity_slug_ft3"] * DENSITY  # simulator 04 computes the 1976 standard
    assert standard_density(data["altitudeMsl_ft"] * FOOT) == pytest.approx(printed, rel=1e-6)
    assert V[-1] - speed(data)[-1] == pytest.approx(-0.115, abs=0.01)
    fallen = np.concatenate([[0.0], np.cumsum(0.5 * (V[1:] + V[:-1]) * 0.1)])
    assert TOP - fallen[-1] - data["altitudeMsl_ft"][-1] * FOOT == pytest.approx(0.9, abs=0.1)

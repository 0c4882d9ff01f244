"""The compiled model against its plain twin: every feature of the vehicle file, in all three reductions.

The twin turns a rotation matrix where the model turns a quaternion, so the steps are kept so short that what
the integrator leaves is far below the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from naive import march
from naive.aircraft import Aircraft
from naive.texts import V_TAIL_LATERAL, V_TAIL_MIXERS

from stoop.simulation import initial_states, parameter_rows
from stoop.vehicle import Vehicle, parse_vehicle

DT, SECONDS = 0.003, 0.9
N = round(SECONDS / DT) + 1
RTOL = 1e-9

PLAIN = """
[mass]
mass = 189.4
inertia = { xx = 100.0, yy = 120.0, zz = 200.0, xz = 5.0 }
[reference]
area = 2.8667
chord = 0.55
span = 5.19
airspeed = 35.0
[environment]
density = 1.2
[propulsion]
kind = "constant"
thrust = 220.87
"""
COEFFICIENTS = """
[aerodynamics.CD]
CD0 = 0.06
CDalpha = 0.43
CDalpha2 = 1.2
CDV = 0.02
[aerodynamics.CL]
CL0 = 0.385
CLalpha = 4.78
CLq = 10.47
CLV = 0.05
CLelevator = 0.201
[aerodynamics.Cm]
Cm0 = 0.194
Cmalpha = -2.12
Cmq = -47.6
CmV = 0.03
Cmelevator = -0.8
[aerodynamics.CQ]
CQ0 = 0.004
CQbeta = -0.35
CQp = 0.06
CQr = 0.22
CQrudder = 0.12
CQV = 0.01
[aerodynamics.Cl]
Cl0 = 0.0008
Clbeta = -0.055
Clp = -0.48
Clr = 0.11
Claileron = 0.15
Clrudder = 0.012
[aerodynamics.Cn]
Cn0 = -0.0006
Cnbeta = 0.085
Cnp = -0.035
Cnr = -0.13
Cnaileron = -0.012
Cnrudder = -0.075
"""
RICH = (
    """
[mass]
mass = 8.5
inertia = { xx = 1.38, yy = 0.84, zz = 2.0, xz = 0.11 }
center_of_gravity = [0.31, 0.0, -0.02]
[reference]
area = 0.66
chord = 0.285
span = 2.32
airspeed = 24.0
alpha = 0.05
moment_point = [0.26, 0.0, 0.01]
rate_normalization = "actual"
[propulsion]
kind = "propeller"
channel = "throttle"
idle = 0.05
speed_gain = 150.0
diameter = 0.4
CT0 = 0.14
CT1 = -0.10
CT2 = -0.02
inertia = 0.02
position = [0.75, 0.0, -0.04]
pitch = 0.06
"""
    + V_TAIL_MIXERS
    + """lag = "=controls.elevator.lag"
[controls.aileron]
offset = 0.02
[sensors]
accelerometer_position = [0.4, 0.1, 0.05]
vane_position = [0.9, -0.2, 0.0]
imu_alignment = [0.04, -0.06, 0.3]
wind_error = [1.5, -0.7, 0.2]
V = { scale = 1.03, bias = 0.4 }
alpha = { scale = 0.97, bias = 0.01 }
beta = { bias = -0.02 }
p = { bias = 0.003 }
theta = { scale = 1.01 }
psi = { bias = 0.05 }
az = { scale = 0.99, bias = 0.2 }
"""
)
RICH_TERMS = (
    """
[aerodynamics.CL]
CL0 = 0.4
CLalpha = 4.9
CLq = 5.0
CLV = false
CLelevator = 0.3
CLbend = { term = "-alpha^2*(1 - 2*alpha)", value = 3.0 }
[aerodynamics.CD]
CD0 = 0.05
CDalpha = 0.2
CDalpha2 = 0.8
CDbrake = { term = "abs(elevator)", value = 0.1 }
[aerodynamics.Cm]
Cm0 = 0.02
Cmalpha = -0.9
Cmq = -12.0
Cmelevator = -1.0
Cmcross = { term = "alpha*elevator/(1 + V^2)", value = 0.7 }
"""
    + V_TAIL_LATERAL
    + """Cnstiff = { term = "abs(beta)*beta", value = 0.5 }
Cnmixed = { term = "elevator*beta + q*alpha*rudder", value = 0.2 }
"""
)
RICH_EXTRA: dict[str, Callable[[Mapping[str, float]], float]] = {
    "CLbend": lambda v: -(v["alpha"] ** 2) * (1 - 2 * v["alpha"]),
    "CDbrake": lambda v: abs(v["elevator"]),
    "Cmcross": lambda v: v["alpha"] * v["elevator"] / (1 + v["V"] * v["V"]),
    "Cnstiff": lambda v: abs(v["beta"]) * v["beta"],
    "Cnmixed": lambda v: v["elevator"] * v["beta"] + v["q"] * v["alpha"] * v["rudder"],
}
LOGGED = """
[mass]
mass = 12.0
inertia = { xx = 1.2, yy = 1.5, zz = 2.3, xz = 0.1, xy = -0.07, yz = 0.05 }
[reference]
area = 0.7
chord = 0.3
span = 2.4
airspeed = 22.0
[environment]
density = "log"
gravity = 9.81
[propulsion]
kind = "channel"
scale = 0.95
position = [0.3, 0.05, -0.1]
"""
NAME = 'name = "twin"\n'


@dataclass(frozen=True)
class Case:
    text: str
    inputs: Mapping[str, tuple[float, float]]  #: channel -> mean and swing
    start: Mapping[str, float]
    extra: Mapping[str, Callable[[Mapping[str, float]], float]] = field(default_factory=dict)


SURFACES = {"elevator": (-0.03, 0.06), "aileron": (0.0, 0.08), "rudder": (0.0, 0.1)}
LEVEL = {"V": 36.0, "alpha": 0.1, "theta": 0.12, "q": 0.03, "h": 200.0}
TURNED = LEVEL | {"beta": 0.05, "p": 0.2, "r": -0.1, "phi": 0.5, "psi": 3.0}
PWM = {"pwm_3": (1490.0, 60.0), "pwm_4": (1500.0, 50.0), "aileron": (0.0, 0.05), "throttle": (0.4, 0.45)}
SMALL = TURNED | {"V": 24.0}
CASES = {
    "plain": Case(NAME + PLAIN + COEFFICIENTS, SURFACES, TURNED),
    "plain longitudinal": Case(f'{NAME}[model]\nreduce = "longitudinal"\n{PLAIN}{COEFFICIENTS}', SURFACES, LEVEL),
    "plain lateral": Case(f'{NAME}[model]\nreduce = "lateral"\n{PLAIN}{COEFFICIENTS}', SURFACES, TURNED | {"q": 0.0}),
    "plain, for a stated inertia": Case(
        NAME + PLAIN.replace("[environment]", "inertia = [80.0, 150.0, 190.0]\n[environment]") + COEFFICIENTS,
        SURFACES,
        TURNED,
    ),
    "rich": Case(NAME + RICH + RICH_TERMS, PWM, SMALL, RICH_EXTRA),
    "rich longitudinal": Case(
        f'{NAME}[model]\nreduce = "longitudinal"\n{RICH}{RICH_TERMS}', PWM, LEVEL | {"V": 24.0}, RICH_EXTRA
    ),
    "logged": Case(
        NAME + LOGGED + COEFFICIENTS, SURFACES | {"thrust": (20.0, 10.0), "density": (1.1, 0.05)}, TURNED | {"V": 22.0}
    ),
}  # fmt: skip


def recorded(case: Case, vehicle: Vehicle) -> np.ndarray:
    """Return smooth inputs (N, n_u) with corners, different on each channel."""
    t = np.arange(N) * DT
    columns = []
    for i, name in enumerate(vehicle.inputs):
        mean, swing = case.inputs[name]
        columns.append(mean + swing * (0.7 * np.sin((2.0 + i) * t + i) + 0.3 * np.sign(np.sin(5.0 * t + i))))
    return np.array(columns).T


def changed(vehicle: Vehicle, count: int) -> list[dict[str, float]]:
    """Return candidates whose every number differs by some per cent."""
    rng = np.random.default_rng(7)
    skipped = ("controls.elevator.center", "controls.rudder.center")
    return [
        {p.name: p.value * f + (0.002 if p.value == 0 and "." not in p.name else 0.0)
         for p, f in zip(vehicle.parameters, rng.uniform(0.96, 1.04, len(vehicle.parameters)), strict=True)
         if not p.name.startswith(skipped)}
        for _ in range(count)
    ]  # fmt: skip


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Case, Vehicle]:
    chosen = CASES[request.param]
    return chosen, parse_vehicle(chosen.text, request.param)


def test_trajectories_and_cost(case: tuple[Case, Vehicle]) -> None:
    spec, vehicle = case
    u = recorded(spec, vehicle)
    named = [dict(zip(vehicle.inputs, row, strict=True)) for row in u]
    candidates = changed(vehicle, 2)
    rows = parameter_rows(
        vehicle, {name: np.array([c[name] for c in candidates]) for name in candidates[0]}, 2
    )
    start = initial_states(vehicle, spec.start, rows, u[0])
    y = vehicle.kernel().trajectories(rows, start, u, DT)
    expected = np.array([fly(spec, c, u, named[0], vehicle.inputs) for c in candidates])
    size = np.abs(expected).max(axis=(0, 1))
    assert np.isfinite(expected).all()
    assert (np.ptp(expected, axis=1) > 1e-4 * size).all(), "every channel moves"
    np.testing.assert_allclose(y / size, expected / size, rtol=0, atol=RTOL)

    rng = np.random.default_rng(3)
    z = expected[0] + 0.02 * size * rng.standard_normal(expected[0].shape)
    w = np.where(rng.uniform(size=z.shape) < 0.9, 1.0 / size**2, 0.0)
    wrapped = tuple(c in ("phi", "psi") for c in vehicle.outputs)
    J = vehicle.kernel().cost(rows, start, u, z, w, DT)
    np.testing.assert_allclose(J, [march.cost(e, z, w, wrapped) for e in expected], rtol=1e-7)


def fly(
    spec: Case, changes: dict[str, float], u: np.ndarray, first: dict[str, float], names: tuple[str, ...]
) -> np.ndarray:
    twin = Aircraft(spec.text, changes, spec.extra)

    def name(row: np.ndarray) -> dict[str, float]:
        return dict(zip(names, row.tolist(), strict=True))

    return march.march(
        lambda x, v: twin.rates(x, name(v)),
        lambda x, v: twin.readings(x, name(v)),
        twin.start(spec.start, first), u, DT,
    )  # fmt: skip


def test_single_points(case: tuple[Case, Vehicle]) -> None:
    """Rates and readings at random states, far from trim, without an integrator."""
    spec, vehicle = case
    rng = np.random.default_rng(11)
    count = 20
    spread = {
        "V": 3.0,
        "alpha": 0.3,
        "beta": 0.3,
        "p": 1.0,
        "q": 1.0,
        "r": 1.0,
        "phi": 1.5,
        "theta": 1.2,
        "psi": 3.0,
        "h": 900.0,
    }
    zero = {"full": (), "longitudinal": ("beta", "p", "r", "phi", "psi"), "lateral": ("q",)}[vehicle.reduce]
    start = {
        k: spec.start.get(k, 0.0) + s * rng.uniform(-1, 1, count) * (k not in zero) for k, s in spread.items()
    }
    u = np.array([m + s * rng.uniform(-1, 1, count) for m, s in (spec.inputs[c] for c in vehicle.inputs)])
    rows = parameter_rows(vehicle, None, count)
    x = initial_states(vehicle, start, rows, u)
    lagged = [i for i, s in enumerate(vehicle.states) if s.endswith(".lag")]
    x[lagged] += rng.uniform(-0.1, 0.1, (len(lagged), count))
    d, y = vehicle.kernel().evaluate(rows, x, u)
    twin = Aircraft(spec.text, {}, spec.extra)
    plain = {"u": 0, "v": 1, "w": 2, "p": 3, "q": 4, "r": 5, "h": 15}
    for b in range(count):
        named = dict(zip(vehicle.inputs, u[:, b].tolist(), strict=True))
        s = twin.start({k: float(v[b]) for k, v in start.items()}, named)
        s[16:] = [x[vehicle.states.index(f"{c}.lag"), b] for c in twin.lagged if f"{c}.lag" in vehicle.states]
        rates = twin.rates(s, named)
        for i, state in enumerate(vehicle.states):
            if state in plain:
                assert d[i, b] == pytest.approx(rates[plain[state]], rel=1e-10, abs=1e-10), state
        for i, c in enumerate(f"{c}.lag" for c in twin.lagged):
            if c in vehicle.states:
                assert d[vehicle.states.index(c), b] == pytest.approx(rates[16 + i], rel=1e-11, abs=1e-11)
        np.testing.assert_allclose(y[:, b], twin.readings(s, named), rtol=1e-10, atol=1e-10)


def test_all_lanes_at_any_place_agree_bit_for_bit() -> None:
    spec = CASES["plain"]
    vehicle = parse_vehicle(spec.text, "plain")
    u = recorded(spec, vehicle)[:100]
    candidates = changed(vehicle, 19)
    rows = parameter_rows(
        vehicle, {name: np.array([c[name] for c in candidates]) for name in candidates[0]}, 19
    )
    start = initial_states(vehicle, spec.start, rows, u[0])
    kernel = vehicle.kernel()
    z, w = np.zeros((100, 12)), np.ones((100, 12))
    J = kernel.cost(rows, start, u, z, w, DT, threads=1)
    assert all(np.array_equal(kernel.cost(rows, start, u, z, w, DT, threads=k), J) for k in (2, 3, 8))
    back = slice(None, None, -1)
    assert np.array_equal(kernel.cost(rows[:, back], start[:, back], u, z, w, DT), J[back])
    assert np.array_equal(kernel.cost(rows[:, 4:5], start[:, 4:5], u, z, w, DT), J[4:5])
    wild = rows.copy()
    wild[vehicle.rows["Cmq"], 3] = 1e12
    after = kernel.cost(wild, start, u, z, w, DT)
    assert np.isposinf(after[3])
    assert np.array_equal(np.delete(after, 3), np.delete(J, 3))

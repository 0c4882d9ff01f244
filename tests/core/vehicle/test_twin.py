"""The compiled model against its plain twin: every feature of the vehicle file, in all three reductions."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from naive import march
from naive.aircraft import Aircraft, rotation
from naive.texts import V_TAIL_LATERAL, V_TAIL_MIXERS

from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.channels import motion_input

DT, N = 0.003, 101  #: short steps: the twin turns a rotation matrix where the model turns a quaternion
RTOL = 1e-9
TWIN_BOOM = builtin_text("twin-boom")
for name, value in (("CDalpha2", 1.2), ("CDV", 0.02), ("CLV", 0.05), ("CmV", 0.03)):
    TWIN_BOOM = TWIN_BOOM.replace(f"{name} = 0.0", f"{name} = {value}")
COEFFICIENTS = TWIN_BOOM[TWIN_BOOM.index("[aerodynamics.CD]") :]
RICH = (
    """
mass = { mass = 8.5, inertia = { xx = 1.38, yy = 0.84, zz = 2.0, xz = 0.11 }, center_of_gravity = [0.31, 0.0, -0.02] }
reference = { area = 0.66, chord = 0.285, span = 2.32, airspeed = 24.0, alpha = 0.05, \
    moment_point = [0.26, 0.0, 0.01], rate_normalization = "actual" }
propulsion = { kind = "propeller", channel = "throttle", idle = 0.05, speed_gain = 150.0, diameter = 0.4, \
    CT0 = 0.14, CT1 = -0.10, CT2 = -0.02, inertia = 0.02, position = [0.75, 0.0, -0.04], pitch = 0.06 }
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
[aerodynamics]
CL = { CL0 = 0.4, CLalpha = 4.9, CLq = 5.0, CLV = false, CLelevator = 0.3, \
    CLbend = { term = "-alpha^2*(1 - 2*alpha)", value = 3.0 } }
CD = { CD0 = 0.05, CDalpha = 0.2, CDalpha2 = 0.8, CDbrake = { term = "abs(elevator)", value = 0.1 } }
Cm = { Cm0 = 0.02, Cmalpha = -0.9, Cmq = -12.0, Cmelevator = -1.0, \
    Cmcross = { term = "alpha*elevator/(1 + V^2)", value = 0.7 } }
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
mass = { mass = 12.0, inertia = { xx = 1.2, yy = 1.5, zz = 2.3, xz = 0.1, xy = -0.07, yz = 0.05 } }
reference = { area = 0.7, chord = 0.3, span = 2.4, airspeed = 22.0 }
environment = { density = "log", gravity = 9.81 }
propulsion = { kind = "channel", scale = 0.95, position = [0.3, 0.05, -0.1] }
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
LONGITUDINAL = 'model = { reduce = "longitudinal" }'
REDUCED = '[model]\nreduce = "{}"\n[mass]'
STATED = "inertia = [80.0, 150.0, 190.0]\n[environment]"
LOGS = {"thrust": (20.0, 10.0), "density": (1.1, 0.05)}
CASES = {
    "plain": Case(TWIN_BOOM, SURFACES, TURNED),
    "plain longitudinal": Case(TWIN_BOOM.replace("[mass]", REDUCED.format("longitudinal")), SURFACES, LEVEL),
    "plain lateral": Case(TWIN_BOOM.replace("[mass]", REDUCED.format("lateral")), SURFACES, TURNED | {"q": 0.0}),
    "plain, for a stated inertia": Case(TWIN_BOOM.replace("[environment]", STATED), SURFACES, TURNED),
    "rich": Case(NAME + RICH + RICH_TERMS, PWM, SMALL, RICH_EXTRA),
    "rich longitudinal": Case(NAME + LONGITUDINAL + RICH + RICH_TERMS, PWM, LEVEL | {"V": 24.0}, RICH_EXTRA),
    "logged": Case(NAME + LOGGED + COEFFICIENTS, SURFACES | LOGS, TURNED | {"V": 22.0}),
}  # fmt: skip


def changed(vehicle: Vehicle, count: int) -> list[dict[str, float]]:
    rng = np.random.default_rng(7)
    skipped = ("controls.elevator.center", "controls.rudder.center")
    return [
        {p.name: p.value * f + (0.002 if p.value == 0 and "." not in p.name else 0.0)
         for p, f in zip(vehicle.parameters, rng.uniform(0.96, 1.04, len(vehicle.parameters)), strict=True)
         if not p.name.startswith(skipped)}
        for _ in range(count)
    ]  # fmt: skip


def flown(twin: Any, names: Any, start: Mapping[str, float], u: np.ndarray, dt: float) -> np.ndarray:
    def name(row: np.ndarray) -> dict[str, float]:
        return dict(zip(names, row.tolist(), strict=True))

    rates, readings = (lambda x, v, f=f: f(x, name(v)) for f in (twin.rates, twin.readings))
    return march.march(rates, readings, twin.start(start, name(u[0])), u, dt)


def check_points(vehicle: Vehicle, twin: Any, start: Any, u: np.ndarray, rtol: float, off: Any) -> None:
    """Compare rates and readings at states where lags are off their commands, (n, count), without an integrator."""
    rows = vehicle.parameter_rows(None, u.shape[1])
    x = vehicle.initial_states(start, rows, u)
    lags = [i for i, s in enumerate(vehicle.states) if s.endswith(".lag")]
    x[lags] += off(x[lags].shape)
    d, y = vehicle.kernel().evaluate(rows, x, u)
    plain = {"u": 0, "v": 1, "w": 2, "p": 3, "q": 4, "r": 5, "h": 15}
    known = [i for i, s in enumerate(vehicle.states) if s in plain]
    for b in range(u.shape[1]):
        named = dict(zip(vehicle.inputs, u[:, b].tolist(), strict=True))
        s = twin.start({k: float(v[b]) for k, v in start.items()}, named)
        s[16:] = x[lags, b]
        rates = twin.rates(s, named)
        wanted = rates[[plain[vehicle.states[i]] for i in known]]
        np.testing.assert_allclose(d[known, b], wanted, rtol=rtol, atol=rtol)
        np.testing.assert_allclose(d[lags, b], rates[16 : 16 + len(lags)], rtol=0.1 * rtol, atol=0.1 * rtol)
        np.testing.assert_allclose(y[:, b], twin.readings(s, named), rtol=rtol, atol=rtol)


@pytest.mark.parametrize("name", ["plain", "plain lateral", "rich"])
def test_trajectories_and_cost(name: str) -> None:
    spec = CASES[name]
    vehicle = parse_vehicle(spec.text, name)
    t, candidates = np.arange(N) * DT, changed(vehicle, 2)
    means, swings = np.array([spec.inputs[name] for name in vehicle.inputs]).T
    waves = [0.7 * np.sin((2.0 + i) * t + i) + 0.3 * np.sign(np.sin(5.0 * t + i)) for i in range(len(means))]
    u = means + swings * np.array(waves).T  # smooth, with corners, different on each channel
    rows = vehicle.parameter_rows({n: np.array([c[n] for c in candidates]) for n in candidates[0]}, 2)
    start = vehicle.initial_states(spec.start, rows, u[0])
    y = vehicle.kernel().trajectories(rows, start, u, DT)
    twins = [Aircraft(spec.text, c, spec.extra) for c in candidates]
    expected = np.array([flown(twin, vehicle.inputs, spec.start, u, DT) for twin in twins])
    size = np.abs(expected).max(axis=(0, 1))
    assert (np.ptp(expected, axis=1) > 1e-4 * size).all(), "every channel moves"
    np.testing.assert_allclose(y / size, expected / size, rtol=0, atol=RTOL)

    rng = np.random.default_rng(3)
    z = expected[0] + 0.02 * size * rng.standard_normal(expected[0].shape)
    w = np.where(rng.uniform(size=z.shape) < 0.9, 1.0 / size**2, 0.0)
    wrapped = tuple(c in ("phi", "psi") for c in vehicle.outputs)
    J = vehicle.kernel().cost(rows, start, u, z, w, DT)
    np.testing.assert_allclose(J, [march.cost(e, z, w, wrapped) for e in expected], rtol=1e-7)


@pytest.mark.parametrize("name", CASES)
def test_single_points(name: str) -> None:
    spec, rng, count = CASES[name], np.random.default_rng(11), 12
    vehicle = parse_vehicle(spec.text, name)
    spread = {"V": 3.0, "alpha": 0.3, "beta": 0.3, "phi": 1.5, "theta": 1.2, "psi": 3.0, "h": 900.0}
    spread |= dict.fromkeys("pqr", 1.0)
    zero = {"full": (), "longitudinal": ("beta", "p", "r", "phi", "psi"), "lateral": ("q",)}[vehicle.reduce]
    off = {k: s * rng.uniform(-1, 1, count) * (k not in zero) for k, s in spread.items()}
    start = {k: spec.start.get(k, 0.0) + x for k, x in off.items()}
    u = np.array([m + s * rng.uniform(-1, 1, count) for m, s in (spec.inputs[c] for c in vehicle.inputs)])
    twin = Aircraft(spec.text, {}, spec.extra)
    check_points(vehicle, twin, start, u, 1e-10, lambda shape: rng.uniform(-0.1, 0.1, shape))


HELD_DT, HELD_N = 0.002, 200  #: s; a step's error in the attitude, of other coordinates, is below `RTOL`
ANGLE = {"longitudinal": "phi", "lateral": "theta"}
HELD = {
    m: (*held, f"sin_{ANGLE[m]}", f"cos_{ANGLE[m]}")
    for m, held in {"longitudinal": "vpr", "lateral": "uwq"}.items()
}
PLACES = {name: i for i, name in enumerate("uvwpqr")}
HELD_MODELS = {"plain lateral": ("lateral", SURFACES), "rich longitudinal": ("longitudinal", PWM)}


class Decoupled:
    """The full aircraft: held states come from the inputs, the attitude is Euler angles."""

    def __init__(self, case: Case, reduce: str, changes: dict[str, float], names: tuple[str, ...]) -> None:
        self.twin, self.reduce, self.names = Aircraft(case.text, changes, case.extra), reduce, names
        self.kept = self.twin.reduce
        self.angle = ANGLE[reduce]

    def whole(self, x: np.ndarray, u: dict[str, float]) -> tuple[np.ndarray, dict[str, float]]:
        """Return the naive state of x = [6 velocities and rates, phi, theta, psi, h, lags], and its angles."""
        x = x.copy()
        for name in (n for n in HELD[self.reduce] if n in PLACES):
            x[PLACES[name]] = u[motion_input(name)]
        angles = dict(zip(("phi", "theta", "psi"), x[6:9], strict=True))
        sine, cosine = (u[motion_input(f"{f}_{self.angle}")] for f in ("sin", "cos"))
        R = rotation(**(angles | {self.angle: 0.0}))
        turned = {"phi": [[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]],
                  "theta": [[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]}[self.angle]  # fmt: skip
        if self.angle == "phi":
            R = R @ np.array(turned)
        else:  # between yaw and roll; sine and cosine between samples are not quite of an angle
            R = rotation(0.0, 0.0, angles["psi"]) @ np.array(turned) @ rotation(angles["phi"], 0.0, 0.0)
        return np.concatenate([x[:6], R.ravel(), x[9:]]), angles

    def rates(self, x: np.ndarray, row: np.ndarray) -> np.ndarray:
        u = dict(zip(self.names, row.tolist(), strict=True))
        whole, angles = self.whole(x, u)
        # nothing is held there; longitudinal is without CQ, Cl, Cn
        self.twin.reduce = "longitudinal" if self.reduce == "longitudinal" else "full"
        found = self.twin.rates(whole, u)
        self.twin.reduce = self.kept
        p, q, r = whole[3:6]
        trig = {a: (math.sin(angles[a]), math.cos(angles[a])) for a in ("phi", "theta")}
        trig[self.angle] = tuple(u[motion_input(f"{f}_{self.angle}")] for f in ("sin", "cos"))
        (sf, cf), (st, ct) = trig["phi"], trig["theta"]
        turn = (q * sf + r * cf) / ct
        euler = np.array([p + st * turn, q * cf - r * sf, turn])
        euler[{"longitudinal": [0, 2], "lateral": [1]}[self.reduce]] = 0.0
        return np.concatenate([found[:6], euler, found[15:]])

    def readings(self, x: np.ndarray, row: np.ndarray) -> np.ndarray:
        u = dict(zip(self.names, row.tolist(), strict=True))
        return self.twin.readings(self.whole(x, u)[0], u)


@pytest.mark.parametrize("name", HELD_MODELS)
def test_held_states_follow_the_record(name: str) -> None:
    case, (reduce, inputs) = CASES[name], HELD_MODELS[name]
    plain = parse_vehicle(case.text, name)
    vehicle = plain.coupled_to(plain.held_channels)
    assert set(vehicle.motion) == {motion_input(n) for n in HELD[reduce]}
    # surfaces, and a motion of the held states that no airplane flies
    t = np.arange(HELD_N) * HELD_DT
    motion = {
        "u": 33.0 + 3.0 * np.sin(3.0 * t), "v": 2.0 * np.sin(5.0 * t), "w": 3.0 + 1.5 * np.cos(4.0 * t),
        "p": 0.5 * np.sin(6.0 * t + 1.0), "q": 0.3 * np.cos(7.0 * t), "r": 0.2 * np.sin(4.0 * t + 2.0),
    }  # fmt: skip
    angle = 0.3 + 0.4 * np.sin(2.5 * t)
    motion |= {f"sin_{ANGLE[reduce]}": np.sin(angle), f"cos_{ANGLE[reduce]}": np.cos(angle)}
    told = {motion_input(n): motion[n] for n in HELD[reduce]}
    told |= {n: m + s * np.sin((2.0 + i) * t + i) for i, (n, (m, s)) in enumerate(inputs.items())}
    u = np.column_stack([told[name] for name in vehicle.inputs])
    (changes,) = changed(vehicle, 1)
    rows = vehicle.parameter_rows({n: np.array([v]) for n, v in changes.items()}, 1)
    begin = TURNED | {"V": 34.0}
    states = vehicle.initial_states(begin, rows, u[0])
    y = vehicle.kernel().trajectories(rows, states, u, HELD_DT)[0]

    twin = Decoupled(case, reduce, changes, vehicle.inputs)
    first = dict(zip(vehicle.inputs, u[0].tolist(), strict=True))
    start = twin.twin.start(begin, first)
    angles = [begin[n] if n in vehicle.modeled_angles else 0.0 for n in ("phi", "theta", "psi")]
    x = np.concatenate([start[:6], angles, start[15:]])
    expected = march.march(twin.rates, twin.readings, x, u, HELD_DT)
    size = np.abs(expected).max(axis=0)
    assert (np.ptp(expected, axis=0) > 1e-3 * size).all(), "every channel moves"
    np.testing.assert_allclose(y / size, expected / size, rtol=0, atol=RTOL)

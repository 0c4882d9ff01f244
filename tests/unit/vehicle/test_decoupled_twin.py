"""Reduced models with states from the record, against the full naive equations whose held states are overwritten."""

from __future__ import annotations

import math

import numpy as np
import pytest
from naive import march
from naive.aircraft import Aircraft, rotation
from unit.vehicle.test_twin import CASES, PWM, SURFACES, TURNED, Case, changed

from stoop.simulation import initial_states, parameter_rows
from stoop.vehicle.load import parse_vehicle
from stoop.vehicle.vehicle import motion_input

#: s; a step's error in the attitude, of which the two integrate other coordinates, is below `RTOL`
DT = 0.002
N = 200
RTOL = 1e-9
HELD = {
    "longitudinal": ("v", "p", "r", "sin_phi", "cos_phi"),
    "lateral": ("u", "w", "q", "sin_theta", "cos_theta"),
}
ANGLE = {"longitudinal": "phi", "lateral": "theta"}
PLACES = {name: i for i, name in enumerate(("u", "v", "w", "p", "q", "r"))}
REDUCED = {"plain lateral": ("lateral", SURFACES), "rich longitudinal": ("longitudinal", PWM)}


def record(reduce: str, names: tuple[str, ...], inputs: dict[str, tuple[float, float]]) -> np.ndarray:
    """Return inputs (N, n_u): surfaces, and a motion of the held states that no airplane flies."""
    t = np.arange(N) * DT
    motion = {
        "u": 33.0 + 3.0 * np.sin(3.0 * t), "v": 2.0 * np.sin(5.0 * t), "w": 3.0 + 1.5 * np.cos(4.0 * t),
        "p": 0.5 * np.sin(6.0 * t + 1.0), "q": 0.3 * np.cos(7.0 * t), "r": 0.2 * np.sin(4.0 * t + 2.0),
    }  # fmt: skip
    angle = 0.3 + 0.4 * np.sin(2.5 * t)
    motion |= {f"sin_{ANGLE[reduce]}": np.sin(angle), f"cos_{ANGLE[reduce]}": np.cos(angle)}
    columns = {motion_input(n): motion[n] for n in HELD[reduce]}
    for i, (name, (mean, swing)) in enumerate(inputs.items()):
        columns[name] = mean + swing * np.sin((2.0 + i) * t + i)
    return np.column_stack([columns[n] for n in names])


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
        self.twin.reduce = "full"  # nothing is held there
        if self.reduce == "longitudinal":
            self.twin.reduce = "longitudinal"  # without CQ, Cl, Cn
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


@pytest.mark.parametrize("name", REDUCED)
def test_held_states_follow_the_record(name: str) -> None:
    case, (reduce, inputs) = CASES[name], REDUCED[name]
    plain = parse_vehicle(case.text, name)
    vehicle = plain.coupled_to(plain.held_channels)
    assert set(vehicle.motion) == {motion_input(n) for n in HELD[reduce]}
    u = record(reduce, vehicle.inputs, inputs)
    (changes,) = changed(vehicle, 1)
    rows = parameter_rows(vehicle, {n: np.array([v]) for n, v in changes.items()}, 1)
    begin = TURNED | {"V": 34.0}
    states = initial_states(vehicle, begin, rows, u[0])
    y = vehicle.kernel().trajectories(rows, states, u, DT)[0]

    twin = Decoupled(case, reduce, changes, vehicle.inputs)
    first = dict(zip(vehicle.inputs, u[0].tolist(), strict=True))
    start = twin.twin.start(begin, first)
    angles = [begin[n] if n in vehicle.modeled_angles else 0.0 for n in ("phi", "theta", "psi")]
    x = np.concatenate([start[:6], angles, start[15:]])
    expected = march.march(twin.rates, twin.readings, x, u, DT)
    size = np.abs(expected).max(axis=0)
    assert (np.ptp(expected, axis=0) > 1e-3 * size).all(), "every channel moves"
    np.testing.assert_allclose(y / size, expected / size, rtol=0, atol=RTOL)

"""Multirotors of other people's simulators under their own controllers: hover, shakes about all axes, and moves.

Each simulator gives its states and its own accelerations; its documented constants are the truth. Axes of all are forward, left
and up, over a ground of north, west and up.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import euler_angles, to_body
from stoop.base.units import FOOT, SLUG
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import StoopError
from stoop.results.result import Covariance
from stoop.vehicle import Vehicle
from stoop.vehicle.defaults import SHORTEST_LAG
from stoop_export.exporter import FLIP
from stoop_export.rotorpy_flight import TURN
from stoop_studies.verify import jsbsim_flight, multirotor, truths
from stoop_studies.verify.outside_aircraft import TABLES, OutsideFlight
from stoop_studies.verify.pilots import Columns

RATE: Final = 100.0  #: Hz, of the controllers
SETTLE: Final = 3.0  #: s before the record
DURATION: Final = 70.0  #: s
GRAVITY: Final = 9.81  #: m/s2, of these simulators
HEIGHT: Final = 20.0  #: m
#: of Crazyflow's model, N s2/rad2 and N m s2/rad2 (3.16e-10 and 7.94e-12 over rpm2), and which way its rotors turn it
THRUST: Final = 3.16e-10 / (np.pi / 30.0) ** 2
TORQUE: Final = 7.94e-12 / (np.pi / 30.0) ** 2
TURNS: Final = np.array([-1.0, 1.0, -1.0, 1.0])
#: gain of the rates times the lag of the motors, above which commands at `RATE` swing from end to end all the time (those that
#: RotorPy gives the Crazyflie Brushless), and its usual gains of attitude and rates, which are taken then
DAMPING: Final = 5.0
USUAL_GAINS: Final = (310.0, 57.0)
SIDES: Final = (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0)  #: of a 3-2-1-1, by steps
#: sides of the motors of a quadrotor in X, forward and right
PX4_ORDER: Final = ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
INERTIA: Final = tuple(f"mass.inertia.{a}{a}" for a in "xyz")
DRAG: Final = tuple(f"body_drag.quadratic.{a}" for a in "xyz")


@dataclass(frozen=True)
class Rotorcraft:
    """What is true of a quadrotor: numbers as in a vehicle file that records rotor speeds; what is not among them is zero."""

    numbers: Mapping[str, float]
    positions: FloatArray  #: (4, 3) m, forward, right, down
    fastest: float = 1.0  #: rad/s, of full command
    held: float = 0.0  #: s, for which a command is held; zero where it runs on straight lines between samples

    @property
    def late(self) -> dict[str, float]:
        """By which commands and speeds act later than straight lines through their samples, s, in the mean of a step of them.

        After a step from n to u of a command that is held for h, the speed is u - (u - n) exp(-t / lag).
        """
        h, lag = self.held, self.numbers.get("rotors.lag", 0.0)
        bent = lag - 0.5 * h / np.tanh(0.5 * h / lag) if h and lag else 0.5 * h
        return {"motor": 0.5 * h, "rotor": float(bent)}

    @property
    def order(self) -> list[int]:
        """Its rotors in the order that flight stacks number a quadrotor in X."""
        sides = np.sign(np.round(self.positions[:, :2], 6))
        return [int(np.flatnonzero((sides == side).all(axis=1))[0]) for side in np.array(PX4_ORDER)]

    def vehicle(self, file: Vehicle) -> Vehicle:
        """Return a file with the true values, for rotor speeds, or for commands from 0 to 1."""
        by_speed = next(iter(file.file.rotor.values())).channel.startswith("rotor_")
        full = (
            {}
            if by_speed
            else {"rotors.T2": self.fastest**2, "rotors.inflow": self.fastest, "rotors.drag": self.fastest}
        )
        true = {**dict.fromkeys((f"rotors.{n}" for n in truths.ROTORS), 0.0), **self.numbers}
        for name, i in zip(file.file.rotor, self.order, strict=True):
            true |= {
                f"rotor.{name}.position.{a}": float(x) for a, x in zip("xyz", self.positions[i], strict=True)
            }
        own = {p.name for p in file.parameters} & true.keys()
        return file.with_numbers({n: {"value": true[n] * full.get(n, 1.0)} for n in own})

    def flight(self, rate: float, columns: Columns) -> OutsideFlight:
        """Return a flight of it; a person measures its mass, and the largest distance between motors."""
        span = float(2.0 * np.max(np.linalg.norm(self.positions[:, :2], axis=1)))
        tape = {"mass": self.numbers["mass.mass"], "span": span}
        return OutsideFlight(
            rate, columns, tape, lambda file, *_: self.vehicle(file), {"template": "quad"}, late=self.late
        )


def plan(craft: Rotorcraft, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draw places (n, 3), m, a few meters apart, and accelerations (n, 3) of 3-2-1-1, rad/s2, as arms and thrust allow."""
    time = np.arange(round((SETTLE + DURATION) * RATE)) / RATE - SETTLE
    places, shakes = np.zeros((len(time), 3)), np.zeros((len(time), 3))
    places[:, 2] = HEIGHT
    arm, known = float(np.mean(np.abs(craft.positions[:, :2]))), craft.numbers
    arms = np.array([0.25 * arm, 0.25 * arm, 0.7 * known["rotors.torque_ratio"]])
    able = known["mass.mass"] * GRAVITY * arms / np.array([known[n] for n in INERTIA])
    for axis, start, step in TABLES["shakes"]:
        begin = start + rng.uniform(0.0, 1.0)
        size = able[axis] * rng.uniform(0.6, 1.0) * rng.choice((-1.0, 1.0))
        k = np.floor((time - begin) / (step * rng.uniform(0.9, 1.1))).astype(int)
        on = (k >= 0) & (k < len(SIDES))
        shakes[on, axis] += size * np.array(SIDES)[k[on]]
    for axis, start in TABLES["moves"]:
        begin, far = start + rng.uniform(0.0, 0.5), rng.uniform(2.0, 5.0) * rng.choice((-1.0, 1.0))
        share = np.clip((time - begin) / 2.5, 0.0, 1.0)
        places[:, axis] += far * (0.5 - 0.5 * np.cos(np.pi * share)) * (0.4 if axis == 2 else 1.0)
    return places, shakes


def with_sum(numbers: Mapping[str, list[float]], covariance: Covariance) -> dict[str, list[float]]:
    """Return the rows of numbers with the sum of lag and delay as the delay, where the lag is so short that only this shows."""
    names = ("rotors.lag", "rotors.delay")
    if not set(names) <= numbers.keys() or numbers[names[0]][2] >= SHORTEST_LAG:
        return dict(numbers)
    at = [covariance.names.index(n) for n in names]
    std = float(np.sqrt(np.sum(covariance.matrix[np.ix_(at, at)])))
    (a, _, true, *_), (b, _, late, bound, shown) = (numbers[n] for n in names)
    return {n: row for n, row in numbers.items() if n not in names} | {
        names[1]: [a + b, std, true + late, bound, shown]
    }


class RotorPy:
    """A vehicle of RotorPy under its SE3 controller; ``more`` are other constants of it."""

    def __init__(self, name: str, **more: Any) -> None:
        parameters = {**importlib.import_module(f"rotorpy.vehicles.{name}_params").quad_params, **more}
        self.made = importlib.import_module("rotorpy.vehicles.multirotor").Multirotor(parameters)
        self.control = importlib.import_module("rotorpy.controllers.quadrotor_control").SE3Control(parameters)
        d, c = self.made, self.control
        if c.kd_att * d.tau_m > DAMPING:
            c.kp_att, c.kd_att = USUAL_GAINS
        numbers = {
            "mass.mass": d.mass, "rotors.T2": d.k_eta, "rotors.torque_ratio": d.k_m / d.k_eta, "rotors.lag": d.tau_m,
            "rotors.inflow": d.k_z, "rotors.drag": d.k_d, "rotors.translational": d.k_h,
            **dict(zip(INERTIA, np.diag(d.inertia), strict=True)), **dict(zip(DRAG, np.diag(d.drag_matrix), strict=True)),
        }  # fmt: skip
        numbers = {n: float(x) for n, x in numbers.items()}
        self.craft = Rotorcraft(numbers, d.rotor_geometry * FLIP, d.rotor_speed_max, 1.0 / RATE)
        self.command = np.full(4, np.sqrt(d.mass * GRAVITY / (4.0 * d.k_eta)))
        self.state = {
            "x": np.array([0.0, 0.0, HEIGHT]), "v": np.zeros(3), "q": np.array([0.0, 0.0, 0.0, 1.0]), "w": np.zeros(3),
            "rotor_speeds": self.command,
        }  # fmt: skip

    def pass_sample(self, wind: FloatArray) -> FloatArray:
        """Let a sample pass; return the acceleration over ground (3,) at its begin."""
        self.state["wind"], control = wind, {"cmd_motor_speeds": self.command}
        acceleration: FloatArray = self.made.statedot(self.state, control, 1.0 / RATE)["vdot"]
        self.state = self.made.step(self.state, control, 1.0 / RATE)
        return acceleration

    def advance(self, place: FloatArray, shake: FloatArray, wind: FloatArray) -> dict[str, FloatArray]:
        """Lead a sample to a place, m, and turn by a shake, rad/s2; return the motion at its begin.

        That is velocity, attitude, rates, height, speeds and commands of rotors, and acceleration.
        """
        still = dict.fromkeys(("x_dot", "x_ddot", "x_dddot", "x_ddddot"), np.zeros(3))
        wanted, made = {"x": place, "yaw": 0.0, "yaw_dot": 0.0, **still}, self.made
        thrusts = self.control.update(0.0, self.state, wanted)["cmd_motor_thrusts"]
        thrusts = thrusts + made.TM_to_f @ np.concatenate([[0.0], made.inertia @ shake])
        speeds = np.sqrt(np.maximum(thrusts, 0.0) / made.k_eta)
        self.command = np.clip(speeds, made.rotor_speed_min, made.rotor_speed_max)
        s = {n: np.array(x) for n, x in self.state.items()}
        turning = s["rotor_speeds"] if made.tau_m else self.command
        motion = {"v": s["v"], "q": s["q"], "w": s["w"], "z": s["x"][2:], "n": turning, "u": self.command}
        return {**motion, "a": self.pass_sample(wind)}


class MuJoCo(RotorPy):
    """Crazyflow's model of a Crazyflie in MuJoCo: a rigid body and four thrusts, under the controller of RotorPy."""

    def __init__(self, name: str) -> None:
        self.engine, package = importlib.import_module("mujoco"), find_spec("crazyflow")
        if package is None or package.origin is None:
            raise ModuleNotFoundError("no crazyflow", name="crazyflow")
        file = Path(package.origin).parent / "models" / "cf2" / f"{name}.xml"
        spec = self.engine.MjSpec.from_file(str(file))
        spec.body("drone").add_freejoint()
        self.model = spec.compile()
        self.data = self.engine.MjData(self.model)
        self.data.qpos[2] = HEIGHT
        body = dict(zip(("Ixx", "Iyy", "Izz"), self.model.body_inertia[-1], strict=True))
        places = dict(enumerate(np.array(self.model.site_pos[-4:])))
        super().__init__(
            "crazyflie", mass=float(self.model.body_mass[-1]), **body, rotor_pos=places, rotor_directions=TURNS,
            k_eta=THRUST, k_m=TORQUE, **dict.fromkeys(("k_d", "k_z", "tau_m"), 0.0),
        )  # fmt: skip

    def pass_sample(self, wind: FloatArray) -> FloatArray:
        """Let a sample pass, of several steps of MuJoCo; its air is at rest and without drag."""
        lift = THRUST * self.command**2
        self.data.ctrl[:] = [*lift, *(TURNS * lift * TORQUE / THRUST)]
        self.engine.mj_forward(self.model, self.data)
        acceleration = np.array(self.data.qacc[:3])
        for _ in range(round(1.0 / (RATE * self.model.opt.timestep))):
            self.engine.mj_step(self.model, self.data)
        place, speed = np.array(self.data.qpos), np.array(self.data.qvel)
        self.state |= {"x": place[:3], "v": speed[:3], "q": np.roll(place[3:], -1), "w": speed[3:]}
        return acceleration


SIMULATORS: Final[Mapping[str, Callable[[str], RotorPy]]] = {"rotorpy": RotorPy, "mujoco": MuJoCo}


def fly(simulator: str, name: str, seed: int, wind: FloatArray, gusts: str = "calm") -> OutsideFlight:
    """Fly the plan of a seed in a wind (2,) to north and east, m/s, with gusts of a second."""
    if simulator == "jsbsim":
        return fly_f450(seed)
    flying = SIMULATORS[simulator](name)
    rng = np.random.default_rng([54, seed])
    planned = plan(flying.craft, rng)
    share, gust = float(np.exp(-1.0 / RATE)), TABLES["gusts"][gusts][2]
    air, rows = np.zeros(3), []
    for place, shake in zip(*planned, strict=True):
        air = share * air + gust * np.sqrt(1.0 - share**2) * rng.standard_normal(3)
        blown = np.array([wind[0], -wind[1], 0.0]) + air
        rows.append(flying.advance(place, FLIP * shake, blown))
    motion = {n: np.array([row[n] for row in rows[round(SETTLE * RATE) :]]) for n in rows[0]}
    if np.max(np.abs(motion["z"] - HEIGHT)) > 15.0:
        raise StoopError(f"outside: {name} of {simulator} leaves its flight")
    return flying.craft.flight(RATE, columns_of(motion, flying.craft))


def columns_of(motion: Mapping[str, FloatArray], craft: Rotorcraft) -> Columns:
    """Return variables of a motion (n, 3) in axes of forward, left, up and north, west, up; scalars of quaternions are last."""
    q = np.roll(motion["q"], 1, axis=1) * TURN
    force = to_body(q, FLIP * (motion["a"] + np.array([0.0, 0.0, GRAVITY])))
    vectors = np.hstack([FLIP * motion["v"], FLIP * motion["w"], euler_angles(q), force])
    out = dict(zip((*VELOCITY, *RATES, *EULER, *SPECIFIC_FORCE), vectors.T, strict=True))
    out["altitude"] = motion["z"][:, 0]
    for i, k in enumerate(craft.order, 1):
        out |= {f"rotor_{i}": motion["n"][:, k], f"motor_{i}": motion["u"][:, k] / craft.fastest}
    return out


def fly_f450(seed: int) -> OutsideFlight:
    """Fly JSBSim's F450 by the autopilot of `multirotor`; a log has the speeds of its rotors, or these over the fastest."""
    clamped = multirotor.Quadrotor()
    inertia = clamped.read([f"inertia/i{a}{a}-slugs_ft2" for a in "xyz"]) * (SLUG * FOOT**2)
    numbers = {"mass.mass": clamped["inertia/mass-slugs"] * SLUG, "rotors.torque_ratio": 0.016}
    numbers |= dict(zip(INERTIA, inertia.tolist(), strict=True))
    craft = Rotorcraft(numbers, np.array([clamped.position(i) for i in range(4)]))
    places, shakes = plan(craft, np.random.default_rng([54, seed]))
    climb, early = round(multirotor.CLIMB_OUT * RATE), round((multirotor.CLIMB_OUT - SETTLE) * RATE)
    autopilot = multirotor.Pilot(np.arange(-climb, round(DURATION * RATE)) / RATE)
    autopilot.velocity[early:] = FLIP * np.gradient(places, 1.0 / RATE, axis=0)
    autopilot.excitation[:] = 0.0
    autopilot.excitation[early:, :3] = shakes
    flown = multirotor.fly(multirotor.Quadrotor(), autopilot)
    turning = {n: flown.columns[n] for n in multirotor.TURNS}
    fastest = 1.2 * max(float(x.max()) for x in turning.values())
    motors = {n: x / fastest for n, x in zip(multirotor.MOTORS, turning.values(), strict=True)}
    known = {**numbers, **multirotor.truth(clamped, flown, None)}
    return replace(craft, numbers=known, fastest=fastest).flight(
        jsbsim_flight.RATE, {**flown.columns, **motors}
    )

"""Multirotors of other people's simulators under their own controllers: hover, shakes about all axes, and moves.

Each simulator gives its states and its own accelerations; its documented constants are the truth. Axes of all are forward, left
and up, over a ground of north, west and up.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import FLIP, euler_angles, to_body
from stoop.base.units import FOOT, SLUG
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import StoopError
from stoop.exporters.rotorpy_flight import TURN
from stoop.vehicle import Vehicle, parse_vehicle
from stoop_studies.verify import jsbsim_flight, multirotor
from stoop_studies.verify.outside_aircraft import OutsideFlight
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
#: axis, start (s), length of a step (s), size: of rad/s2 over what the arms allow, or m
SHAKES: Final = (
    (0, 5.0, 0.12),
    (1, 9.0, 0.12),
    (2, 13.0, 0.3),
    (0, 38.0, 0.16),
    (1, 42.0, 0.16),
    (2, 46.0, 0.4),
)
MOVES: Final = ((0, 18.0), (1, 24.0), (2, 30.0), (1, 50.0), (0, 56.0), (2, 62.0))
SIDES: Final = (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0)  #: of a 3-2-1-1, by steps
PX4_ORDER: Final = (
    (1.0, 1.0),
    (-1.0, -1.0),
    (1.0, -1.0),
    (-1.0, 1.0),
)  #: sides of the motors of a quadrotor in X, forward and right


@dataclass(frozen=True)
class Rotorcraft:
    """What is true of a quadrotor: SI, forward, right and down."""

    mass: float
    inertia: FloatArray  #: (3, 3)
    positions: FloatArray  #: (4, 3)
    spins: Sequence[str]  #: seen from above
    thrust: float  #: N s2/rad2
    ratio: float  #: torque over thrust, m
    lag: float  #: s
    fastest: float  #: rad/s, of full command
    inflow: float = 0.0  #: N s2/(m rad)
    drag: float = 0.0
    body: Sequence[float] = field(default=(0.0, 0.0, 0.0))  #: N s2/m2

    @property
    def order(self) -> list[int]:
        """Its rotors in the order that flight stacks number a quadrotor in X."""
        sides = np.sign(np.round(self.positions[:, :2], 6))
        return [int(np.flatnonzero((sides == side).all(axis=1))[0]) for side in np.array(PX4_ORDER)]

    @property
    def tape(self) -> dict[str, float]:
        """Mass, and the largest distance between motors."""
        return {"mass": self.mass, "span": float(2.0 * np.max(np.linalg.norm(self.positions[:, :2], axis=1)))}

    def vehicle(self, file: Vehicle) -> Vehicle:
        """Return the vehicle in the units of a file: rotor speeds, or commands from 0 to 1."""
        channels = [rotor.channel for rotor in file.file.rotor.values()]
        by_speed = channels[0].startswith("rotor_")
        full = 1.0 if by_speed else self.fastest
        inertia = {f"{a}{b}": float(self.inertia[i, j]) * (1.0 if i == j else -1.0)
                   for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i == j}  # fmt: skip
        rotors = [
            f'[rotor.{name}]\nchannel = "{channel}"\nposition = {self.positions[i].tolist()}\nspin = "{self.spins[i]}"'
            for (name, channel), i in zip(
                zip(file.file.rotor, channels, strict=True), self.order, strict=True
            )
        ]
        lag = "" if by_speed else f"lag = {self.lag!r}\n"
        text = (
            f'format = "stoop-vehicle/1"\nname = "truth"\n[mass]\nmass = {self.mass!r}\n[mass.inertia]\n'
            + "".join(f"{a} = {x!r}\n" for a, x in inertia.items())
            + f'[rotors]\ndrive = "{"speed" if by_speed else "command"}"\nT2 = {self.thrust * full**2!r}\n'
            + f"inflow = {self.inflow * full!r}\ndrag = {self.drag * full!r}\ntorque_ratio = {self.ratio!r}\n{lag}"
            + f"[body_drag]\nquadratic = {[float(x) for x in self.body]}\n"
            + "\n".join(rotors)
        )
        return parse_vehicle(text, "truth")


@dataclass(frozen=True, eq=False)
class Plan:
    """What is flown at each sample: places (n, 3), m, and angular accelerations (n, 3) of shakes, rad/s2."""

    places: FloatArray
    shakes: FloatArray


def plan(craft: Rotorcraft, rng: np.random.Generator) -> Plan:
    """Draw moves over a few meters and 3-2-1-1 about all axes, sized by what arms and thrust can do."""
    time = np.arange(round((SETTLE + DURATION) * RATE)) / RATE - SETTLE
    places, shakes = np.zeros((len(time), 3)), np.zeros((len(time), 3))
    places[:, 2] = HEIGHT
    arm = float(np.mean(np.abs(craft.positions[:, :2])))
    weight = craft.mass * GRAVITY
    able = weight * np.array([0.25 * arm, 0.25 * arm, 0.7 * craft.ratio]) / np.diag(craft.inertia)
    for axis, start, step in SHAKES:
        begin, size = (
            start + rng.uniform(0.0, 1.0),
            able[axis] * rng.uniform(0.6, 1.0) * rng.choice((-1.0, 1.0)),
        )
        k = np.floor((time - begin) / (step * rng.uniform(0.9, 1.1))).astype(int)
        on = (k >= 0) & (k < len(SIDES))
        shakes[on, axis] += size * np.array(SIDES)[k[on]]
    for axis, start in MOVES:
        begin, far = start + rng.uniform(0.0, 0.5), rng.uniform(2.0, 5.0) * rng.choice((-1.0, 1.0))
        share = np.clip((time - begin) / 2.5, 0.0, 1.0)
        places[:, axis] += far * (0.5 - 0.5 * np.cos(np.pi * share)) * (0.4 if axis == 2 else 1.0)
    return Plan(places, shakes)


class RotorPy:
    """A vehicle of RotorPy under its SE3 controller."""

    def __init__(self, name: str) -> None:
        parameters = importlib.import_module(f"rotorpy.vehicles.{name}_params").quad_params
        self.made = importlib.import_module("rotorpy.vehicles.multirotor").Multirotor(parameters)
        self.control = importlib.import_module("rotorpy.controllers.quadrotor_control").SE3Control(parameters)
        d, level = self.made, np.array([0.0, 0.0, 0.0, 1.0])
        self.craft = Rotorcraft(
            d.mass, np.outer(FLIP, FLIP) * d.inertia, d.rotor_geometry * FLIP,
            ["cw" if x > 0 else "ccw" for x in d.rotor_dir], d.k_eta, d.k_m / d.k_eta, d.tau_m, d.rotor_speed_max,
            d.k_z, d.k_d, np.diag(d.drag_matrix).tolist(),
        )  # fmt: skip
        self.command = np.full(4, np.sqrt(d.mass * GRAVITY / (4.0 * d.k_eta)))
        self.state = {
            "x": np.array([0.0, 0.0, HEIGHT]),
            "v": np.zeros(3),
            "q": level,
            "w": np.zeros(3),
            "rotor_speeds": self.command,
        }

    def steer(self, place: FloatArray, shake: FloatArray) -> None:
        """Command the speeds that lead to a place, m, and turn by a shake, rad/s2."""
        still = dict.fromkeys(("x_dot", "x_ddot", "x_dddot", "x_ddddot"), np.zeros(3))
        wanted = {"x": place, "yaw": 0.0, "yaw_dot": 0.0, **still}
        thrusts = self.control.update(0.0, self.state, wanted)["cmd_motor_thrusts"]
        thrusts = thrusts + self.made.TM_to_f @ np.concatenate([[0.0], self.made.inertia @ shake])
        low, high = self.made.rotor_speed_min, self.made.rotor_speed_max
        self.command = np.clip(np.sqrt(np.maximum(thrusts, 0.0) / self.made.k_eta), low, high)

    def pass_sample(self, wind: FloatArray) -> FloatArray:
        """Let a sample pass; return the acceleration over ground (3,) at its begin."""
        self.state["wind"], control = wind, {"cmd_motor_speeds": self.command}
        acceleration: FloatArray = self.made.statedot(self.state, control, 1.0 / RATE)["vdot"]
        self.state = self.made.step(self.state, control, 1.0 / RATE)
        return acceleration

    def advance(self, place: FloatArray, shake: FloatArray, wind: FloatArray) -> dict[str, FloatArray]:
        """Fly a sample; return the motion at its begin: velocity, attitude, rates, height, speeds, commands, acceleration."""
        self.steer(place, shake)
        s = {n: np.array(x) for n, x in self.state.items()}
        out = {
            "v": s["v"],
            "q": s["q"],
            "w": s["w"],
            "z": s["x"][2:],
            "n": s["rotor_speeds"],
            "u": self.command,
        }
        return {**out, "a": self.pass_sample(wind)}


class MuJoCo(RotorPy):
    """Crazyflow's model of a Crazyflie in MuJoCo: a rigid body and four thrusts, under the controller of RotorPy."""

    def __init__(self, name: str) -> None:
        super().__init__("crazyflie")
        engine, folder = importlib.import_module("mujoco"), find_spec("crazyflow")
        if folder is None or folder.submodule_search_locations is None:
            raise ModuleNotFoundError("no crazyflow", name="crazyflow")
        spec = engine.MjSpec.from_file(
            str(Path(folder.submodule_search_locations[0]) / "models" / "cf2" / f"{name}.xml")
        )
        spec.body("drone").add_freejoint()
        self.engine, self.model = engine, spec.compile()
        self.data, d = engine.MjData(self.model), self.made
        d.mass, d.inertia = float(self.model.body_mass[-1]), np.diag(self.model.body_inertia[-1])
        d.rotor_geometry, d.rotor_dir, d.k_eta, d.k_m = (
            np.array(self.model.site_pos[-4:]),
            TURNS,
            THRUST,
            TORQUE,
        )
        d.TM_to_f = np.linalg.inv(np.vstack([
            np.ones(4), d.rotor_geometry[:, 1], -d.rotor_geometry[:, 0], d.rotor_dir * d.k_m / d.k_eta
        ]))  # fmt: skip
        self.control.mass, self.control.inertia, self.control.TM_to_f, self.control.k_eta = (
            d.mass,
            d.inertia,
            d.TM_to_f,
            d.k_eta,
        )
        spins = ["cw" if x > 0 else "ccw" for x in d.rotor_dir]
        self.craft = Rotorcraft(
            d.mass, np.diag(np.diag(d.inertia)), d.rotor_geometry * FLIP, spins, THRUST, TORQUE / THRUST, 0.0, d.rotor_speed_max
        )  # fmt: skip
        self.data.qpos[2] = HEIGHT

    def steer(self, place: FloatArray, shake: FloatArray) -> None:
        """Command the speeds; rotors have them at once."""
        super().steer(place, shake)
        self.state["rotor_speeds"] = self.command

    def pass_sample(self, wind: FloatArray) -> FloatArray:
        """Let a sample pass, of several steps of MuJoCo; its air is at rest and without drag."""
        lift = THRUST * self.command**2
        self.data.ctrl[:] = [*lift, *(self.made.rotor_dir * lift * TORQUE / THRUST)]
        self.engine.mj_forward(self.model, self.data)
        acceleration = np.array(self.data.qacc[:3])
        for _ in range(round(1.0 / (RATE * self.model.opt.timestep))):
            self.engine.mj_step(self.model, self.data)
        place, speed = np.array(self.data.qpos), np.array(self.data.qvel)
        self.state = {
            "x": place[:3],
            "v": speed[:3],
            "q": np.roll(place[3:], -1),
            "w": speed[3:],
            "rotor_speeds": self.command,
        }
        return acceleration


SIMULATORS: Final[Mapping[str, Callable[[str], Any]]] = {"rotorpy": RotorPy, "mujoco": MuJoCo}


def fly(simulator: str, name: str, seed: int, wind: FloatArray, gust: float) -> OutsideFlight:
    """Fly the plan of a seed in a wind (2,) to north and east, m/s, with gusts of a standard deviation, m/s."""
    if simulator == "jsbsim":
        return fly_f450(seed)
    flying = SIMULATORS[simulator](name)
    craft, rng = flying.craft, np.random.default_rng([54, seed])
    planned = plan(craft, rng)
    share = float(np.exp(-1.0 / RATE))  # gusts of a second
    air, rows = np.zeros(3), []
    for k, (place, shake) in enumerate(zip(planned.places, planned.shakes, strict=True)):
        air = share * air + gust * np.sqrt(1.0 - share**2) * rng.standard_normal(3)
        blown = np.array([wind[0], -wind[1], 0.0]) + air
        row = flying.advance(place, FLIP * shake, blown)
        if k >= SETTLE * RATE:
            rows.append(row)
    motion = {n: np.array([row[n] for row in rows]) for n in rows[0]}
    if np.max(np.abs(motion["z"] - HEIGHT)) > 15.0:
        raise StoopError(f"outside: {name} of {simulator} leaves its flight")
    return OutsideFlight(RATE, columns_of(motion, craft), craft.tape, craft.vehicle, {"template": "quad"})


def columns_of(motion: Mapping[str, FloatArray], craft: Rotorcraft) -> Columns:
    """Return variables of a motion (n, 3) in axes of forward, left, up and north, west, up; scalars of quaternions are last."""
    q = np.roll(motion["q"], 1, axis=1) * TURN
    force = to_body(q, FLIP * (motion["a"] + np.array([0.0, 0.0, GRAVITY])))
    out: Columns = {}
    for names, values in (
        (VELOCITY, FLIP * motion["v"]),
        (RATES, FLIP * motion["w"]),
        (EULER, euler_angles(q)),
        (SPECIFIC_FORCE, force),
    ):
        out |= dict(zip(names, values.T, strict=True))
    out["altitude"] = motion["z"][:, 0]
    for i, k in enumerate(craft.order, 1):
        out |= {f"rotor_{i}": motion["n"][:, k], f"motor_{i}": motion["u"][:, k] / craft.fastest}
    return out


def fly_f450(seed: int) -> OutsideFlight:
    """Fly JSBSim's F450 by the autopilot of `multirotor`; a log has the speeds of its rotors, or these over the fastest."""
    clamped = multirotor.Quadrotor()
    inertia = clamped.read([f"inertia/i{a}{a}-slugs_ft2" for a in "xyz"]) * (SLUG * FOOT**2)
    positions = np.array([clamped.position(i) for i in range(4)])
    mass, spins = clamped["inertia/mass-slugs"] * SLUG, [clamped.sense(i) for i in range(4)]
    rough = Rotorcraft(mass, np.diag(inertia), positions, spins, 1.0, 0.016, 0.0, 1.0)
    planned, early = (
        plan(rough, np.random.default_rng([54, seed])),
        round((multirotor.CLIMB_OUT - SETTLE) * RATE),
    )
    autopilot = multirotor.Pilot(
        np.arange(-round(multirotor.CLIMB_OUT * RATE), round(DURATION * RATE)) / RATE
    )
    autopilot.velocity[early:] = FLIP * np.gradient(planned.places, 1.0 / RATE, axis=0)
    autopilot.excitation[:] = 0.0
    autopilot.excitation[early:, :3] = planned.shakes
    flown = multirotor.fly(multirotor.Quadrotor(), autopilot)
    known = multirotor.truth(clamped, flown, None)
    names = (*VELOCITY, *RATES, *EULER, *SPECIFIC_FORCE, "altitude", *multirotor.TURNS)
    columns = {n: flown.columns[n] for n in names}
    fastest = 1.2 * max(float(columns[n].max()) for n in multirotor.TURNS)
    columns |= {n: columns[of] / fastest for n, of in zip(multirotor.MOTORS, multirotor.TURNS, strict=True)}
    craft = replace(
        rough, inertia=np.diag([known[f"mass.inertia.{a}{a}"] for a in "xyz"]), thrust=known["rotors.T2"], fastest=fastest,
        ratio=known["rotors.torque_ratio"], inflow=known["rotors.inflow"],
        body=[known[f"body_drag.quadratic.{a}"] for a in "xyz"],
    )  # fmt: skip
    return OutsideFlight(jsbsim_flight.RATE, columns, craft.tape, craft.vehicle, {"template": "quad"})

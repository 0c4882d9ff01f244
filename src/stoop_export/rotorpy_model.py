"""A quadrotor for RotorPy: the parameters of its own model, and a class of it with the identified equations.

RotorPy's `Multirotor` has thrust and torque that grow with the square of the speed of rotation, rotor drag and inflow that
grow with it, a drag of the frame, and a lag of the speed. What of a vehicle is another function is matched at hover; the
class in the script keeps RotorPy's states, integration, wind, sensors and controllers, and takes forces and moments from
equations printed from the same expressions as the compiled kernel.

RotorPy's world is taken as north, west, up, its body axes are forward, left, up.

References
----------
S. Folk, J. Paulos, V. Kumar, "RotorPy: A Python-based Multirotor Simulator with Aerodynamics for Education and Research",
arXiv:2306.04485, 2023, eqs. (1) to (8).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Final

import numpy as np
import sympy as sp

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.motion import Trim
from stoop.extend.vehicles import SymbolicEquations
from stoop_analysis.derivatives import MOTIONS, derivatives
from stoop_export.matlab import identifier

FORMAT: Final = "stoop-rotorpy/1"
ROTORS: Final = 4  #: the state of RotorPy 3.0 has room for so many
NOMINAL_SPEED: Final = 1000.0  #: rad/s at full command, of a vehicle whose flight shows commands only
POINTS: Final = 201  #: of the table from commands to speeds
FASTEST_LAG: Final = 0.005  #: s, of a vehicle without one: RotorPy divides by it
ZERO: Final[Mapping[str, float]] = {
    "rotors.drag_inflow": 0.0, "rotors.inertia": 0.0, "rotors.Q0": 0.0, "rotors.Q1": 0.0, "ground_effect.rotor": 0.0,
    **{f"body_drag.linear.{a}": 0.0 for a in "xyz"}, **{f"body_drag.rotation.{a}": 0.0 for a in "xyz"},
}  # fmt: skip
"""Numbers of terms that RotorPy does not have, and values at which they do nothing."""


@dataclass(frozen=True, eq=False)
class RotorpyModel:
    """Files by name, and the terms that RotorPy's own model cannot hold."""

    name: str
    parameters: dict[str, Any]
    script: str

    @property
    def texts(self) -> dict[str, str]:
        """Files by name."""
        text = json.dumps(self.parameters, indent=1, allow_nan=False) + "\n"
        return {f"{self.name}.json": text, f"{self.name}_rotorpy.py": self.script}


def rotorpy_model(vehicle: Vehicle, point: Trim) -> RotorpyModel:
    """Return the files of a vehicle about a hover.

    Raises
    ------
    SimulationError
        RotorPy has no room for the vehicle's rotors, or no steady flight on rotors is given.
    """
    if len(vehicle.rotors) != ROTORS or point.on_wings:
        raise SimulationError(
            f"{vehicle.where}: RotorPy 3.0 flies vehicles of {ROTORS} rotors on their rotors; this one has "
            f"{len(vehicle.rotors)}, or an airspeed was given; export it to FMI or JSBSim"
        )
    if vehicle.sloped:
        raise SimulationError(
            f"{vehicle.where}: the reaction to the spin-up of rotors without a lag needs slopes of channels; give rotors.lag"
        )
    name = identifier(vehicle.name)
    return RotorpyModel(name, _parameters(vehicle, point), _script(vehicle, point, name))


def _parameters(vehicle: Vehicle, point: Trim) -> dict[str, Any]:
    """Return RotorPy's parameters, matched at hover, and what else the script needs."""
    n, file = vehicle.value, vehicle.file
    hover = settled_speeds(vehicle, point)
    scale = NOMINAL_SPEED if vehicle.drive == "command" else 1.0
    mean = float(np.mean(list(hover.values())))
    lift = -derivatives(vehicle, point).loads[2] / ROTORS
    full = scale if vehicle.drive == "command" else 2.0 * mean
    commands = np.linspace(0.0, full / scale, POINTS)
    thrust = static_thrust(vehicle, point, commands)
    static = float(np.interp(mean, commands, thrust))
    k_eta = float(thrust[-1]) / full**2
    omega = float(np.sqrt(max(static, 1e-9) / k_eta))
    found = derivatives(vehicle, point).matrix
    total = ROTORS * omega
    torque = n("rotors.torque_ratio", 0.0) * k_eta
    if "rotors.torque_ratio" not in vehicle.rows:
        loads = n("rotors.Q0", 0.0) + n("rotors.Q1", 0.0) * mean + n("rotors.Q2", 0.0) * mean**2
        torque = loads * lift / max(static, 1e-9) / omega**2
    center = [n(f"mass.center_of_gravity.{a}", 0.0) for a in "xyz"]
    places = {
        r: [n(f"rotor.{r}.position.{a}", 0.0) - c for a, c in zip("xyz", center, strict=True)]
        for r in vehicle.rotors
    }
    channels = [file.rotor[r].channel for r in vehicle.rotors]
    inertia = {a: n(f"mass.inertia.{a}", 0.0) for a in ("xx", "yy", "zz", "xy", "xz", "yz")}
    lag = n("rotors.lag", 0.0) if "rotors.lag" in vehicle.rows else 0.0
    drag = [n(f"body_drag.quadratic.{a}", 0.0) for a in "xyz"]
    quad = {
        "mass": n("mass.mass"),
        # off the diagonal RotorPy has entries of the tensor, which are minus the products; y and z are the other way
        "Ixx": inertia["xx"], "Iyy": inertia["yy"], "Izz": inertia["zz"],
        "Ixy": inertia["xy"], "Ixz": inertia["xz"], "Iyz": -inertia["yz"],
        "c_Dx": drag[0], "c_Dy": drag[1], "c_Dz": drag[2],
        "num_rotors": ROTORS,
        "rotor_pos": {r: [x, -y, -z] for r, (x, y, z) in places.items()},
        "rotor_directions": [-1 if file.rotor[r].spin == "ccw" else 1 for r in vehicle.rotors],
        "rotor_speed_min": 0.0, "rotor_speed_max": full,
        "k_eta": k_eta, "k_m": torque,
        "k_d": float(-(found[0, 0] + found[1, 1]) / 2.0 / total), "k_z": float(-found[2, 2] / total),
        "k_h": n("rotors.translational", 0.0), "k_flap": 0.0,
        "tau_m": max(lag, FASTEST_LAG), "motor_noise_std": 0.0,
        "k_w": 1.0, "k_v": 10.0, "kp_att": 544.0, "kd_att": 46.64,
    }  # fmt: skip
    return {
        "format": FORMAT,
        "vehicle": vehicle.name,
        "gravity": n("environment.gravity"),
        "quad_params": quad,
        "channels": channels,
        "idle": n("rotors.idle", 0.0), "gain": n("rotors.gain", 1.0),
        "commands": commands.tolist(),
        "speeds": np.sqrt(np.maximum(thrust, 0.0) / k_eta).tolist(),
        "hover": {c: float(point.inputs[vehicle.inputs.index(c)]) for c in channels},
    }  # fmt: skip


def settled_speeds(vehicle: Vehicle, point: Trim) -> dict[str, float]:
    """Return x of each rotor at a steady flight."""
    rows = vehicle.parameter_rows(point.changes)
    return {r: float(vehicle.commanded(r, rows, point.inputs)[0]) for r in vehicle.rotors}


def static_thrust(vehicle: Vehicle, point: Trim, commands: FloatArray) -> FloatArray:
    """Return the thrust (n,) of one rotor at rest, N, at values (n,) of x, by the kernel: all turn alike, in still air."""
    count = len(commands)
    rows = vehicle.parameter_rows(point.changes, count)
    start = {"h": point.start["h"]}
    raw = commands / vehicle.value("rotors.gain", 1.0) + vehicle.value("rotors.idle", 0.0)
    inputs = np.repeat(point.inputs[:, None], count, axis=1)
    for rotor in vehicle.file.rotor.values():
        inputs[vehicle.inputs.index(rotor.channel)] = raw
    states = vehicle.initial_states(start, rows, inputs)
    rates, _ = vehicle.kernel().evaluate(rows, states, np.ascontiguousarray(inputs))
    down = rates[vehicle.states.index("w")] - vehicle.value("environment.gravity")
    return np.asarray(-vehicle.value("mass.mass") * down / ROTORS)


def limits(vehicle: Vehicle) -> dict[str, float]:
    """Return the numbers of what RotorPy's own model leaves out, and the values at which they do nothing."""
    lost = {name: end for name, end in ZERO.items() if vehicle.value(name, 0.0) != 0.0}
    lost |= {
        n: 1.0
        for n in vehicle.rows
        if n.startswith("rotor.") and n.endswith("factor") and vehicle.value(n) != 1.0
    }
    return lost


def _script(vehicle: Vehicle, point: Trim, name: str) -> str:
    """Return the script: names in it are made here, but for those of channels and rotors as literals."""
    model = vehicle.symbolic_model()
    values = vehicle.parameter_rows(point.changes)[:, 0].tolist()
    states, inputs = (
        dict(zip(vehicle.states, model.states, strict=True)),
        dict(zip(vehicle.inputs, model.inputs, strict=True)),
    )
    rates = dict(zip(vehicle.states, model.derivatives, strict=True))
    level = {states["e0"]: 1.0, states["e1"]: 0.0, states["e2"]: 0.0, states["e3"]: 0.0}
    rotors = {file.channel: i for i, file in enumerate(vehicle.file.rotor.values())}
    fixed = dict(zip(inputs.values(), point.inputs.tolist(), strict=True))
    fixed = {s: x for s, x in fixed.items() if s not in [inputs[c] for c in rotors]}
    numbers = dict(zip(model.parameters, values, strict=True))
    made: dict[Any, Any] = {states[a]: sp.Symbol(f"motion[{i}]", real=True) for i, a in enumerate(MOTIONS)}
    made |= {inputs[c]: sp.Symbol(f"command[{i}]", real=True) for c, i in rotors.items()}
    made[states["h"]] = sp.Symbol("height", real=True)
    lags = [f"{r}.lag" for r in vehicle.rotors if f"{r}.lag" in states]
    made |= {states[s]: sp.Symbol(f"turning[{i}]", real=True) for i, s in enumerate(lags)}
    fixed |= {s: 0.0 for n, s in states.items() if s not in made and s not in level}
    known = {s: sp.Float(x) for s, x in {**numbers, **fixed, **level}.items()}
    wanted = [sp.sympify(rates[n]).xreplace(known).xreplace(made) for n in (*MOTIONS, *lags)]
    steps, results = sp.cse(wanted, sp.numbered_symbols("t"), order="none")
    lines = [f"    {s} = {SymbolicEquations.text(e)}" for s, e in steps]
    lines.append(f"    return np.array([{', '.join(SymbolicEquations.text(e) for e in results)}])")
    template = (files("stoop_export") / "templates" / "rotorpy_vehicle.py.txt").read_text(encoding="utf-8")
    hover = [*settled_speeds(vehicle, point).values()]
    fill = {"NAME": name, "EQUATIONS": "\n".join(lines), "GRAVITY": repr(vehicle.value("environment.gravity")),
            "LAGS": str(len(lags)), "ALTITUDE": repr(float(point.start["h"])), "HOVER": repr(hover)}  # fmt: skip
    for key, text in fill.items():
        template = template.replace(f"@{key}@", text)
    return template

"""The F450 of JSBSim's package, a quadrotor of 1.4 kg in X: flown by an autopilot through multisines, read at 100 Hz.

Four brushless motors (DJI E305: voltage, resistance and no-load current give the torque) turn propellers (DJI 9450:
thrust and power over the advance ratio, measured at APC); the body is a flat plate to the wind from wherever. It is
taken as it is but for the files of its sensors, which print warnings, and of its autopilot: ours flies it.
"""

from __future__ import annotations

import importlib
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import FACTORS, FOOT, POUND_FORCE, SLUG
from stoop.base.variables import EULER, RATES, VELOCITY
from stoop.errors import StoopError
from stoop_studies.verify.jsbsim.flight import ADAMS_BASHFORTH_2, Executive, Recording

STEP: Final = 5e-4  #: s, of JSBSim: its motors are integrated by Euler's rule
RATE: Final = 100  #: Hz, of the record and of the autopilot
ALTITUDE: Final = 500.0  #: m, where flights begin
HEADING: Final = 0.5  #: rad
CLIMB_OUT: Final = 6.0  #: s, in which it takes off and climbs; not recorded
DURATION: Final = 24.0  #: s, recorded
CLIMB: Final = 3.0  #: m/s: propellers are told apart from still air only where the air comes from one side
COMMANDED: Final = {0: (6.0, 0.06, 6, 0), 1: (6.0, 0.06, 6, 2), 2: (1.4, 0.05, 7, 5)}
EXCITED: Final = {0: (2.5, 0.4, 9, 1), 1: (2.5, 0.4, 9, 2), 2: (1.0, 0.3, 8, 3), 3: (1.5, 1.0, 6, 4)}
#: axis -> amplitude (m/s, rad/s2, m/s2), lowest frequency (Hz), how many sines, which phases
PARTS: Final = ("Metrics", "Mass", "Propulsion", "Aero")
ENGINES: Final = ("DJI_E305", "DJI_9450")
FILE: Final = """<?xml version="1.0"?>
<fdm_config name="F450" version="2.0" release="ALPHA">
  <fileheader/>
  <metrics file="Metrics.xml"/>
  <mass_balance file="Mass.xml"/>
  <ground_reactions/>
  <propulsion file="Propulsion.xml"/>
  <flight_control name="none"/>
  <aerodynamics file="Aero.xml"/>
</fdm_config>
"""
ROTORS: Final = ("front_right", "rear_left", "front_left", "rear_right")  #: in the order of JSBSim's engines
SPEED, THRUST, TORQUE = (
    f"propulsion/engine[{{}}]/{name}" for name in ("propeller-rpm", "thrust-lbs", "propeller-torque-ftlb")
)
RPM: Final = FACTORS["rpm"]
FOOT_POUND: Final = FOOT * POUND_FORCE  #: N m
MOTORS, TURNS, LIFTS, TWISTS = (
    tuple(f"{of}_{i + 1}" for i in range(4)) for of in ("motor", "rotor", "thrust", "torque")
)  #: channels: command, speed (rad/s), thrust (N) and torque (N m) of each rotor
AIRFRAME: Final = ("drag_x", "drag_y", "drag_z")
READ: Final = {
    **dict(zip(VELOCITY, ((f"velocities/v-{a}-fps", FOOT) for a in ("north", "east", "down")), strict=True)),
    **{a: (f"velocities/{a}i-rad_sec", 1.0) for a in RATES},
    **{a: (f"attitude/{a}-rad", 1.0) for a in EULER},
    **{f"a{a}": (f"accelerations/a-pilot-{a}-ft_sec2", FOOT) for a in "xyz"},
    "altitude": ("position/h-sl-ft", FOOT), "density": ("atmosphere/rho-slugs_ft3", SLUG / FOOT**3),
    **{a: (f"velocities/{a}-aero-fps", FOOT) for a in "uvw"},
    **{name: (SPEED.format(i), RPM) for i, name in enumerate(TURNS)},
    **{name: (THRUST.format(i), POUND_FORCE) for i, name in enumerate(LIFTS)},
    **{name: (TORQUE.format(i), FOOT_POUND) for i, name in enumerate(TWISTS)},
    **{f"drag_{a}": (f"forces/fb{a}-aero-lbs", POUND_FORCE) for a in "xyz"},
}  #: channel -> property and its unit: gyros sense the rate in space; the accelerometer is at the center of gravity  # fmt: skip
GRAVITY: Final = 9.8  #: m/s2, of the autopilot
HOVER: Final = 0.42  #: command that about carries the weight
SIGNS: Final = np.array(
    [[-1, 1, 1, 1], [1, -1, 1, 1], [1, 1, -1, 1], [-1, -1, -1, 1]]
)  #: roll, pitch, yaw, heave
GAINS: Final = np.array([1 / 520.0, 1 / 520.0, 1 / 47.0, 1 / 43.0])  #: command per rad/s2 and m/s2
MAX_ANGLE: Final = 0.25  #: rad, of bank and pitch


class Quadrotor(Executive):
    """JSBSim with the F450 in it, held at `ALTITUDE` with its motors standing.

    Raises
    ------
    StoopError
        JSBSim is not installed, or its package has no such aircraft.
    """

    def __init__(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            _write(Path(folder))
            super().__init__(Path(folder), "F450", STEP)
        place = {"ic/lat-gc-deg": 0.0, "ic/long-gc-deg": 0.0, "ic/h-sl-ft": ALTITUDE / FOOT}
        self.set({**place, "ic/psi-true-rad": HEADING})
        if not self.fdm.run_ic():
            raise StoopError("jsbsim: its F450 cannot be put into the air")
        self.set({"simulation/integrator/rate/rotational": ADAMS_BASHFORTH_2})
        self.fdm.get_propulsion().init_running(-1)
        self.hold(True)

    def hold(self, held: bool) -> None:
        """Clamp the body in place, or let it go."""
        self.set({"forces/hold-down": float(held)})

    def blow(self, wind: Sequence[float]) -> None:
        """Let a steady wind (north, east, down) blow, m/s."""
        axes = zip(("north", "east", "down"), wind, strict=True)
        self.set({f"atmosphere/wind-{a}-fps": v / FOOT for a, v in axes})

    def command(self, commands: Sequence[float]) -> None:
        """Set the four motors, 0 to 1."""
        self.set({f"fcs/throttle-pos-norm[{i}]": value for i, value in enumerate(commands)})

    def run(self, seconds: float) -> None:
        """Let a time pass."""
        for _ in range(round(seconds / STEP)):
            self.fdm.run()

    def settle(self, commands: Sequence[float]) -> None:
        """Command the motors and wait until they have their speed."""
        self.command(commands)
        self.run(0.8)

    @property
    def mass(self) -> float:
        """In kg."""
        return self["inertia/mass-slugs"] * SLUG

    @property
    def inertia(self) -> tuple[float, float, float]:
        """About the body axes, kg m2; it has no products."""
        x, y, z = (self.read([f"inertia/i{a}{a}-slugs_ft2" for a in "xyz"]) * (SLUG * FOOT**2)).tolist()
        return x, y, z

    def position(self, engine: int) -> tuple[float, float, float]:
        """Return where a rotor is (m forward, right, down)."""
        return self.point(f"propulsion/engine[{engine}]/{{}}-position")

    def sense(self, engine: int) -> str:
        """Return how a rotor turns, seen from above; JSBSim counts clockwise positive, seen from behind its thrust."""
        return "ccw" if self[f"propulsion/engine[{engine}]/propeller-sense"] > 0.0 else "cw"


def _write(root: Path) -> None:
    """Write the aircraft's folder: JSBSim's own parts, and a file that names them."""
    try:
        stock = Path(importlib.import_module("jsbsim").get_default_root_dir())
        parts = {f"aircraft/F450/{name}.xml" for name in PARTS} | {f"engine/{name}.xml" for name in ENGINES}
        for part in parts:
            (root / part).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(stock / part, root / part)
    except ModuleNotFoundError:
        raise StoopError("JSBSim: the package is not installed; pip install 'stoop[jsbsim]'") from None
    except OSError as error:
        raise StoopError(
            f"jsbsim: its package has no whole F450 ({error}); install jsbsim 1.2 or later"
        ) from error
    (root / "aircraft/F450/F450.xml").write_text(FILE, encoding="utf-8")


class Pilot:
    """An autopilot of proportional gains that holds a velocity, and excites the vehicle while it does.

    Parameters
    ----------
    velocity : (n, 3), m/s
        Commanded velocity north, east, down.
    excitation : (n, 4)
        Added accelerations: roll, pitch, yaw (rad/s2), heave (m/s2).
    """

    def __init__(self, velocity: FloatArray, excitation: FloatArray) -> None:
        self.velocity, self.excitation = velocity, excitation
        self.climb_error = 0.0  #: integral, m

    def __call__(self, k: int, now: Mapping[str, float]) -> FloatArray:
        """Return the commands (4,) for sample ``k``, from the state one sample before."""
        north, east, down = (w - now[v] for w, v in zip(self.velocity[k].tolist(), VELOCITY, strict=True))
        c, s = np.cos(now["psi"]), np.sin(now["psi"])
        ahead, right = c * north + s * east, c * east - s * north
        theta = float(np.clip(-1.5 * ahead / GRAVITY, -MAX_ANGLE, MAX_ANGLE))
        phi = float(np.clip(1.5 * right / GRAVITY, -MAX_ANGLE, MAX_ANGLE))
        self.climb_error += down / RATE
        accelerations = np.array(
            [
                40.0 * (phi - now["phi"]) - 9.0 * now["p"],
                40.0 * (theta - now["theta"]) - 9.0 * now["q"],
                4.0 * (HEADING - now["psi"]) - 4.0 * now["r"],
                -2.0 * down - 1.0 * self.climb_error,
            ]
        )
        return np.asarray(np.clip(HOVER + SIGNS @ (GAINS * (accelerations + self.excitation[k])), 0.05, 1.0))


def multisine(time: FloatArray, amplitude: float, lowest: float, count: int, phase: int) -> FloatArray:
    """Return a sum of sines (n,), a third of an octave apart, of Schroeder's phases; its standard deviation is a half."""
    each = np.arange(count)
    frequency = lowest * 2.0 ** ((each + phase / 6.0) / 3.0)
    angle = 2.0 * np.pi * frequency * time[:, None] - np.pi * each * (each + phase) / count
    return np.asarray(amplitude * np.sqrt(0.5 / count) * np.sin(angle).sum(axis=1))


def pilot(time: FloatArray) -> Pilot:
    """Return the autopilot with its maneuver; before 0 s it only climbs."""
    grown = np.clip(time + 2.0, 0.0, 1.0)
    velocity, excitation = np.zeros((len(time), 3)), np.zeros((len(time), 4))
    velocity[:, 2] = -CLIMB * np.clip((time + CLIMB_OUT) / 2.0, 0.0, 1.0)
    for table, sines in ((velocity, COMMANDED), (excitation, EXCITED)):
        for axis, (amplitude, lowest, count, phase) in sines.items():
            table[:, axis] += grown * multisine(time, amplitude, lowest, count, phase)
    return Pilot(velocity, excitation)


def fly(quadrotor: Quadrotor) -> Recording:
    """Let go of the vehicle and fly the maneuver.

    Commands run on straight lines between the samples, as the record is taken to say.
    """
    time = np.arange(round((CLIMB_OUT + DURATION) * RATE) + 1) / RATE - CLIMB_OUT
    autopilot, fine = pilot(time), round(1.0 / (RATE * STEP))
    units = np.array([unit for _, unit in READ.values()])
    commands = np.full((len(time), 4), HOVER)
    quadrotor.settle(commands[0])
    gravity = quadrotor["accelerations/gravity-ft_sec2"] * FOOT
    quadrotor.hold(False)
    rows = [quadrotor.read(name for name, _ in READ.values()) * units]
    for k in range(1, len(time)):
        commands[k] = autopilot(k, dict(zip(READ, rows[-1].tolist(), strict=True)))
        for j in range(1, fine + 1):
            quadrotor.command(commands[k - 1] + (commands[k] - commands[k - 1]) * (j / fine))
            quadrotor.fdm.run()
        rows.append(quadrotor.read(name for name, _ in READ.values()) * units)
    recorded = time >= 0.0
    table = np.column_stack([np.array(rows), commands])[recorded].T.copy()
    return Recording(time[recorded], dict(zip((*READ, *MOTORS), table, strict=True)), gravity)

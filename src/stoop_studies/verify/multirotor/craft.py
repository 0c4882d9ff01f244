"""The F450 of JSBSim's package under our hands: a quadrotor of 1.4 kg in X.

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
from stoop.errors import StoopError
from stoop.export.jsbsim_flight import simulator
from stoop_studies.verify.jsbsim_truth.machine import ADAMS_BASHFORTH_2, FOOT, INCH, POUND, SLUG

STEP: Final = 5e-4  #: s, of JSBSim: its motors are integrated by Euler's rule
RATE: Final = 100  #: Hz, of the record and of the autopilot
ALTITUDE: Final = 500.0  #: m, where flights begin
HEADING: Final = 0.5  #: rad
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
COMMANDS: Final = tuple(f"fcs/throttle-pos-norm[{i}]" for i in range(4))
SPEEDS: Final = tuple(f"propulsion/engine[{i}]/propeller-rpm" for i in range(4))
THRUSTS: Final = tuple(f"propulsion/engine[{i}]/thrust-lbs" for i in range(4))
TORQUES: Final = tuple(f"propulsion/engine[{i}]/propeller-torque-ftlb" for i in range(4))
RPM: Final = np.pi / 30.0  #: rad/s
FOOT_POUND: Final = FOOT * POUND  #: N m
WEIGHTY: Final = SLUG * FOOT**2  #: kg m2


class Craft:
    """JSBSim with the F450 in it, held at `ALTITUDE` with its motors standing.

    Raises
    ------
    StoopError
        JSBSim is not installed, or its package has no such aircraft.
    """

    def __init__(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            _write(Path(folder))
            self.fdm = simulator(Path(folder))
            if not self.fdm.load_model("F450"):
                raise StoopError("jsbsim: it does not take its own F450; install jsbsim 1.2 or later")
        self.fdm.set_dt(STEP)
        self.fdm.disable_output()
        self.set({"simulation/models/FGFCS/enabled": 0.0})  # motors get what we command
        self.set(
            {
                "ic/lat-gc-deg": 0.0,
                "ic/long-gc-deg": 0.0,
                "ic/h-sl-ft": ALTITUDE / FOOT,
                "ic/psi-true-rad": HEADING,
            }
        )
        if not self.fdm.run_ic():
            raise StoopError("jsbsim: its F450 cannot be put into the air")
        self.set({"simulation/integrator/rate/rotational": ADAMS_BASHFORTH_2})
        self.fdm.get_propulsion().init_running(-1)
        self.hold(True)

    def __getitem__(self, name: str) -> float:
        return float(self.fdm[name])

    def set(self, changes: Mapping[str, float]) -> None:
        """Write properties."""
        for name, value in changes.items():
            self.fdm[name] = value

    def read(self, names: Sequence[str], unit: float = 1.0) -> FloatArray:
        """Return properties times a unit."""
        return np.array([self.fdm[name] for name in names]) * unit

    def hold(self, held: bool) -> None:
        """Clamp the body in place, or let it go."""
        self.set({"forces/hold-down": float(held)})

    def blow(self, wind: Sequence[float]) -> None:
        """Let a steady wind (north, east, down) blow, m/s."""
        self.set(
            {
                f"atmosphere/wind-{a}-fps": v / FOOT
                for a, v in zip(("north", "east", "down"), wind, strict=True)
            }
        )

    def command(self, commands: Sequence[float]) -> None:
        """Set the four motors, 0 to 1."""
        self.set(dict(zip(COMMANDS, commands, strict=True)))

    def run(self, steps: int) -> None:
        """Let steps of JSBSim pass."""
        for _ in range(steps):
            self.fdm.run()

    def sample(self) -> None:
        """Let the time of a sample pass."""
        self.run(round(1.0 / (RATE * STEP)))

    def settle(self, seconds: float = 0.8) -> None:
        """Wait until the motors have their speed."""
        self.run(round(seconds / STEP))

    @property
    def density(self) -> float:
        """Of the air, kg/m3."""
        return self["atmosphere/rho-slugs_ft3"] * SLUG / FOOT**3

    @property
    def mass(self) -> float:
        """In kg."""
        return self["inertia/mass-slugs"] * SLUG

    @property
    def inertia(self) -> tuple[float, float, float]:
        """About the body axes, kg m2; it has no products."""
        x, y, z = self.read([f"inertia/i{a}{a}-slugs_ft2" for a in "xyz"], WEIGHTY).tolist()
        return x, y, z

    def position(self, engine: int) -> tuple[float, float, float]:
        """Return where a rotor is (m forward, right, down); JSBSim has inches aft, right, up."""
        x, y, z = (self[f"propulsion/engine[{engine}]/{a}-position"] * INCH for a in "xyz")
        return -x, y, -z

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

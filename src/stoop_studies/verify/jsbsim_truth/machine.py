"""One stock aircraft of JSBSim under our hands: put into a state, stepped, and read in SI units.

JSBSim is a separate code (J. S. Berndt, "JSBSim: an open source flight dynamics model in C++", AIAA
2004-4923): rotating ellipsoidal Earth, its own atmosphere, tables, engines and integrators. Nothing of ours
is in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.export.jsbsim_flight import simulator

FOOT: Final = 0.3048  #: m
INCH: Final = 0.0254  #: m
POUND: Final = 4.4482216152605  #: N
SLUG: Final = POUND / FOOT  #: kg
STEP: Final = 2e-4  #: s, of JSBSim: its surfaces and its rate of the angle of attack act one step late
ADAMS_BASHFORTH_2: Final = 3  #: of `simulation/integrator/rate/rotational`; its default is of first order
PASSES: Final = 12  #: evaluations at a held state after which the rate of the angle of attack has settled
RATE: Final = 100  #: Hz, of the record
EARTH_RATE: Final = 7.292115e-5  #: rad/s, of WGS 84, which JSBSim flies over


@dataclass(frozen=True)
class State:
    """A state of flight over a point of the equator, heading north.

    Attributes
    ----------
    V : m/s
    alpha, beta, phi, theta : rad
    p, q, r : rad/s
    altitude : m
    """

    V: float
    altitude: float
    alpha: float = 0.0
    beta: float = 0.0
    phi: float = 0.0
    theta: float = 0.0
    p: float = 0.0
    q: float = 0.0
    r: float = 0.0

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Body-axes velocity u, v, w, m/s."""
        plane = self.V * np.cos(self.beta)
        return plane * np.cos(self.alpha), self.V * np.sin(self.beta), plane * np.sin(self.alpha)


class Machine:
    """A JSBSim executive with one aircraft in it.

    Parameters
    ----------
    model : str
        Folder of the aircraft in JSBSim's own data.
    commands : mapping
        Held for the whole flight, by property: gear, flaps, throttle.
    running : bool
        Whether the engines run.
    """

    def __init__(self, model: str, commands: Mapping[str, float], running: bool) -> None:
        self.fdm = simulator(None)
        if not self.fdm.load_model(model):
            raise StoopError(f"jsbsim: its data hold no aircraft '{model}'; install jsbsim 1.2 or later")
        self.fdm.set_dt(STEP)
        self.fdm.disable_output()
        self.fdm["simulation/models/FGFCS/enabled"] = 0.0  # surfaces stand where we put them
        self.commands, self.running = dict(commands), running

    def __getitem__(self, name: str) -> float:
        return float(self.fdm[name])

    def set(self, changes: Mapping[str, float]) -> None:
        """Write properties."""
        for name, value in changes.items():
            self.fdm[name] = value

    def put(self, state: State, commands: Mapping[str, float]) -> None:
        """Put the aircraft into a state and evaluate its forces there until they rest; no time passes."""
        fdm = self.fdm
        u, v, w = state.velocity
        angles = {"phi": state.phi, "theta": state.theta, "psi-true": 0.0}
        self.set({"ic/lat-gc-deg": 0.0, "ic/long-gc-deg": 0.0, "ic/h-sl-ft": state.altitude / FOOT})
        self.set({f"ic/{name}-rad": value for name, value in angles.items()})
        self.set({"ic/u-fps": u / FOOT, "ic/v-fps": v / FOOT, "ic/w-fps": w / FOOT})
        self.set({"ic/p-rad_sec": state.p, "ic/q-rad_sec": state.q, "ic/r-rad_sec": state.r})
        self.set({**self.commands, **commands})
        if not fdm.run_ic():
            raise StoopError("jsbsim: the aircraft cannot be put into this state")
        self.set({"propulsion/fuel_freeze": 1.0, "simulation/integrator/rate/rotational": ADAMS_BASHFORTH_2})
        self.set({**self.commands, **commands})
        if self.running:
            fdm.get_propulsion().init_running(-1)
        fdm.suspend_integration()
        for _ in range(PASSES):
            fdm.run()
        fdm.resume_integration()

    def read(self, names: Iterable[str]) -> FloatArray:
        """Return properties, their own units."""
        return np.array([self.fdm[name] for name in names])

    @property
    def apparent_gravity(self) -> float:
        """What acts on level flight north over the equator, m/s2.

        Attraction, less the centrifugal accelerations of the turning Earth and of flight around it.
        """
        radius, speed = self["position/radius-to-vehicle-ft"] * FOOT, self["velocities/vt-fps"] * FOOT
        return self["accelerations/gravity-ft_sec2"] * FOOT - EARTH_RATE**2 * radius - speed**2 / radius

    def step(self, commands: Mapping[str, float]) -> None:
        """Let one step of JSBSim pass under these commands."""
        self.set(commands)
        self.fdm.run()

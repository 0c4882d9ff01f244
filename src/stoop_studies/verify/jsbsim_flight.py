"""Stock aircraft of JSBSim, put into a state, trimmed, flown through a maneuver and read at 100 Hz in SI units.

JSBSim is a separate code (J. S. Berndt, "JSBSim: an open source flight dynamics model in C++", AIAA
2004-4923): rotating ellipsoidal Earth, its own atmosphere, tables, engines and integrators. Nothing of ours
is in it.
"""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.optimize import root

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT, INCH, POUND_FORCE
from stoop.errors import StoopError
from stoop_export.jsbsim_flight import simulator
from stoop_studies.verify.scenes import multisine_maneuver
from stoop_studies.verify.study import data_text

STEP: Final = 2e-4  #: s, of JSBSim: its surfaces and its rate of the angle of attack act one step late
ADAMS_BASHFORTH_2: Final = 3  #: of `simulation/integrator/rate/rotational`; its default is of first order
PASSES: Final = 12  #: evaluations at a fixed state after which the rate of the angle of attack has settled
RATE: Final = 100  #: Hz, of the record
EARTH_RATE: Final = 7.292115e-5  #: rad/s, of WGS 84, which JSBSim flies over
DURATION: Final = 30.0  #: s
UNCONTROLLED: Final = {"simulation/models/FGFCS/enabled": 0.0}  #: surfaces and motors get what we command
CLEAN: Final = {"gear/gear-pos-norm": 0.0, "fcs/mixture-pos-norm": 0.0}
SURFACES: Final = {
    "elevator": "fcs/elevator-pos-rad",
    "aileron": "fcs/left-aileron-pos-rad",
    "rudder": "fcs/rudder-pos-rad",
}  #: the property that holds the deflection of each surface, rad
ACCELERATIONS: Final = tuple(
    f"accelerations/{a}dot-{unit}" for axes, unit in (("uvw", "ft_sec2"), ("pqr", "rad_sec2")) for a in axes
)
READ: Final = {
    "V": ("velocities/vt-fps", FOOT),
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    **{a: (f"velocities/{a}i-rad_sec", 1.0) for a in "pqr"},
    **{a: (f"attitude/{a}-rad", 1.0) for a in ("phi", "theta", "psi")},
    **{f"a{a}": (f"accelerations/a-pilot-{a}-ft_sec2", FOOT) for a in "xyz"},
    "altitude": ("position/h-sl-ft", FOOT),
    "thrust": ("forces/fbx-prop-lbs", POUND_FORCE),
}  #: channel -> property and its unit: gyros sense the rate in space, accelerometers sit at the pilot's eye


@dataclass(frozen=True)
class Subject:
    """What is identified: its name in keys and tables (a stock aircraft's folder in JSBSim), and its title on the page."""

    model: str
    title: str


@dataclass(frozen=True, kw_only=True)
class Stock(Subject):
    """A stock aircraft, trimmed at an airspeed (m/s) and altitude (m); terms count from ``alpha`` (rad), next to the trim's.

    Amplitudes are in rad by control, throttle 0 to 1 (None: engines off), band is the highest frequency of the inputs, Hz;
    ``added`` and ``dropped`` are terms beside those of eq. (1), and of it, and ``surfaces`` the properties of the controls.
    """

    airspeed: float
    alpha: float = 0.0
    altitude: float
    amplitude: Mapping[str, float] = field(default_factory=dict)
    throttle: float | None = None
    band: float = 2.0
    added: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    dropped: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    surfaces: Mapping[str, str] = field(default_factory=lambda: SURFACES)


def _stock(model: str, row: dict[str, Any]) -> Stock:
    dropped = {coefficient: tuple(names) for coefficient, names in row.pop("dropped", {}).items()}
    return Stock(model=model, dropped=dropped, **row)


FLEET: Final = tuple(_stock(model, row) for model, row in tomllib.loads(data_text("stock.toml")).items())


@dataclass(frozen=True)
class State:
    """A state of flight over a point of the equator, heading north; m, m/s, rad, rad/s."""

    V: float
    altitude: float
    alpha: float = 0.0
    beta: float = 0.0
    phi: float = 0.0
    theta: float = 0.0
    p: float = 0.0
    q: float = 0.0
    r: float = 0.0


@dataclass(frozen=True)
class Trim:
    """A state without acceleration, and the deflections that hold it, rad by control."""

    state: State
    deflections: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Recording:
    """A flight without noise: time (n,), columns (n,) by channel, SI, and JSBSim's gravity at the start where needed."""

    time: FloatArray
    columns: Mapping[str, FloatArray]
    gravity: float = np.nan


class Executive:
    """JSBSim with one aircraft, perhaps from a folder of ours; properties are read and written in their own units."""

    def __init__(self, folder: Path | None, model: str, step: float) -> None:
        self.fdm = simulator(folder)
        self.fdm.set_dt(step)  # before the filters of its flight control are made
        if not self.fdm.load_model(model):
            raise StoopError(f"jsbsim: its data hold no aircraft '{model}'; install jsbsim 1.2 or later")
        self.fdm.disable_output()

    def __getitem__(self, name: str) -> float:
        return float(self.fdm[name])

    def set(self, changes: Mapping[str, float]) -> None:
        """Write properties."""
        for name, value in changes.items():
            self.fdm[name] = value

    def read(self, names: Iterable[str]) -> FloatArray:
        """Return properties."""
        return np.array([self.fdm[name] for name in names])

    def sample(self, channels: Mapping[str, tuple[str, float]]) -> FloatArray:
        """Return channels, each a property times its unit."""
        return np.array([self.fdm[name] * unit for name, unit in channels.values()])

    def point(self, name: str) -> tuple[float, float, float]:
        """Return a point of the structural frame (inches aft, right, up) in ours (m forward, right, down)."""
        x, y, z = (self[name.format(axis)] * INCH for axis in "xyz")
        return -x, y, -z

    def begin(self, conditions: Mapping[str, float]) -> None:
        """Take initial conditions, over a point of the equator."""
        self.set({"ic/lat-gc-deg": 0.0, "ic/long-gc-deg": 0.0, **conditions})
        if not self.fdm.run_ic():
            raise StoopError("jsbsim: the aircraft cannot be put into this state")
        self.set({"simulation/integrator/rate/rotational": ADAMS_BASHFORTH_2})

    def pass_sample(
        self, before: FloatArray, after: FloatArray, command: Callable[[FloatArray], None]
    ) -> None:
        """Let a sample pass, while commands run on a straight line between two samples."""
        frames = round(1.0 / (RATE * self.fdm.get_delta_t()))
        for k in range(1, frames + 1):
            command(before + (after - before) * (k / frames))
            self.fdm.run()


class Aircraft(Executive):
    """A clean stock aircraft, gear up, its throttle fixed."""

    passes = PASSES

    def __init__(self, stock: Stock) -> None:
        super().__init__(None, stock.model, STEP)
        self.set(UNCONTROLLED)
        throttle = stock.throttle or 0.0
        self.stock, self.running = stock, stock.throttle is not None
        self.fixed = {**CLEAN, "fcs/throttle-pos-norm": throttle, "fcs/throttle-pos-norm[1]": throttle}

    def put(self, state: State, deflections: Mapping[str, float]) -> None:
        """Put the aircraft into a state and evaluate its forces there until they rest; no time passes."""
        plane = state.V * np.cos(state.beta)
        u, v, w = plane * np.cos(state.alpha), state.V * np.sin(state.beta), plane * np.sin(state.alpha)
        commands = {**self.fixed, **self.surfaces(deflections)}
        angles = {"ic/phi-rad": state.phi, "ic/theta-rad": state.theta, "ic/psi-true-rad": 0.0}
        speeds = {"ic/u-fps": u / FOOT, "ic/v-fps": v / FOOT, "ic/w-fps": w / FOOT}  # in axes of these angles
        rates = {f"ic/{a}-rad_sec": getattr(state, a) for a in "pqr"}
        self.begin({"ic/h-sl-ft": state.altitude / FOOT, **angles, **speeds, **rates, **commands})
        self.set({"propulsion/fuel_freeze": 1.0, **commands})
        if self.running:
            self.fdm.get_propulsion().init_running(-1)
        self.fdm.suspend_integration()
        for _ in range(self.passes):
            self.fdm.run()
        self.fdm.resume_integration()

    def surfaces(self, deflections: Mapping[str, float]) -> dict[str, float]:
        """Return deflections by property."""
        return {self.stock.surfaces[control]: value for control, value in deflections.items()}

    def deflection(self, control: str) -> float:
        """Return where a surface stands, rad."""
        return float(self[self.stock.surfaces[control]])

    @property
    def apparent_gravity(self) -> float:
        """What acts on level flight north over the equator, m/s2.

        Attraction, less the centrifugal accelerations of the turning Earth and of flight around it.
        """
        radius, speed = self["position/radius-to-vehicle-ft"] * FOOT, self["velocities/vt-fps"] * FOOT
        return self["accelerations/gravity-ft_sec2"] * FOOT - EARTH_RATE**2 * radius - speed**2 / radius


def trimmed(aircraft: Aircraft) -> Trim:
    """Return the straight flight at the stock's airspeed; what the thrust leaves over climbs or sinks."""
    stock = aircraft.stock

    def point(x: FloatArray) -> Trim:
        alpha, theta, phi = (float(v) for v in x[:3])
        state = State(stock.airspeed, stock.altitude, alpha=alpha, theta=theta, phi=phi)
        return Trim(state, dict(zip(SURFACES, map(float, x[3:]), strict=True)))

    def accelerations(x: FloatArray) -> FloatArray:
        trim = point(x)
        aircraft.put(trim.state, trim.deflections)
        return aircraft.read(ACCELERATIONS)

    found = root(accelerations, np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]), tol=1e-10)
    if np.abs(found.fun).max() > 1e-6:
        raise StoopError(
            f"jsbsim: {stock.model} finds no trim at {stock.airspeed:g} m/s; its data may have changed"
        )
    return point(found.x)


def fly(aircraft: Aircraft, trim: Trim) -> Recording:
    """Fly orthogonal multisines on all controls from trim, and read the instruments at 100 Hz.

    Between the samples the deflections change linearly, as an identification takes them to do.
    """
    amplitudes = {c: (a, i + 5) for i, (c, a) in enumerate(aircraft.stock.amplitude.items())}
    span = (1.0, DURATION - 2.0)
    planned = multisine_maneuver(amplitudes, DURATION, float(RATE), aircraft.stock.band, span)
    time, changes = planned.time, planned.deflections()
    deflections = np.column_stack([trim.deflections[c] + changes.get(c, 0.0 * time) for c in SURFACES])
    channels = {**READ, **{c: (aircraft.stock.surfaces[c], 1.0) for c in SURFACES}}

    def command(values: FloatArray) -> None:
        aircraft.set(aircraft.surfaces(dict(zip(SURFACES, values.tolist(), strict=True))))

    aircraft.put(trim.state, dict(zip(SURFACES, deflections[0], strict=True)))
    rows = [aircraft.sample(channels)]
    for before, after in itertools.pairwise(deflections):
        aircraft.pass_sample(before, after, command)
        rows.append(aircraft.sample(channels))
    return Recording(time, dict(zip(channels, np.array(rows).T, strict=True)))

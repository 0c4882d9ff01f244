"""Aircraft of JSBSim's package under a test pilot: their own flight control, engines and turbulence, nothing of ours.

The pilot's gains come from JSBSim's own accelerations by finite differences; he settles the aircraft, then flies doublets
and 3-2-1-1 on all controls and steps of the throttle, and holds on less while a maneuver runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT, POUND_FORCE, SLUG
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import StoopError
from stoop.exporters.jsbsim_flight import simulator
from stoop.vehicle import Vehicle
from stoop_studies.verify import jsbsim, jsbsim_flight
from stoop_studies.verify.jsbsim_flight import State, Stock, Trim
from stoop_studies.verify.pilots import HANDS_OFF, RESPONSE, Columns
from stoop_studies.verify.scenes import step_maneuvers

RATE: Final = 400.0  #: Hz, of JSBSim's steps and of what is true
PILOT_RATE: Final = 50.0  #: Hz
SETTLE: Final = 60.0  #: s before the record
DURATION: Final = 130.0  #: s
PASSES: Final = 400  #: evaluations at a fixed state: a second for the actuators
SURFACES: Final = jsbsim_flight.SURFACES
COMMANDS: Final = {name: f"fcs/{name}-cmd-norm" for name in SURFACES}
READ: Final = {
    **{n: jsbsim_flight.READ[n] for n in ("V", "alpha", "beta", *RATES, *EULER, "altitude")},
    **{n: (f"velocities/v-{a}-fps", FOOT) for n, a in zip(VELOCITY, ("north", "east", "down"), strict=True)},
    **{n: (prop, 1.0) for n, prop in SURFACES.items()},
}
#: severity of MIL-F-8785C, and wind at 20 ft, m/s
GUSTS: Final = {"calm": (0.0, 0.0), "light": (3.0, 4.0), "moderate": (4.0, 8.0)}
#: control, shape, and longer than the usual step
SERIES: Final = (
    ("elevator", "3-2-1-1", 1.0), ("rudder", "doublet", 1.0), ("aileron", "1-1", 1.0), ("elevator", "doublet", 1.6),
    ("rudder", "3-2-1-1", 0.6), ("aileron", "3-2-1-1", 0.8), ("elevator", "3-2-1-1", 1.2), ("rudder", "doublet", 0.8),
    ("aileron", "doublet", 1.3), ("elevator", "doublet", 1.0),
)  # fmt: skip
THROTTLE_AFTER: Final = 6  #: of these, a step of the throttle


@dataclass(frozen=True)
class Model:
    """An aircraft of the package: where it flies, and what a person sees of it."""

    name: str
    airspeed: float  #: m/s, true
    altitude: float  #: m
    engine: str = "piston"  #: as of `stoop vehicle new`
    template: str = "conventional"
    throttle: float = 0.6  #: to start from
    declared: Sequence[str] = ()  #: properties of a flight simulator that its files read


@dataclass(frozen=True, eq=False)
class OutsideFlight:
    """What happened: columns (n,) by variable, SI, at the center of gravity, and what is true of the vehicle."""

    rate: float  #: Hz
    columns: Columns
    tape: Mapping[str, float]  #: mass, span, chord
    truth: Callable[[Vehicle], Vehicle]  #: from a file to the vehicle that has the true value of its terms
    asked: Mapping[str, str]  #: what a person sees: template, engine
    reversed: tuple[str, ...] = ()  #: surfaces that its simulator counts the other way than the registry


class Airframe(jsbsim_flight.Aircraft):
    """JSBSim with an aircraft and its flight control; gear up."""

    def __init__(self, model: Model) -> None:
        self.fdm, self.model = simulator(None), model
        self.fdm.set_dt(1.0 / RATE)  # before the filters of its flight control are made
        if not self.fdm.load_model(model.name):
            raise StoopError(f"outside: JSBSim's package has no {model.name}; install jsbsim 1.2 or later")
        self.set(dict.fromkeys(model.declared, 0.0))
        self.fdm.disable_output()
        self.stock = Stock(
            model=model.name, title=model.name, airspeed=model.airspeed, alpha=0.0, altitude=model.altitude, amplitude={}
        )  # fmt: skip
        self.commands = dict.fromkeys(SURFACES, 0.0)  #: where deflections count from
        self.neutral, self.gain = dict.fromkeys(SURFACES, 0.0), dict.fromkeys(SURFACES, 1.0)
        self.throttle = model.throttle

    def point(self, name: str) -> tuple[float, float, float]:
        """Return the center of gravity, about which a drafted file counts moments, for any point but the eye."""
        return super().point(jsbsim.CENTER)

    def read(self, names: Iterable[str]) -> FloatArray:
        """Return properties; the engines' moments count with those of the air: a drafted file has no thrust line or torque."""
        places = list(names)
        turning = [n.replace("-aero-", "-prop-") for n in places if n.startswith("moments/")]
        engines = turning and self.fdm.get_propulsion().get_num_engines()
        return super().read(places) + (super().read(turning) if engines else 0.0)

    def steer(self, commands: Mapping[str, float], throttle: float) -> None:
        """Move stick, pedals and all throttles."""
        self.set({COMMANDS[c]: value for c, value in commands.items()})
        engines = range(self.fdm.get_propulsion().get_num_engines())
        self.set({f"fcs/throttle-cmd-norm[{i}]": throttle for i in engines})

    def put(self, state: State, deflections: Mapping[str, float]) -> None:
        """Put the aircraft into a state and its surfaces at deflections, rad; no time passes but for its actuators."""
        commands = {
            c: self.commands[c] + (x - self.neutral[c]) / self.gain[c] for c, x in deflections.items()
        }
        plane = state.V * np.cos(state.beta)
        u, v, w = plane * np.cos(state.alpha), state.V * np.sin(state.beta), plane * np.sin(state.alpha)
        self.steer(commands, self.throttle)
        self.begin({
            "ic/h-sl-ft": state.altitude / FOOT, "ic/phi-rad": state.phi, "ic/theta-rad": state.theta,
            "ic/psi-true-rad": 0.0, "ic/u-fps": u / FOOT, "ic/v-fps": v / FOOT, "ic/w-fps": w / FOOT,
            **{f"ic/{a}-rad_sec": getattr(state, a) for a in RATES},
        })  # fmt: skip
        self.set({"gear/gear-cmd-norm": 0.0, "gear/gear-pos-norm": 0.0, "propulsion/fuel_freeze": 1.0})
        self.steer(commands, self.throttle)
        self.fdm.get_propulsion().init_running(-1)
        self.fdm.suspend_integration()
        for _ in range(PASSES):
            self.fdm.run()
        self.fdm.resume_integration()

    def measure_gains(self, state: State) -> None:
        """Find what a command moves, where the commands now stand."""
        self.gain, self.neutral = dict.fromkeys(SURFACES, 1.0), dict.fromkeys(SURFACES, 0.0)
        self.put(state, dict.fromkeys(SURFACES, 0.0))
        neutral, gain, step = self.deflections(), {}, 0.1
        for c in SURFACES:
            ends = []
            for x in (-step, step):
                self.put(state, {**dict.fromkeys(SURFACES, 0.0), c: x})
                ends.append(self.deflections()[c])
            gain[c] = (ends[1] - ends[0]) / (2.0 * step)
        if min(map(abs, gain.values())) < 1e-3:
            raise StoopError(f"outside: {self.model.name}: a command moves nothing ({gain})")
        self.neutral, self.gain = neutral, gain

    def deflections(self) -> dict[str, float]:
        """Return the deflections of the surfaces, rad."""
        return {c: self[place] for c, place in SURFACES.items()}

    def now(self) -> dict[str, float]:
        """Return what is recorded: `READ`, and the specific force at the center of gravity."""
        row = dict(zip(READ, self.sample(READ).tolist(), strict=True))
        mass = self["inertia/mass-slugs"] * SLUG
        for axis, name in zip("xyz", SPECIFIC_FORCE, strict=True):
            row[name] = self[f"forces/fb{axis}-total-lbs"] * POUND_FORCE / mass
        return row


def slopes(aircraft: Airframe, state: State) -> dict[str, float]:
    """Return what angular acceleration changes by, about a state: pitch, roll and yaw stiffness, damping and power.

    In rad/s2 per rad, rad/s, and full command.
    """
    base = aircraft.neutral

    def turned(change: Mapping[str, float], surface: str, axis: str, step: float) -> float:
        out, unit = [], "ft" if axis == "w" else "rad"
        for sign in (-1.0, 1.0):
            moved = (
                {**base, surface: base[surface] + sign * step * aircraft.gain[surface]} if surface else base
            )
            aircraft.put(
                replace(state, **{n: getattr(state, n) + sign * x for n, x in change.items()}), moved
            )
            out.append(aircraft[f"accelerations/{axis}dot-{unit}_sec2"])
        return (out[1] - out[0]) / 2.0

    return {
        "Mq": turned({"alpha": 0.02, "theta": 0.02}, "", "q", 0.0) / 0.02, "Me": turned({}, "elevator", "q", 0.05) / 0.05,
        "Md": turned({"q": 0.05}, "", "q", 0.0) / 0.05, "Za": turned({"alpha": 0.02, "theta": 0.02}, "", "w", 0.0) * FOOT / 0.02,
        "Lp": turned({"p": 0.1}, "", "p", 0.0) / 0.1, "La": turned({}, "aileron", "p", 0.05) / 0.05,
        "Nb": turned({"beta": 0.02}, "", "r", 0.0) / 0.02, "Nr": turned({}, "rudder", "r", 0.05) / 0.05,
    }  # fmt: skip


class Pilot:
    """Holds height (a glider: speed), speed, wings level and the nose along the airflow; integrals stop with the record."""

    def __init__(self, aircraft: Airframe, state: State, powered: bool) -> None:
        k, model = slopes(aircraft, state), aircraft.model
        self.short = float(np.sqrt(max(abs(k["Mq"]), 0.3)))
        self.stable = k["Mq"] < 0.0
        self.roll_time = 1.0 / max(-k["Lp"], 0.5)
        self.dutch = float(np.sqrt(max(k["Nb"], 0.1)))
        self.power, self.state, self.powered = k, state, powered
        self.trim = {"theta": state.theta, "elevator": 0.0, "aileron": 0.0, "rudder": 0.0}
        self.trim["throttle"] = model.throttle if powered else 0.0
        self.span = aircraft["metrics/bw-ft"] * FOOT

    def sizes(self) -> dict[str, float]:
        """Return commands for the responses that test plans ask for."""
        k = self.power
        helix = 2.0 * self.state.V * RESPONSE.helix / self.span
        wanted = {
            "elevator": RESPONSE.alpha
            * (self.short**2 + abs(k["Md"] * k["Za"]) / self.state.V)
            / abs(k["Me"]),
            "aileron": helix / self.roll_time / abs(k["La"]),
            "rudder": RESPONSE.beta * self.dutch**2 / abs(k["Nr"]),
        }
        return {c: float(np.clip(x, 0.03, 0.5)) for c, x in wanted.items()}

    def stick(self, commands: Mapping[str, float]) -> dict[str, float]:
        """Return commands as the registry counts them: nose up, right wing down, nose right."""
        signs = {
            "control_pitch": ("elevator", "Me"),
            "control_roll": ("aileron", "La"),
            "control_yaw": ("rudder", "Nr"),
        }
        return {n: float(np.sign(self.power[of])) * commands[c] for n, (c, of) in signs.items()}

    def reversed(self, gains: Mapping[str, float]) -> tuple[str, ...]:
        """Return the surfaces whose positive deflection is nose up, left wing down, or nose right."""
        turns = {"elevator": -self.power["Me"], "aileron": self.power["La"], "rudder": -self.power["Nr"]}
        return tuple(c for c, x in turns.items() if x * gains[c] < 0.0)

    def command(
        self, now: Mapping[str, float], hold: float, learning: bool
    ) -> tuple[dict[str, float], float]:
        """Return the commands and the throttle by the readings of a sample."""
        t, k, V = self.trim, self.power, self.state.V
        climb = float(np.clip(0.1 * (self.state.altitude - now["altitude"]) / V, -0.06, 0.06))
        slow = (V - now["V"]) / V
        wanted = t["theta"] + (climb + 0.3 * now["vd"] / V if self.powered else -0.6 * slow)
        error = wanted - now["theta"]
        pitch = (0.8 if self.stable else 2.0) * self.short**2 / k["Me"]
        roll = -1.0 / (self.roll_time * k["La"])
        u = {
            "elevator": t["elevator"] + hold * pitch * (error - 0.8 / self.short * now["q"]),
            "aileron": t["aileron"] + hold * roll * (now["phi"] + 0.3 * self.roll_time * now["p"]),
            "rudder": t["rudder"] - hold * 0.3 / k["Nr"] * self.dutch * now["r"],
        }
        throttle = float(np.clip(t["throttle"] + 3.0 * slow, 0.0, 1.0)) if self.powered else 0.0
        if learning:
            dt = 1.0 / PILOT_RATE
            t["elevator"] += dt * 0.5 * pitch * error
            t["theta"] += dt * (0.05 * (climb + now["vd"] / V) if self.powered else -0.1 * slow)
            t["aileron"] += dt * 0.2 * roll * now["phi"]
            t["rudder"] += dt * 0.3 * self.dutch**2 * now["beta"] / k["Nr"]
            t["throttle"] = float(np.clip(t["throttle"] + dt * 0.3 * slow, 0.0, 1.0))
        return {c: float(np.clip(x, -1.0, 1.0)) for c, x in u.items()}, throttle


def plan(pilot: Pilot, rng: np.random.Generator) -> tuple[Columns, FloatArray]:
    """Return changes of the commands (n,) at the pilot's rate, and how much he holds on."""
    roll = float(np.clip(4.0 * pilot.span / pilot.state.V, 0.4, 1.5))
    steps = {
        "elevator": float(np.clip(RESPONSE.step / pilot.short, 0.15, 1.5)), "aileron": roll,
        "rudder": float(np.clip(RESPONSE.half_period * 2.0 * np.pi / pilot.dutch, 0.3, 2.5)),
    }  # fmt: skip
    count, sizes, inputs = round(DURATION * PILOT_RATE), pilot.sizes(), []
    hold, time = np.ones(count), np.arange(count) / PILOT_RATE
    for i, (control, shape, longer) in enumerate(SERIES):
        start = (
            4.0
            + i * (DURATION - 8.0) / (len(SERIES) + 1)
            + rng.uniform(0.0, 1.5)
            + 10.0 * (i >= THROTTLE_AFTER)
        )
        size = float(np.clip(sizes[control] * rng.uniform(0.8, 1.3), 0.03, 0.6)) * rng.choice((-1.0, 1.0))
        step = float(longer * steps[control] * rng.uniform(0.9, 1.1))
        inputs.append((control, shape, start, step, size))
        hold[(time > start - 0.3) & (time < start + 8.0 * step + 2.0)] = HANDS_OFF if pilot.stable else 1.0
    changes = step_maneuvers({"plan": tuple(inputs)}, DURATION, PILOT_RATE)["plan"].deflections()
    start = 4.0 + THROTTLE_AFTER * (DURATION - 8.0) / (len(SERIES) + 1)
    push = rng.uniform(0.12, 0.25) * rng.choice((-1.0, 1.0)) * ((time > start) & (time < start + 7.0))
    return {**{c: x[:count] for c, x in changes.items()}, "throttle": push}, hold


def fly(model: Model, seed: int, gusts: str = "calm") -> OutsideFlight:
    """Settle an aircraft, and fly the maneuvers of a seed.

    Raises
    ------
    StoopError
        It does not settle, or leaves its flight.
    """
    aircraft, state = Airframe(model), State(model.airspeed, model.altitude, alpha=0.05, theta=0.05)
    powered = model.engine != "none"
    aircraft.measure_gains(state)
    pilot = Pilot(aircraft, state, powered)
    aircraft.put(state, aircraft.neutral)
    planned, hold = plan(pilot, np.random.default_rng([51, seed]))
    rows: list[dict[str, float]] = []
    frames, settle = round(RATE / PILOT_RATE), round(SETTLE * PILOT_RATE)
    now = aircraft.now()
    for k in range(-settle, len(hold)):
        commands, throttle = pilot.command(now, 1.0 if k < 0 else float(hold[k]), k < 0)
        if k == 0:
            _require_steady(model, now)
            aircraft.set({"atmosphere/turb-type": 3.0, "atmosphere/turbulence/milspec/severity": GUSTS[gusts][0],
                          "atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps": GUSTS[gusts][1] / FOOT})  # fmt: skip
            aircraft.commands, aircraft.throttle = dict(commands), throttle
        if k >= 0:
            commands = {
                c: float(np.clip(x + planned.get(c, hold)[k] * (c in planned), -1.0, 1.0))
                for c, x in commands.items()
            }
            throttle = float(np.clip(throttle + planned["throttle"][k], 0.0, 1.0)) if powered else 0.0
        aircraft.steer(commands, throttle)
        for _ in range(frames):
            if k >= 0:
                rows.append({**aircraft.now(), "control_throttle": throttle, **pilot.stick(commands)})
            aircraft.fdm.run()
        now = aircraft.now()
    columns = {n: np.array([row[n] for row in rows]) for n in rows[0]}
    if np.ptp(columns["altitude"]) > 600.0 or not np.all(np.abs(columns["alpha"]) < 0.4):
        raise StoopError(f"outside: {model.name} leaves its flight")
    if not powered:
        del columns["control_throttle"]
    tape = {"mass": aircraft["inertia/mass-slugs"] * SLUG, "span": pilot.span}
    tape["chord"] = aircraft["metrics/Sw-sqft"] * FOOT**2 / pilot.span
    return OutsideFlight(
        RATE, columns, tape, lambda file: true_vehicle(aircraft, file, columns),
        {"template": model.template, "engine": model.engine}, pilot.reversed(aircraft.gain),
    )  # fmt: skip


def _require_steady(model: Model, now: Mapping[str, float]) -> None:
    turning = max(abs(now[a]) for a in RATES)
    if turning > 0.02 or abs(now["V"] / model.airspeed - 1.0) > 0.05 or abs(now["phi"]) > 0.1:
        raise StoopError(f"outside: {model.name} does not settle at {model.airspeed:g} m/s")


def true_vehicle(aircraft: Airframe, file: Vehicle, columns: Columns) -> Vehicle:
    """Return the vehicle whose terms are those of a file, with JSBSim's derivatives about the flown condition."""
    means = {n: float(x.mean()) for n, x in columns.items()}
    state = State(means["V"], means["altitude"], alpha=means["alpha"], theta=means["theta"])
    aircraft.measure_gains(state)
    aircraft.stock = replace(
        aircraft.stock, airspeed=file.value("reference.airspeed"), alpha=file.value("reference.alpha", 0.0),
        added={c: dict(group) for c, group in file.terms.items()},
    )  # fmt: skip
    trim = Trim(state, aircraft.deflections() if not columns else {c: means[c] for c in SURFACES})
    vehicle = jsbsim.vehicle_of(aircraft, trim)
    flown = jsbsim_flight.Recording(np.arange(len(columns["V"])) / RATE, columns)
    values = jsbsim.derivatives(aircraft, trim, vehicle, flown)
    return vehicle.with_numbers({n: {"value": v} for n, v in values.items()})

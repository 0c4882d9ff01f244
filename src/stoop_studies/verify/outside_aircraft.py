"""Aircraft of JSBSim's package under a test pilot: their own flight control, engines and turbulence, nothing of ours.

The pilot's gains come from JSBSim's own accelerations by finite differences; he settles the aircraft, then flies doublets
and 3-2-1-1 on all controls and steps of the throttle, and holds on less while a maneuver runs.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT, POUND_FORCE, SLUG
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.errors import StoopError
from stoop.vehicle import Vehicle
from stoop_studies.verify import jsbsim, jsbsim_flight
from stoop_studies.verify.instruments import COMMANDS, SIGNS
from stoop_studies.verify.jsbsim_flight import SURFACES, Executive, State, Stock, Trim
from stoop_studies.verify.pilots import HANDS_OFF, RESPONSE, Columns
from stoop_studies.verify.scenes import step_maneuvers
from stoop_studies.verify.study import data_text

RATE: Final = 400.0  #: Hz, of JSBSim's steps and of what is true
PILOT_RATE: Final = 50.0  #: Hz
SETTLE: Final = 60.0  #: s before the record
DURATION: Final = 130.0  #: s
READ: Final = {
    **{n: jsbsim_flight.READ[n] for n in ("V", "alpha", "beta", *RATES, *EULER, "altitude")},
    **{n: (f"velocities/v-{a}-fps", FOOT) for n, a in zip(VELOCITY, ("north", "east", "down"), strict=True)},
    **{n: (prop, 1.0) for n, prop in SURFACES.items()},
}
MOMENTS: Final = tuple(f"moments/{a}-aero-lbsft" for a in "lmn")
SPHERE: Final = {a: float(a[0] == a[1]) for a in ("xx", "yy", "zz", "xy", "xz", "yz")}  #: kg m2
TABLES: Final[Mapping[str, Any]] = tomllib.loads(data_text("outside.toml"))
THROTTLE: Final = 0.6  #: to start from
THROTTLE_AFTER: Final = 6  #: maneuvers, a step of the throttle


@dataclass(frozen=True, kw_only=True)
class Model(Stock):
    """An aircraft of the package: where it flies, and what a person sees of it."""

    engine: str = "piston"  #: as of `stoop vehicle new`
    template: str = "conventional"
    declared: Sequence[str] = ()  #: properties of a flight simulator that its files read


@dataclass(frozen=True, eq=False)
class OutsideFlight:
    """What happened: columns (n,) by variable, SI, at the center of gravity, and what is true of the vehicle."""

    rate: float  #: Hz
    columns: Columns
    tape: Mapping[str, float]  #: mass, span, chord
    #: from a file, the columns where it was fitted, and whether its controls are sticks, to the vehicle that has the true value
    #: of its terms
    truth: Callable[[Vehicle, Columns, bool], Vehicle]
    asked: Mapping[str, str]  #: what a person sees: template, engine
    reversed: tuple[str, ...] = ()  #: surfaces that its simulator counts the other way than the registry
    #: s, by which commands and speeds of rotors (motor, rotor) act later than straight lines through their samples
    late: Mapping[str, float] = field(default_factory=dict)
    #: surface -> rad per unit of its stick, without what the flight control adds
    stick_gain: Mapping[str, float] = field(default_factory=dict)

    def by_sticks(self) -> dict[str, FloatArray]:
        """Return the columns with the deflections that the sticks ask for."""
        out = dict(self.columns)
        for surface, gain in self.stick_gain.items():
            stick = out[COMMANDS[surface]]
            out[surface] = out[surface].mean() + gain * (stick - stick.mean())
        return out


class Airframe(jsbsim_flight.Aircraft):
    """JSBSim with an aircraft, its flight control and its engines; gear up."""

    passes, running = 400, True  #: a second for the actuators

    def __init__(self, model: Model) -> None:
        Executive.__init__(self, None, model.model, 1.0 / RATE)
        self.set(dict.fromkeys(model.declared, 0.0))
        self.fixed = {"gear/gear-cmd-norm": 0.0, "gear/gear-pos-norm": 0.0}
        self.stock, self.throttle = model, THROTTLE
        self.engines = range(self.fdm.get_propulsion().get_num_engines())
        self.commands = dict.fromkeys(SURFACES, 0.0)  #: where deflections count from
        self.neutral, self.gain = dict.fromkeys(SURFACES, 0.0), dict.fromkeys(SURFACES, 1.0)
        self.turning: dict[str, float] = {}  #: moments of the engines in flight, by property
        self.by_stick = False  #: whether deflections count as asked for, without what the flight control adds
        self.asked: Mapping[str, float] = {}

    def point(self, name: str) -> tuple[float, float, float]:
        """Return the center of gravity, about which a drafted file counts moments, for any point but the eye."""
        return super().point(jsbsim.CENTER)

    def put(self, state: State, deflections: Mapping[str, float]) -> None:
        """Put the aircraft into a state, its engines as in steady flight there: a propeller blows on wing and tail."""
        self.asked = deflections
        super().put(state, deflections)
        self.fdm.suspend_integration()
        self.fdm.get_propulsion().get_steady_state()
        self.fdm.run()
        self.fdm.resume_integration()

    def deflection(self, control: str) -> float:
        """Return where a surface stands, or what its stick asks for, rad."""
        return self.asked[control] if self.by_stick else super().deflection(control)

    def read(self, names: Iterable[str]) -> FloatArray:
        """Return properties; the engines' moments count with those of the air: a drafted file has no thrust line or torque.

        They are those of the flight: engines that are put into a state do not turn as they do in flight.
        """
        places = list(names)
        return np.asarray(super().read(places) + [self.turning.get(n, 0.0) for n in places])

    def sticks(self, commands: Mapping[str, float], throttle: float) -> dict[str, float]:
        """Return the properties of stick, pedals and all throttles."""
        sticks = {f"fcs/{c}-cmd-norm": value for c, value in commands.items()}
        return sticks | {f"fcs/throttle-cmd-norm[{i}]": throttle for i in self.engines}

    def surfaces(self, deflections: Mapping[str, float]) -> dict[str, float]:
        """Return the commands that hold deflections, by property."""
        moved = {c: (x - self.neutral[c]) / self.gain[c] for c, x in deflections.items()}
        return self.sticks({c: self.commands[c] + x for c, x in moved.items()}, self.throttle)

    def measure_gains(self, state: State) -> None:
        """Find what a command moves, where the commands now stand."""
        self.gain, self.neutral = dict.fromkeys(SURFACES, 1.0), dict.fromkeys(SURFACES, 0.0)
        self.put(state, self.neutral)
        neutral = {c: self[place] for c, place in SURFACES.items()}
        self.gain = {c: self.slope(state, [c], 0.1, place) for c, place in SURFACES.items()}
        if min(map(abs, self.gain.values())) < 1e-3:
            raise StoopError(f"outside: {self.stock.model}: a command moves nothing ({self.gain})")
        self.neutral = neutral

    def slope(self, state: State, moved: Sequence[str], step: float, place: str, unit: float = 1.0) -> float:
        """Return the central difference of a property over variables of a state and commands of surfaces."""
        ends = []
        for x in (-step, step):
            held = {c: at + x * self.gain[c] if c in moved else at for c, at in self.neutral.items()}
            self.put(replace(state, **{n: getattr(state, n) + x for n in moved if n not in held}), held)
            ends.append(self[place])
        return (ends[1] - ends[0]) / 2.0 * unit / step

    def now(self) -> dict[str, float]:
        """Return what is recorded: `READ`, and the specific force at the center of gravity."""
        row = dict(zip(READ, self.sample(READ).tolist(), strict=True))
        mass = self["inertia/mass-slugs"] * SLUG
        forces = {n: self[f"forces/fb{n[1]}-total-lbs"] * POUND_FORCE / mass for n in SPECIFIC_FORCE}
        turning = {n: self[n.replace("-aero-", "-prop-")] for n in MOMENTS} if self.engines else {}
        return row | forces | turning


class Pilot:
    """Holds height (a glider: speed), speed, wings level and the nose along the airflow; integrals stop with the record."""

    def __init__(self, aircraft: Airframe, state: State, powered: bool) -> None:
        self.slopes = k = {
            n: aircraft.slope(state, moved, step, f"accelerations/{axis}dot-{unit}_sec2", FOOT if unit == "ft" else 1.0)
            for n, (moved, step, axis, unit) in TABLES["slopes"].items()
        }  # fmt: skip
        self.power = {"elevator": k["Me"], "aileron": k["La"], "rudder": k["Nr"]}
        self.short, self.stable = float(np.sqrt(max(abs(k["Ma"]), 0.3))), k["Ma"] < 0.0
        self.roll_time, self.dutch = 1.0 / max(-k["Lp"], 0.5), float(np.sqrt(max(k["Nb"], 0.1)))
        self.state, self.powered = state, powered
        self.trim = {**dict.fromkeys(SURFACES, 0.0), "theta": state.theta}
        self.trim["throttle"] = THROTTLE if powered else 0.0
        self.span = aircraft["metrics/bw-ft"] * FOOT

    def stick(self, commands: Mapping[str, float]) -> dict[str, float]:
        """Return commands as the registry counts them: nose up, right wing down, nose right."""
        return {COMMANDS[c]: float(np.sign(x)) * commands[c] for c, x in self.power.items()}

    def command(
        self, now: Mapping[str, float], hold: float, learning: bool
    ) -> tuple[dict[str, float], float]:
        """Return the commands and the throttle by the readings of a sample."""
        t, V = self.trim, self.state.V
        climb = float(np.clip(0.1 * (self.state.altitude - now["altitude"]) / V, -0.06, 0.06))
        slow = (V - now["V"]) / V
        wanted = t["theta"] + (climb + 0.3 * now["vd"] / V if self.powered else -0.6 * slow)
        error, nose = wanted - now["theta"], self.power["rudder"]
        pitch = (0.8 if self.stable else 2.0) * self.short**2 / self.power["elevator"]
        roll = -1.0 / (self.roll_time * self.power["aileron"])
        u = {
            "elevator": t["elevator"] + hold * pitch * (error - 0.8 / self.short * now["q"]),
            "aileron": t["aileron"] + hold * roll * (now["phi"] + 0.3 * self.roll_time * now["p"]),
            "rudder": t["rudder"] - hold * 0.3 / nose * self.dutch * now["r"],
        }
        throttle = float(np.clip(t["throttle"] + 3.0 * slow, 0.0, 1.0)) if self.powered else 0.0
        if learning:
            dt = 1.0 / PILOT_RATE
            t["elevator"] += dt * 0.5 * pitch * error
            t["theta"] += dt * (0.05 * (climb + now["vd"] / V) if self.powered else -0.1 * slow)
            t["aileron"] += dt * 0.2 * roll * now["phi"]
            t["rudder"] += dt * 0.3 * self.dutch**2 * now["beta"] / nose
            t["throttle"] = float(np.clip(t["throttle"] + dt * 0.3 * slow, 0.0, 1.0))
        return {c: float(np.clip(x, -1.0, 1.0)) for c, x in u.items()}, throttle


def plan(pilot: Pilot, rng: np.random.Generator) -> tuple[Columns, FloatArray]:
    """Return changes of the commands (n,) at the pilot's rate, sized as test plans ask for, and how much he holds on."""
    k, V, span = pilot.slopes, pilot.state.V, pilot.span
    pitch = RESPONSE.alpha * (pilot.short**2 + abs(k["Mq"] * k["Za"]) / V) / abs(k["Me"])
    roll = 2.0 * V * RESPONSE.helix / span / pilot.roll_time / abs(k["La"])
    sizes = {"elevator": pitch, "aileron": roll, "rudder": RESPONSE.beta * pilot.dutch**2 / abs(k["Nr"])}
    steps = {
        "elevator": float(np.clip(RESPONSE.step / pilot.short, 0.15, 1.5)),
        "aileron": float(np.clip(4.0 * span / V, 0.4, 1.5)),
        "rudder": float(np.clip(RESPONSE.half_period * 2.0 * np.pi / pilot.dutch, 0.3, 2.5)),
    }
    count, series, inputs = round(DURATION * PILOT_RATE), TABLES["series"], []
    hold, time, apart = np.ones(count), np.arange(count) / PILOT_RATE, (DURATION - 8.0) / (len(series) + 1)
    for i, (control, shape, longer) in enumerate(series):
        start = 4.0 + i * apart + rng.uniform(0.0, 1.5) + 10.0 * (i >= THROTTLE_AFTER)
        size = float(np.clip(float(np.clip(sizes[control], 0.03, 0.5)) * rng.uniform(0.8, 1.3), 0.03, 0.6))
        signed, step = size * rng.choice((-1.0, 1.0)), float(longer * steps[control] * rng.uniform(0.9, 1.1))
        inputs.append((control, shape, start, step, signed))
        hold[(time > start - 0.3) & (time < start + 8.0 * step + 2.0)] = HANDS_OFF if pilot.stable else 1.0
    changes = step_maneuvers({"plan": tuple(inputs)}, DURATION, PILOT_RATE)["plan"].deflections()
    start = 4.0 + THROTTLE_AFTER * apart
    push = rng.uniform(0.12, 0.25) * rng.choice((-1.0, 1.0)) * ((time > start) & (time < start + 7.0))
    return {**{c: x[:count] for c, x in changes.items()}, "throttle": push}, hold


def fly(model: Model, seed: int, gusts: str = "calm") -> OutsideFlight:
    """Settle an aircraft, and fly the maneuvers of a seed; a `StoopError` says that it does not settle, or leaves its flight."""
    aircraft, state = Airframe(model), State(model.airspeed, model.altitude, alpha=0.05, theta=0.05)
    aircraft.measure_gains(state)
    pilot = Pilot(aircraft, state, model.engine != "none")
    aircraft.put(state, aircraft.neutral)
    planned, hold = plan(pilot, np.random.default_rng([51, seed]))
    rows: list[dict[str, float]] = []
    now = aircraft.now()
    for k in range(-round(SETTLE * PILOT_RATE), len(hold)):
        commands, throttle = pilot.command(now, 1.0 if k < 0 else float(hold[k]), k < 0)
        if k == 0:
            _begin_record(aircraft, now, gusts)
            aircraft.commands, aircraft.throttle = commands, throttle
        if k >= 0:
            changed = {c: float(planned[c][k]) if c in planned else 0.0 for c in commands}
            commands = {c: float(np.clip(x + changed[c], -1.0, 1.0)) for c, x in commands.items()}
            throttle = float(np.clip(throttle + planned["throttle"][k], 0.0, 1.0)) if pilot.powered else 0.0
        aircraft.set(aircraft.sticks(commands, throttle))
        for _ in range(round(RATE / PILOT_RATE)):
            if k >= 0:
                rows.append({**aircraft.now(), "control_throttle": throttle, **pilot.stick(commands)})
            aircraft.fdm.run()
        now = aircraft.now()
    columns = {
        n: np.array([row[n] for row in rows]) for n in rows[0] if pilot.powered or n != "control_throttle"
    }
    if np.ptp(columns["altitude"]) > 600.0 or not np.all(np.abs(columns["alpha"]) < 0.4):
        raise StoopError(f"outside: {model.model} leaves its flight")
    tape = {"mass": aircraft["inertia/mass-slugs"] * SLUG, "span": pilot.span}
    tape["chord"] = aircraft["metrics/Sw-sqft"] * FOOT**2 / pilot.span
    turned = tuple(c for c, x in pilot.power.items() if SIGNS[c] * x * aircraft.gain[c] < 0.0)
    asked = {"template": model.template, "engine": model.engine}
    calm = Airframe(model)  # the gusts of the flight would move whatever is put into a state
    calm.commands, calm.throttle = aircraft.commands, aircraft.throttle
    gains = {c: float(np.sign(x)) * aircraft.gain[c] for c, x in pilot.power.items()}
    truth = partial(true_vehicle, calm)
    return OutsideFlight(RATE, columns, tape, truth, asked, turned, stick_gain=gains)


def _begin_record(aircraft: Airframe, now: Mapping[str, float], gusts: str) -> None:
    """Require a steady flight, and let the gusts begin."""
    model = aircraft.stock
    turning = max(abs(now[a]) for a in RATES)
    if turning > 0.02 or abs(now["V"] / model.airspeed - 1.0) > 0.05 or abs(now["phi"]) > 0.1:
        raise StoopError(f"outside: {model.model} does not settle at {model.airspeed:g} m/s")
    of, (severity, wind, _) = "atmosphere/turb", TABLES["gusts"][gusts]
    aircraft.set({f"{of}-type": 3.0, f"{of}ulence/milspec/severity": severity,
                  f"{of}ulence/milspec/windspeed_at_20ft_AGL-fps": wind / FOOT})  # fmt: skip


def true_vehicle(aircraft: Airframe, file: Vehicle, columns: Columns, sticks: bool) -> Vehicle:
    """Return the vehicle whose terms are those of a file, with JSBSim's derivatives about the flown condition.

    To a log of sticks what the flight control adds is part of the vehicle: a damper's rudder is damping.
    Its moments of inertia are those of JSBSim's file, be they those of a body or not.
    """
    means = {n: float(x.mean()) for n, x in columns.items()}
    state = State(means["V"], means["altitude"], alpha=means["alpha"], theta=means["theta"])
    aircraft.by_stick = False
    aircraft.measure_gains(state)
    aircraft.by_stick = sticks
    aircraft.turning = {n: means[n] for n in MOMENTS if n in means}
    aircraft.stock = replace(
        aircraft.stock, airspeed=file.value("reference.airspeed"), alpha=file.value("reference.alpha", 0.0),
        added={c: dict(group) for c, group in file.terms.items()},
    )  # fmt: skip
    trim = Trim(state, {c: means[c] for c in SURFACES})
    vehicle = jsbsim.vehicle_of(aircraft, trim, SPHERE)
    flown = jsbsim_flight.Recording(np.arange(len(columns["V"])) / RATE, columns)
    values = jsbsim.derivatives(aircraft, trim, vehicle, flown)
    values |= {f"mass.inertia.{a}": x for a, x in jsbsim.inertia(aircraft).items()}
    return vehicle.with_numbers({n: {"value": v} for n, v in values.items()})

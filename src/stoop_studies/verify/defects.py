"""Simulated flights of vehicles whose file lacks one thing, or nothing: a fixed wing and a quadrotor.

Each `Defect` says what the truth has, or how its instruments deceive, and what the user's vehicle file says instead. A seed
draws maneuvers that excite all axes, sensor biases, white noise, and starting values that are wrong.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import tomlkit

from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of_angles
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.flight import Flight
from stoop.problem.windows import Window
from stoop.simulation import trim
from stoop.simulation.delays import delayed
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.verify import scenes
from stoop_studies.verify.scenes import Scene

Entries = Mapping[str, Any]  #: place in a vehicle file -> what stands there; None removes it
Recorder = Callable[[Flight], Flight]
ALIGNMENT: Final = np.radians(4.0)


@dataclass(frozen=True)
class Kind:
    """A kind of vehicle: its file, how it is flown, and by which method it is identified."""

    base: Callable[[], str]
    maneuvers: Callable[[np.random.Generator], Mapping[str, Maneuver]]
    windows: Callable[[Mapping[str, Maneuver]], tuple[Window, ...]]
    biases: Mapping[str, float]  #: standard deviation of each flight's sensor biases, and their prior
    method: str


@dataclass(frozen=True)
class Defect:
    """What the user's vehicle file lacks."""

    name: str
    words: str
    size: str
    kind: str  #: of vehicle, see `KINDS`
    names: frozenset[str]  #: extensions that name it
    #: further extensions that much the same data would follow from
    alike: frozenset[str] = frozenset()
    truth: Entries = field(default_factory=dict)  #: of the truth alone
    user: Entries = field(default_factory=dict)  #: of the user's file alone
    both: Entries = field(default_factory=dict)
    record: Recorder | None = None  #: how the instruments record a flight, where they deceive


RIGHT: Final = ("none", "quad-none")  #: names of what is no defect


def edited(text: str, *changes: Entries) -> str:
    """Return the text of a vehicle file with further entries."""
    document: Any = tomlkit.parse(text)
    for place, value in (item for entries in changes for item in entries.items()):
        *tables, key = place.split(".")
        table = document
        for name in tables:
            table = table.setdefault(name, {})
        if value is None:
            table.pop(key, None)
        else:
            table[key] = value
    return tomlkit.dumps(document)


# ---------------------------------------------------------------- fixed wing

DURATION, RATE = 10.0, 50.0  #: s, Hz
FLIGHTS: Final = ("first", "second", "third")
THROTTLE: Final = 0.5  #: of the steady flight


def _known(value: float) -> dict[str, Any]:
    """Return an entry that is not estimated."""
    return {"value": round(value, 3), "free": False}


@functools.cache
def fixed_wing() -> str:
    """Return the file of the twin-boom aircraft: none of its coefficients is zero, the thrust follows the throttle."""
    plain = scenes.aircraft()
    point = trim(plain, None, scenes.ALTITUDE)
    # Angles of attack are counted from the trim: alpha^2 is then no multiple of alpha.
    alpha, known = round(point.start["alpha"], 3), {n: plain.value(n) for n in scenes.coefficients(plain)}
    known["CD0"] += alpha * (known["CDalpha"] + alpha * known["CDalpha2"])
    known["CDalpha"] += 2.0 * alpha * known["CDalpha2"]
    known |= {f"{c}0": known[f"{c}0"] + alpha * known[f"{c}alpha"] for c in ("CL", "Cm")}
    terms = {f"aerodynamics.{name[:2]}.{name}": round(value, 6) for name, value in known.items()}
    thrust = point.thrust["propulsion.thrust"]
    power = {
        "propulsion": {"kind": "channel", "channel": "throttle", "scale": _known(thrust / THROTTLE)},
        "controls": {"elevator": {}, "aileron": {}, "rudder": {}},
        "mass.inertia.xz": 15.0,
        "reference.alpha": alpha,
    }
    return edited(plain.text, terms, power)


def wing_maneuvers(rng: np.random.Generator) -> Mapping[str, Maneuver]:
    """Draw maneuvers that move all controls, one after the other and together."""

    def steps(
        control: str, shape: str, start: float, step: tuple[float, float], size: tuple[float, float]
    ) -> Any:
        return {
            "control": control, "shape": shape, "start": start + rng.uniform(0.0, 0.5), "step": rng.uniform(*step),
            "amplitude": rng.uniform(*size) * rng.choice((-1.0, 1.0)),
        }  # fmt: skip

    def one() -> Maneuver:
        inputs = [
            steps("elevator", "3-2-1-1", 0.5, (0.25, 0.35), (0.10, 0.16)),
            steps("aileron", "2-1-1", 1.5, (0.3, 0.6), (0.10, 0.20)),
            steps("rudder", "doublet", 3.0, (0.4, 0.8), (0.10, 0.18)),
            steps("elevator", "doublet", 4.5, (0.5, 1.0), (0.08, 0.14)),
            steps("aileron", "doublet", 5.5, (0.4, 0.7), (0.10, 0.20)),
            steps("rudder", "2-1-1", 6.5, (0.3, 0.5), (0.06, 0.12)),
        ]
        power = rng.uniform(0.1, 0.25) * rng.choice((-1.0, 1.0))
        throttle = {
            "control": "throttle",
            "shape": "pulse",
            "start": 2.0,
            "duration": 4.0,
            "amplitude": power,
        }
        return Maneuver.model_validate(
            {"duration": DURATION, "rate": RATE, "altitude": scenes.ALTITUDE, "input": [*inputs, throttle]}
        )

    return {name: one() for name in FLIGHTS}


def whole(maneuvers: Mapping[str, Maneuver]) -> tuple[Window, ...]:
    """Return a window on all of each maneuver."""
    return tuple(Window(name, 0.0, maneuver.duration) for name, maneuver in maneuvers.items())


# ---------------------------------------------------------------- quadrotor

ROTOR_RATE: Final = 100.0  #: Hz
ROTOR_DURATION: Final = 6.0  #: s
SPAN: Final = 1.0  #: s, of a window
ROTOR_BIASES: Final = {"p": 0.01, "q": 0.01, "r": 0.01, "ax": 0.05, "ay": 0.05, "az": 0.05}


@functools.cache
def quadrotor() -> str:
    """Return the file of the built-in quadrotor, with a delay of its motors."""
    return resolve_vehicle("quad-x").text


def rotor_maneuvers(rng: np.random.Generator) -> Mapping[str, Maneuver]:
    """Draw flights in which the autopilot's commands are shaken on all axes and the velocity is changed."""

    def shake(control: str, start: float, step: tuple[float, float], size: tuple[float, float]) -> Any:
        return {
            "control": control, "shape": "3-2-1-1", "start": start + rng.uniform(0.0, 0.3), "step": rng.uniform(*step),
            "amplitude": rng.uniform(*size) * rng.choice((-1.0, 1.0)),
        }  # fmt: skip

    def one() -> Maneuver:
        inputs = [
            shake("roll", 0.3, (0.1, 0.2), (10.0, 18.0)),
            shake("pitch", 1.3, (0.1, 0.2), (10.0, 18.0)),
            shake("yaw", 2.0, (0.1, 0.2), (1.0, 2.0)),
            shake("heave", 3.0, (0.1, 0.2), (2.0, 4.0)),
            shake("roll", 4.2, (0.1, 0.2), (8.0, 15.0)),
            shake("pitch", 4.3, (0.1, 0.2), (8.0, 15.0)),
            shake("yaw", 4.4, (0.2, 0.3), (1.0, 2.0)),
        ]
        ahead, right, down = rng.uniform(-6.0, 6.0, 3) * (1.0, 1.0, 0.4)
        return Maneuver.model_validate(
            {
                "duration": ROTOR_DURATION, "rate": ROTOR_RATE, "altitude": scenes.ALTITUDE,
                "velocity": (ahead, right, down), "input": inputs,
            }
        )  # fmt: skip

    return {name: one() for name in FLIGHTS[:2]}


def pieces(maneuvers: Mapping[str, Maneuver]) -> tuple[Window, ...]:
    """Return windows of `SPAN` on each maneuver, one after the other."""
    return tuple(
        Window(name, start, start + SPAN)
        for name, maneuver in maneuvers.items()
        for start in np.arange(0.0, maneuver.duration - 0.5 * SPAN, SPAN).tolist()
    )


KINDS: Final[Mapping[str, Kind]] = {
    "fixed wing": Kind(fixed_wing, wing_maneuvers, whole, scenes.BIASES, "output-error"),
    "quadrotor": Kind(quadrotor, rotor_maneuvers, pieces, ROTOR_BIASES, "output-error"),
}


# ---------------------------------------------------------------- what instruments do


def late(channels: tuple[str, ...], seconds: float) -> Recorder:
    """Return an instrument that delivers its readings late, by whole samples."""

    def record(flight: Flight) -> Flight:
        samples = float(round(seconds * flight.rate))
        return with_columns(flight, {c: delayed(flight.column(c), samples) for c in channels})

    return record


def turned(roll: float, pitch: float, yaw: float) -> Recorder:
    """Return an inertial unit that is mounted at an angle to the body axes, rad."""
    mounting = matrices_of_angles(np.array([roll, pitch, yaw]))

    def record(flight: Flight) -> Flight:
        out: dict[str, FloatArray] = {}
        for axes in (RATES, SPECIFIC_FORCE):
            body = np.column_stack([flight.column(c) for c in axes])
            out |= dict(zip(axes, (body @ mounting).T, strict=True))
        return with_columns(flight, out)

    return record


def with_columns(flight: Flight, columns: Mapping[str, FloatArray]) -> Flight:
    """Return a flight with other readings."""
    changed = {c: (flight.data[c].dims, x) for c, x in columns.items()}
    return replace(flight, data=flight.data.assign(changed))


# ---------------------------------------------------------------- defects


def _term(coefficient: str, name: str, text: str, value: float, words: str, alike: str = "") -> Defect:
    entry = {f"aerodynamics.{coefficient}.{name}": {"term": text, "value": value}}
    size = f"{value:g}"
    return Defect(name, words, size, "fixed wing", frozenset({name}), frozenset(alike.split()), truth=entry)


def _wing(name: str, words: str, size: str, names: str, **more: Any) -> Defect:
    alike = frozenset(more.pop("alike", "").split())
    return Defect(name, words, size, "fixed wing", frozenset(names.split()), alike, **more)


def _quad(name: str, words: str, size: str, names: str, **more: Any) -> Defect:
    alike = frozenset(more.pop("alike", "").split())
    return Defect(name, words, size, "quadrotor", frozenset(names.split()), alike, **more)


def _all() -> Iterator[Defect]:
    surfaces = ("elevator", "aileron", "rudder")
    scale = parse_vehicle(fixed_wing(), "fixed wing").value("propulsion.scale")
    yield _wing("none", "the right model", "", "")
    yield _wing(
        "lag-all", "a lag of all servos", "40 ms", "controls.lag controls.delay",
        truth={f"controls.{c}.lag": 0.04 for c in surfaces},
    )  # fmt: skip
    yield _wing(
        "lag-aileron", "a lag of the aileron's servo", "40 ms", "controls.aileron.lag controls.aileron.delay",
        truth={"controls.aileron.lag": 0.04},
    )  # fmt: skip
    yield _wing(
        "delay-elevator", "a delay of the elevator", "40 ms", "controls.elevator.delay controls.elevator.lag",
        truth={"controls.elevator.delay": 0.04},
    )  # fmt: skip
    yield _wing(
        "rate-limit", "a rate limit of the aileron", "0.5 rad/s", "controls.aileron.rate_limit",
        alike="controls.aileron.lag controls.aileron.delay", truth={"controls.aileron.rate_limit": 0.5},
    )  # fmt: skip
    yield _wing(
        "dead-zone", "a dead zone of the rudder's servo", "0.04 rad", "controls.rudder.dead_zone",
        truth={"controls.rudder.dead_zone": 0.04},
    )  # fmt: skip
    held = {
        f"aerodynamics.{c}.{c}elevator": {"value": v, "free": False} for c, v in (("CL", 0.201), ("Cm", -0.8))
    }
    yield _wing(
        "gain", "more effect of an elevator whose derivatives are held", "15 %",
        "controls.elevator.mix.servo_2 Cmelevator", alike="CLelevator",
        both={**held, "controls.elevator.mix": {"servo_2": 1.0}}, truth={"controls.elevator.mix": {"servo_2": 1.15}},
    )  # fmt: skip
    yield _wing(
        "thrust",
        "more thrust",
        "20 %",
        "propulsion.scale",
        alike="mass.mass",
        user={"propulsion.scale": _known(scale / 1.2)},
    )
    yield _wing(
        "thrust-line", "a thrust line above the center of gravity", "0.1 m", "propulsion.position.z",
        truth={"propulsion.position": [0.0, 0.0, -0.1]},
    )  # fmt: skip
    yield _wing(
        "product-of-inertia", "a product of inertia Ixz", "15 kg m2", "mass.inertia.xz",
        user={"mass.inertia.xz": None},
    )  # fmt: skip
    yield _wing(
        "inertia", "a wrong moment of inertia Izz", "30 %", "mass.inertia.zz", user={"mass.inertia.zz": 140.0},
        alike="mass.inertia.xx mass.inertia.yy",
    )  # fmt: skip
    for channel, share in (("alpha", 0.08), ("q", 0.08), ("V", 0.05)):
        yield _wing(
            f"scale-{channel}", f"a scale error of {channel}", f"{100 * share:g} %", f"sensors.{channel}.scale",
            truth={f"sensors.{channel}.scale": 1.0 + share},
        )  # fmt: skip
    yield _wing(
        "accelerometer", "an accelerometer ahead of the center of gravity", "0.15 m",
        "sensors.accelerometer_position.x", truth={"sensors.accelerometer_position": [0.15, 0.0, 0.0]},
    )  # fmt: skip
    yield _wing(
        "vanes", "vanes ahead of the center of gravity", "1 m", "sensors.vane_position.x",
        truth={"sensors.vane_position": [1.0, 0.0, 0.0]},
    )  # fmt: skip
    yield _wing(
        "alignment", "an inertial unit turned about the yaw axis", "4 deg", "sensors.imu_alignment.z",
        record=turned(0.0, 0.0, float(ALIGNMENT)),
    )  # fmt: skip
    yield _wing(
        "vane-delay", "late readings of alpha", "60 ms", "sensors.alpha.delay", record=late(("alpha",), 0.06)
    )
    yield _wing(
        "attitude-delay", "a late attitude", "60 ms", "sensors.attitude.delay",
        record=late(("phi", "theta", "psi"), 0.06),
    )  # fmt: skip
    gusty = scenes.turbulent_aircraft()
    gusts = {a: {n: gusty.value(f"turbulence.{a}.{n}") for n in ("intensity", "length")} for a in "uvw"}
    yield _wing(
        "gusts", "moderate turbulence", "MIL-F-8785C", "turbulence",
        truth={"turbulence": gusts},
    )  # fmt: skip
    yield _term("CL", "CLalpha2", "alpha^2", -8.0, "curved lift")
    yield _wing(
        "CDalpha2", "drag that grows with the square of alpha", "3", "CDalpha2",
        truth={"aerodynamics.CD.CDalpha2": 3.0}, user={"aerodynamics.CD.CDalpha2": False},
    )  # fmt: skip
    yield _term("Cm", "Cmalpha2", "alpha^2", -5.0, "a pitching moment that is not linear in alpha")
    yield _term("Cm", "Cmbeta", "beta", 0.05, "a pitching moment by sideslip", "mass.inertia.yz")
    yield _term("Cm", "Cmp", "p", 0.3, "a pitching moment by roll rate")
    yield _term("Cm", "Cmbeta2", "beta^2", -1.0, "a pitching moment by the square of sideslip")
    yield _term("CD", "CDbeta2", "beta^2", 1.5, "drag by sideslip")
    yield _term("Cl", "Clalphabeta", "alpha*beta", -0.6, "a dihedral effect that changes with alpha")
    yield _term("Cn", "Cnalphap", "alpha*p", -1.0, "a yawing moment by roll rate that changes with alpha")
    yield _term("Cm", "Cmalphaq", "alpha*q", -400.0, "a pitch damping that changes with alpha")
    yield _wing(
        "CmV", "a pitching moment that changes with airspeed", "0.15", "CmV",
        truth={"aerodynamics.Cm.CmV": 0.15}, user={"aerodynamics.Cm.CmV": False},
    )  # fmt: skip
    yield _quad("quad-none", "the right model", "", "")
    yield _quad(
        "motor-lag", "a lag of the motors", "50 ms", "rotors.lag rotors.delay", user={"rotors.lag": 0.0}
    )
    yield _quad(
        "motor-delay",
        "a delay of the motors",
        "20 ms",
        "rotors.delay rotors.lag",
        truth={"rotors.delay": 0.02},
    )
    yield _quad("mass", "a wrong mass", "20 %", "mass.mass", user={"mass.mass": 1.2})
    yield _quad(
        "roll-inertia",
        "a wrong moment of inertia",
        "30 %",
        "mass.inertia.xx",
        user={"mass.inertia.xx": 0.0378},
    )
    yield _quad(
        "rotor-drag",
        "drag of the rotors",
        "0.08",
        "rotors.drag",
        user={"rotors.drag": None},
        alike="body_drag.linear.x body_drag.linear.y",
    )
    yield _quad(
        "inflow",
        "inflow of the rotors",
        "0.25",
        "rotors.inflow",
        user={"rotors.inflow": None},
        alike="body_drag.linear.z",
    )
    yield _quad(
        "torque", "a wrong torque of the rotors, held", "30 %", "rotors.torque_ratio", alike="mass.inertia.zz",
        user={"rotors.torque_ratio": {"value": 0.0208, "free": False}},
    )  # fmt: skip
    yield _quad(
        "body-drag", "drag of the body", "0.08 N s2/m2", "body_drag.quadratic.x body_drag.quadratic.y",
        truth={"body_drag.quadratic": [0.08, 0.08, 0.03]}, user={"body_drag": None},
    )  # fmt: skip
    yield _quad(
        "translational", "lift in translation", "0.03 N s2/m2", "rotors.translational",
        truth={"rotors.translational": 0.03},
    )  # fmt: skip
    yield _quad(
        "weak-rotor",
        "a weak rotor",
        "5 %",
        "rotor.m1.factor",
        truth={"rotor.m1.factor": 0.95},
        both={"rotor.m1.factor": 1.0},
    )
    yield _quad(
        "quad-accelerometer", "an accelerometer off the center of gravity", "0.1 m",
        "sensors.accelerometer_position.x", truth={"sensors.accelerometer_position": [0.1, 0.0, 0.0]},
    )  # fmt: skip
    yield _quad(
        "velocity-delay", "a late velocity", "80 ms", "sensors.velocity.delay",
        record=late(("vn", "ve", "vd"), 0.08),
    )  # fmt: skip


@functools.cache
def defects() -> Mapping[str, Defect]:
    """Return the defects by name; none and quad-none are the right models."""
    return {defect.name: defect for defect in _all()}


@functools.cache
def truth(name: str) -> Vehicle:
    """Return the vehicle that flies."""
    defect = defects()[name]
    return parse_vehicle(edited(KINDS[defect.kind].base(), defect.both, defect.truth), f"{name} (truth)")


@functools.cache
def user_file(name: str) -> Vehicle:
    """Return the vehicle as the user's file has it, its numbers right but for the defect."""
    defect = defects()[name]
    return parse_vehicle(edited(KINDS[defect.kind].base(), defect.both, defect.user), name)


def fly(name: str, seed: int, held_back: str = "") -> Scene:
    """Return the flights of a defect and the vehicle file that its user starts from; with one to hold back, whole."""
    defect = defects()[name]
    kind, rng = KINDS[defect.kind], np.random.default_rng(seed)
    maneuvers = kind.maneuvers(rng)
    flights = {title: _flown(name, rng, title, maneuver) for title, maneuver in maneuvers.items()}
    scene = posed(name, rng, flights, kind.windows(maneuvers))
    if not held_back or held_back in flights:
        return scene
    further = {held_back: next(iter(kind.maneuvers(rng).values()))}
    flights |= {held_back: _flown(name, rng, held_back, further[held_back])}
    return replace(scene, flights=flights, windows=(*scene.windows, *whole(further)))


def _flown(name: str, rng: np.random.Generator, title: str, maneuver: Maneuver) -> Flight:
    """Return what the instruments record of a maneuver."""
    defect = defects()[name]
    flown = biased(truth(name), KINDS[defect.kind].biases, rng)
    flight = simulate_flight(flown, maneuver, int(rng.integers(2**31)), noise=False, name=title)
    flight = flight if defect.record is None else defect.record(flight)
    sigma = scenes.sensor_noise(flown)
    noise = sigma * rng.standard_normal((len(maneuver.time), len(sigma)))
    read = {c: flight.column(c) + e for c, e in zip(flown.outputs, noise.T, strict=True)}
    return with_columns(flight, read)


def posed(
    name: str, rng: np.random.Generator, flights: Mapping[str, Flight], windows: tuple[Window, ...]
) -> Scene:
    """Return what is identified: the user's file with wrong starting values, and the truth of what it estimates."""
    user, right = user_file(name), truth(name)
    known = scenes.coefficients(user)
    start = scenes.wrong_start(user, rng) if not user.rotors else wrong_rotors(user, rng)
    return Scene(start, flights, windows, {n: right.value(n, user.value(n)) for n in known})


def wrong_rotors(vehicle: Vehicle, rng: np.random.Generator) -> Vehicle:
    """Return a vehicle with rotors to start from."""
    wrong = {
        n: {"value": v * rng.uniform(1.0 - scenes.START_ERROR, 1.0 + scenes.START_ERROR)}
        for n, v in scenes.coefficients(vehicle).items()
    }
    return vehicle.with_numbers(wrong)


def biased(vehicle: Vehicle, biases: Mapping[str, float], rng: np.random.Generator) -> Vehicle:
    """Return a vehicle whose sensors have biases that are drawn from their prior."""
    return vehicle.with_numbers(
        {f"sensors.{c}.bias": {"value": s * rng.standard_normal()} for c, s in biases.items()}
    )

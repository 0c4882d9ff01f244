"""Simulated flights of vehicles whose file lacks one thing, or nothing: a fixed wing and a quadrotor.

Each `Defect` says what the truth has, or how its instruments deceive, and what the user's vehicle file says instead. A seed
draws maneuvers that excite all axes, sensor biases, white noise, and starting values that are wrong.
"""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Callable, Iterable, Mapping
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
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.delays import delayed
from stoop_studies.verify import scenes
from stoop_studies.verify.scenes import Scene
from stoop_studies.verify.study import data_text

Entries = Mapping[str, Any]  #: place in a vehicle file -> what stands there; None removes it
Recorder = Callable[[Flight], Flight]


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


#: control, shape, start (s), step (s, from and to), amplitude (rad, from and to); each begins up to half a second later
WING_INPUTS: Final = (
    ("elevator", "3-2-1-1", 0.5, (0.25, 0.35), (0.10, 0.16)), ("aileron", "2-1-1", 1.5, (0.3, 0.6), (0.10, 0.20)),
    ("rudder", "doublet", 3.0, (0.4, 0.8), (0.10, 0.18)), ("elevator", "doublet", 4.5, (0.5, 1.0), (0.08, 0.14)),
    ("aileron", "doublet", 5.5, (0.4, 0.7), (0.10, 0.20)), ("rudder", "2-1-1", 6.5, (0.3, 0.5), (0.06, 0.12)),
)  # fmt: skip
Drawn = tuple[str, str, float, tuple[float, float], tuple[float, float]]


def drawn(rng: np.random.Generator, inputs: tuple[Drawn, ...], later: float) -> list[dict[str, Any]]:
    """Draw start, step, size and sign of inputs."""
    return [
        {
            "control": control, "shape": shape, "start": start + rng.uniform(0.0, later), "step": rng.uniform(*step),
            "amplitude": rng.uniform(*size) * rng.choice((-1.0, 1.0)),
        }
        for control, shape, start, step, size in inputs
    ]  # fmt: skip


def wing_maneuvers(rng: np.random.Generator) -> Mapping[str, Maneuver]:
    """Draw maneuvers that move all controls, one after the other and together."""

    def one() -> Maneuver:
        inputs = drawn(rng, WING_INPUTS, 0.5)
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


ROTOR_RATE: Final = 100.0  #: Hz
ROTOR_DURATION: Final = 6.0  #: s
SPAN: Final = 1.0  #: s, of a window
ROTOR_BIASES: Final = {"p": 0.01, "q": 0.01, "r": 0.01, "ax": 0.05, "ay": 0.05, "az": 0.05}


@functools.cache
def quadrotor() -> str:
    """Return the file of the built-in quadrotor, with a delay of its motors."""
    return load_vehicle("quad-x").text


#: as `WING_INPUTS`, the amplitude in rad/s2 and m/s2
ROTOR_INPUTS: Final = (
    ("roll", "3-2-1-1", 0.3, (0.1, 0.2), (10.0, 18.0)), ("pitch", "3-2-1-1", 1.3, (0.1, 0.2), (10.0, 18.0)),
    ("yaw", "3-2-1-1", 2.0, (0.1, 0.2), (1.0, 2.0)), ("heave", "3-2-1-1", 3.0, (0.1, 0.2), (2.0, 4.0)),
    ("roll", "3-2-1-1", 4.2, (0.1, 0.2), (8.0, 15.0)), ("pitch", "3-2-1-1", 4.3, (0.1, 0.2), (8.0, 15.0)),
    ("yaw", "3-2-1-1", 4.4, (0.2, 0.3), (1.0, 2.0)),
)  # fmt: skip


def rotor_maneuvers(rng: np.random.Generator) -> Mapping[str, Maneuver]:
    """Draw flights in which the autopilot's commands are shaken on all axes and the velocity is changed."""

    def one() -> Maneuver:
        inputs = drawn(rng, ROTOR_INPUTS, 0.3)
        velocity = tuple(rng.uniform(-6.0, 6.0, 3) * (1.0, 1.0, 0.4))
        return Maneuver.model_validate(
            {"duration": ROTOR_DURATION, "rate": ROTOR_RATE, "altitude": scenes.ALTITUDE, "velocity": velocity,
             "input": inputs}
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


def late(channels: Iterable[str], seconds: float) -> Recorder:
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


def _defect(name: str, row: dict[str, Any]) -> Defect:
    """Return a defect of ``vehicles/defects.toml``."""
    names, alike = (frozenset(row.pop(key, ())) for key in ("names", "alike"))
    user = {**row.pop("user", {}), **dict.fromkeys(row.pop("lacks", ()))}
    record = (
        late(**row.pop("late")) if "late" in row else turned(*row.pop("turned")) if "turned" in row else None
    )
    return Defect(name=name, names=names, alike=alike, user=user, record=record, **row)


@functools.cache
def defects() -> Mapping[str, Defect]:
    """Return the defects by name; none and quad-none are the right models."""
    table = tomllib.loads(data_text("defects.toml"))
    return {name: _defect(name, row) for name, row in table.items()}


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

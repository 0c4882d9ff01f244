"""The vehicles of `stoop verify decisions`: short flights of known truth, each case calling for a decision, and real flights.

Every seed draws another vehicle: its coefficients, the maneuvers, the noise and the values that a fit begins with. Two flights
are fitted and a third one is predicted.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import KNOT
from stoop.flight import Flight, load_flight
from stoop.flight.faults import recorded_faults
from stoop.flight.gridding import Channels
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, parse_vehicle
from stoop_studies.problems import hexacopter
from stoop_studies.verify import closed_loop, defects, scenes
from stoop_studies.verify.study import vehicle_text

FITTED: Final = ("first", "second")
AHEAD: Final = "third"  #: held back
DURATION: Final = 8.0  #: s, of a flight of the aircraft
RATE: Final = 50.0  #: Hz, likewise
SPREAD: Final = 0.2  #: coefficients of a vehicle differ by up to this share from the built-in one's, and starts from these
WIND: Final = 30.0 * KNOT
FREE: Final = (
    "CLalpha", "Cmalpha", "Cmq", "Cmelevator", "CQbeta", "Clbeta", "Clp", "Claileron", "Cnbeta", "Cnr", "Cnrudder",
)  # fmt: skip
LATE: Final = 0.06  #: s
#: what instruments make of a flight, with random numbers
Recorder = Callable[[Flight, np.random.Generator], Flight]


@dataclass(frozen=True, eq=False)
class Posed:
    """A fit and the truth of its numbers (none is known of a real flight); the window `ahead` is not fitted."""

    start: Vehicle
    flights: Mapping[str, Flight]
    windows: tuple[Window, ...]
    ahead: Window
    truth: Mapping[str, float]


@dataclass(frozen=True)
class Case:
    """How a simulated vehicle, its file or its instruments differ from those of a right model in calm air."""

    rotors: bool = False
    #: entries of the truth alone, and of the user's file alone
    truth: Mapping[str, Any] = field(default_factory=dict)
    user: Mapping[str, Any] = field(default_factory=dict)
    #: of the flights that are fitted, and of all
    fitted: Recorder | None = None
    every: Recorder | None = None
    #: m/s at 20 ft
    wind: float = 0.0
    #: model of fewer degrees of freedom that is fitted
    reduced: str = ""
    #: numbers that are free too
    more: tuple[str, ...] = ()
    #: with which numbers a fit begins, where these are not drawn about the truth
    begin: Mapping[str, float] = field(default_factory=dict)
    #: channels that are not compared in the prediction
    ignored: tuple[str, ...] = ()
    #: whether an autopilot flies an unstable aircraft
    unstable: bool = False
    #: decisions that are off by default and tried here
    tried: tuple[str, ...] = ()


def outputs(flight: Flight) -> tuple[str, ...]:
    """Return the readings of a flight that have noise."""
    return tuple(c for c in ("V", "alpha", "beta", "vn", "ve", "vd", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")
                 if c in flight.data)  # fmt: skip


def spiked(share: float, size: float) -> Recorder:
    """Return instruments of which a share of the readings is off by so many standard deviations of a reading's change."""

    def record(flight: Flight, rng: np.random.Generator) -> Flight:
        columns = {}
        for channel in outputs(flight):
            y = flight.column(channel)
            wide = size * float(np.median(np.abs(np.diff(y)))) * rng.choice([-1.0, 1.0], len(y))
            columns[channel] = y + np.where(rng.random(len(y)) < share, wide, 0.0)
        return defects.with_columns(flight, columns)

    return record


def noisier(flight: Flight, rng: np.random.Generator) -> Flight:
    """Return the second flight with four times its noise."""
    if flight.name != FITTED[1]:
        return flight
    noise = {
        c: 3.0 * float(np.median(np.abs(np.diff(flight.column(c)))))
        for c in ("p", "q", "r", "ax", "ay", "az")
    }
    return defects.with_columns(
        flight, {c: flight.column(c) + s * rng.standard_normal(len(flight.time)) for c, s in noise.items()}
    )


def clipped(flight: Flight, rng: np.random.Generator) -> Flight:
    """Return a flight whose gyros end at 40 % of their largest readings, as a log's faults say."""
    rates = {c: flight.column(c) for c in ("p", "q", "r")}
    ends = {c: 0.4 * float(np.abs(x).max()) for c, x in rates.items()}
    return faulty(flight, {c: np.clip(x, -ends[c], ends[c]) for c, x in rates.items()})


def frozen(flight: Flight, rng: np.random.Generator) -> Flight:
    """Return a flight whose air data stop for two seconds, as those of a blocked pitot tube or a bus that waits."""
    at, columns = (flight.time >= 2.0) & (flight.time < 5.0), {}
    for channel in ("V", "alpha"):
        y = flight.column(channel).copy()
        y[at] = y[at][0]
        columns[channel] = y
    return faulty(flight, columns)


def faulty(flight: Flight, columns: Mapping[str, FloatArray]) -> Flight:
    """Return a flight with other readings and with the faults that a reader of logs finds in them."""
    found = recorded_faults([Channels(flight.name, flight.time, columns)])
    return replace(defects.with_columns(flight, columns), faults=tuple(found))


def scaled(channel: str, factor: float) -> Recorder:
    """Return an instrument that is wrong by a factor."""
    return lambda flight, rng: defects.with_columns(flight, {channel: factor * flight.column(channel)})


def late(*channels: str) -> Recorder:
    """Return instruments that deliver readings `LATE` seconds late."""
    own = defects.late(channels, LATE)
    return lambda flight, rng: own(flight)


def stuck(channel: str) -> Recorder:
    """Return an instrument that always reads the same."""
    return lambda flight, rng: defects.with_columns(flight, {channel: np.full_like(flight.time, 0.05)})


_INERTIA: Final = ("mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz")
_LAGS: Final = {f"controls.{s}.lag": 0.04 for s in ("elevator", "aileron", "rudder")}
CASES: Final[Mapping[str, Case]] = {
    "aircraft-calm": Case(),
    "aircraft-gusts": Case(wind=WIND),
    "aircraft-outliers": Case(fitted=spiked(0.02, 10.0)),
    "aircraft-spikes": Case(fitted=spiked(0.003, 80.0)),
    "aircraft-unequal": Case(fitted=noisier),
    "aircraft-late": Case(every=late("alpha", "beta")),
    "aircraft-clipped": Case(fitted=clipped),
    "aircraft-frozen": Case(fitted=frozen),
    "aircraft-stuck": Case(fitted=stuck("theta"), ignored=("theta",)),
    "aircraft-pitot": Case(every=scaled("V", 1.08)),
    "aircraft-unstable": Case(truth={"aerodynamics.Cm.Cmalpha": 1.5}, unstable=True),
    "aircraft-reduced": Case(reduced="longitudinal"),
    "aircraft-bounds": Case(truth={"aerodynamics.Cm.Cmq": -190.0}, begin={"Cmq": -50.0}),
    "aircraft-wrong-inertia": Case(user={"mass.inertia.zz": 140.0}),
    "aircraft-wrong-lag": Case(truth=_LAGS, tried=("extensions",)),
    "aircraft-lacks-term": Case(user={"aerodynamics.CD.CDalpha2": 0.0}, tried=("extensions",)),
    "quadrotor-calm": Case(rotors=True),
    "quadrotor-gusts": Case(rotors=True, wind=WIND),
    "quadrotor-outliers": Case(rotors=True, fitted=spiked(0.02, 10.0)),
    "quadrotor-late": Case(rotors=True, every=late("vn", "ve", "vd")),
    "quadrotor-unequal": Case(rotors=True, fitted=noisier),
    "quadrotor-bounds": Case(rotors=True, more=_INERTIA, begin=dict.fromkeys(_INERTIA[:2], 0.015)),
    "quadrotor-no-lag": Case(rotors=True, user={"rotors.lag": None}),
    "quadrotor-free-mass": Case(rotors=True, more=("mass.mass", *_INERTIA), begin={"mass.mass": 1.5}),
    "quadrotor-wrong-mass": Case(rotors=True, user={"mass.mass": 1.2}),
}


def pose(name: str, seed: int) -> Posed:
    """Draw the vehicle of a case, fly it, and return its fit."""
    case, rng = CASES[name], np.random.default_rng([zlib.crc32(name.encode()), seed])
    draw = _quadrotor if case.rotors else _aircraft
    truth, user, maneuvers = draw(case, rng)
    flights = {}
    for title, maneuver in maneuvers.items():
        flight = _flown(case, truth, title, maneuver, rng)
        for record in (case.every, case.fitted if title in FITTED else None):
            flight = flight if record is None else record(flight, rng)
        flights[title] = flight
    lost = {c: np.full_like(flights[AHEAD].time, np.nan) for c in case.ignored}
    flights[AHEAD] = defects.with_columns(flights[AHEAD], lost)
    names = [p.name for p in user.parameters if p.free and not p.name.startswith("sensors.")]
    off = {n: rng.uniform(1.0 - SPREAD, 1.0 + SPREAD) for n in names}
    start = {n: {"value": case.begin.get(n, truth.value(n) * off[n])} for n in names}
    windows = {title: Window(title, 0.0, maneuver.duration) for title, maneuver in maneuvers.items()}
    known = {n: truth.value(n) for n in names}
    return Posed(user.with_numbers(start), flights, tuple(windows[t] for t in FITTED), windows[AHEAD], known)


def _flown(case: Case, truth: Vehicle, title: str, maneuver: Maneuver, rng: np.random.Generator) -> Flight:
    if case.unstable:
        return closed_loop.fly(truth, maneuver, rng, title, closed_loop.UNSTABLE["pitch"][1])
    passing = closed_loop.PASSING if case.rotors else None
    blown = scenes.in_turbulence(truth, case.wind, passing) if case.wind else truth
    return simulate_flight(blown, maneuver, seed=int(rng.integers(2**31)), name=title)


def _drawn(vehicle: Vehicle, names: tuple[str, ...], rng: np.random.Generator) -> dict[str, dict[str, float]]:
    return {n: {"value": vehicle.value(n) * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD)} for n in names}


def _aircraft(case: Case, rng: np.random.Generator) -> tuple[Vehicle, Vehicle, dict[str, Maneuver]]:
    """Return truth, user's file, and maneuvers that move all surfaces."""
    base = scenes.aircraft()
    plain = parse_vehicle(defects.edited(base.text, case.truth), "truth")
    moved = {n: {"value": v} for n, v in scenes.TRUTHS.items()} | _drawn(plain, FREE, rng)
    truth = scenes.with_trim_thrust(plain.with_numbers(moved))
    file = parse_vehicle(defects.edited(base.text, case.user), "user")
    changed = {place.rpartition(".")[2] for place in case.user}
    same = {n: {"value": truth.value(n)} for n in scenes.coefficients(truth) if n not in changed}
    known = {"propulsion.thrust": {"value": truth.value("propulsion.thrust")}}
    user = file.with_numbers({**same, **known})
    user = user.reduced(case.reduced) if case.reduced else user
    user = user.with_numbers({p.name: {"free": p.name in FREE} for p in user.parameters if p.free})

    def one() -> Maneuver:
        inputs = defects.drawn(rng, defects.WING_INPUTS[:5], 0.5)
        return Maneuver.model_validate(
            {"duration": DURATION, "rate": RATE, "altitude": scenes.ALTITUDE, "input": inputs}
        )

    return truth, user, {title: one() for title in (*FITTED, AHEAD)}


def _quadrotor(case: Case, rng: np.random.Generator) -> tuple[Vehicle, Vehicle, dict[str, Maneuver]]:
    """Return truth, user's file, and maneuvers on all axes."""
    text = defects.quadrotor()
    plain = parse_vehicle(defects.edited(text, case.truth), "truth")
    free = tuple(scenes.coefficients(plain))
    truth = plain.with_numbers(_drawn(plain, free, rng))
    file = parse_vehicle(defects.edited(text, case.user), "user")
    user = file.with_numbers({n: {"free": True} for n in case.more})
    (one, two), (three, _) = (list(defects.rotor_maneuvers(rng).values()) for _ in range(2))
    return truth, user, dict(zip((*FITTED, AHEAD), (one, two, three), strict=True))


Spans = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Real:
    """Real flights of one vehicle: its file, a mapping, and windows (s) of each flight; one is held back at a time."""

    vehicle: str
    flights: Mapping[str, Spans]
    #: package and file
    mapping: tuple[str, str] | None = None


_OWN: Final = "stoop_studies.verify"
_A430: Final = "a430-micro-fixedwing-mocap"
REAL: Final[Mapping[str, Real]] = {
    "real-v-tail": Real(
        "v_tail", {"altlnt-vtail-8kg-px4/flight2": ((140, 145), (146, 152), (160, 168.3), (187, 196))}
    ),
    "real-hexacopter": Real(
        "hexacopter",
        {hexacopter.FOLDER: ((140, 160), (160, 180), (180, 200), (200, 214), (214, 237), (237, 260))},
        ("stoop_studies.problems", "hexacopter_mapping.toml"),
    ),
    "real-a430": Real(
        "a430",
        {
            f"{_A430}/short_straight_4_20230215_133852.csv": ((3, 5.3), (5.3, 7.6), (7.6, 10)),
            f"{_A430}/short_loop_6_20230227_120302.csv": ((2.7, 4.7), (4.7, 6.8)),
        },
        (_OWN, "vehicles/a430_mapping.toml"),
    ),
    "real-skywalker": Real(
        "skywalker",
        {
            "stanford-skywalker-10hz": (
                (86, 93),
                (93, 100),
                (100, 107),
                (107, 114),
                (114, 121),
                (121.3, 128.7),
            )
        },
        (_OWN, "vehicles/skywalker_mapping.toml"),
    ),
}


def folds(name: str) -> int:
    """Return how many windows of a real vehicle may be held back."""
    return sum(map(len, REAL[name].flights.values()))


@functools.cache
def _read(name: str, data: Path) -> tuple[Flight, ...]:
    real = REAL[name]
    if real.mapping is None:
        return tuple(load_flight(data / place, None, scenes.LOG_GRID) for place in real.flights)
    package, file = real.mapping
    with as_file(files(package).joinpath(file)) as mapping:
        return tuple(load_flight(data / place, mapping, scenes.LOG_GRID) for place in real.flights)


def pose_real(name: str, fold: int, data: Path) -> Posed:
    """Return the fit of a real vehicle's windows but one."""
    real, flights = REAL[name], _read(name, data)
    windows = [
        Window(flight.name, *span)
        for flight, spans in zip(flights, real.flights.values(), strict=True)
        for span in spans
    ]
    ahead = windows.pop(fold)
    vehicle = parse_vehicle(vehicle_text(real.vehicle), f"{real.vehicle}.toml")
    return Posed(vehicle, {flight.name: flight for flight in flights}, tuple(windows), ahead, {})

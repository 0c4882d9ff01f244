"""A real hexacopter: its forces in hover and climbs predict its sprints, beside what its owners found.

The authors' coefficients, residuals and formulas are those of https://github.com/altlnt/id_mod_helice (MIT): blade-element
and momentum theory of axial flight for the thrust, a force in the plane of the disc, drag of the body. Their speeds of
rotation are taken from the pulses alone, at 16.8 V, at once.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.assessment.error_bars import error_bars
from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.units import FACTORS
from stoop.base.variables import EULER, SPECIFIC_FORCE, VELOCITY
from stoop.errors import StoopError
from stoop.estimate.fit import Options
from stoop.flight import Flight, load
from stoop.prediction import predict
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.workflow.identification import Search, search
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify.study import Samples, Verification, published_files, vehicle_text

FOLDER: Final = "altlnt-hexacopter-px4"
MAPPING: Final = ("stoop_studies.problems", "hexacopter_mapping.toml")  #: package and file
Span = tuple[float, float]  #: start and stop, s
LEARNED: Final = (140.0, 214.0)  #: s: hover, two climbs of 6 m/s, slow descents
SPRINTS: Final = (214.0, 260.0)  #: s: forth and back at 10 m/s
WHOLE: Final = (140.0, 281.0)  #: s, all that was in the air
METHOD: Final = "equation-error"
MASS: Final = 1.895  #: kg
RADIUS: Final = 0.11  #: m
AREA: Final = math.pi * RADIUS**2
DENSITY: Final = 1.204  #: kg/m3
FULL: Final = 16.8 * 800.0 * FACTORS["rpm"]  #: rad/s at 1950 us
IDLE, RANGE = 1075.0, 875.0  #: us
ROTORS: Final = 6


TIP: Final = FULL * RADIUS  #: m/s at full pulse
AXES: Final = SPECIFIC_FORCE
COEFFICIENTS: Final = ("quantity", "unit", "value", "std_error", "of_whole_flight", "authors")
SHARE: Final = 0.6  #: of what a constant or static thrust leaves, that the model may leave
CLIMB: Final = 4.0  #: m/s
BLADE_NAMES: Final = ("ct1", "ct2", "ch1", "ch2", "di", "dj", "dk")
RESIDUALS: Final = (
    "fitted", "window", "axis", "model", "constant", "static_thrust", "authors_here", "authors_published",
)  # fmt: skip


@dataclass(frozen=True)
class Blades:
    """The authors' coefficients of one rotor and of the body; what is not theirs is zero."""

    ct1: float
    ct2: float
    ch1: float
    ch2: float
    di: float = 0.0
    dj: float = 0.0
    dk: float = 0.0

    def inflow(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return climb and induced velocity of axial flight, m/s, for a tip speed U and a climb, m/s."""
        half = 0.5 * U * self.ct2
        root = np.sqrt((climb - half) ** 2 + 2.0 * self.ct1 * U**2)
        return np.asarray(climb + 0.5 * (root - climb - half))

    def thrust(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return the thrust of a rotor, N."""
        return np.asarray(DENSITY * AREA * U * (self.ct1 * U - self.ct2 * self.inflow(U, climb)))

    def drag(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return the force in the plane of the disc, N per m/s.

        Their program adds ch2 in one place and takes it off in another; only the latter gives a drag of the size of
        what they, and we, find (0.28 per second at hover).
        """
        return np.asarray(DENSITY * AREA * (self.ch1 * U - self.ch2 * self.inflow(U, climb)))

    def hover_speed(self) -> float:
        """Return the tip speed at which six rotors carry the weight, m/s."""
        from scipy.optimize import brentq

        still = np.zeros(1)
        share = MASS * 9.81 / ROTORS
        return float(brentq(lambda U: float(self.thrust(np.array([U]), still)[0]) - share, 1.0, 300.0))

    def specific_force(self, flight: Flight) -> FloatArray:
        """Return the specific force (n, 3) on the flight's grid, m/s2; NaN in holes."""
        ground, angles = (np.column_stack([flight.column(c) for c in names]) for names in (VELOCITY, EULER))
        u, v, w = to_body(quaternions_of(angles), ground).T
        tips = [(flight.column(f"pwm_{i}") - IDLE) / RANGE * FULL * RADIUS for i in range(1, ROTORS + 1)]
        lift = np.sum([self.thrust(U, -w) for U in tips], axis=0)
        drag = np.sum([self.drag(U, -w) for U in tips], axis=0)
        body = DENSITY * AREA * np.sqrt(u**2 + v**2 + w**2)
        x, y = -(drag + body * self.di) * u, -(drag + body * self.dj) * v
        return np.column_stack([x, y, -lift - body * self.dk * w]) / MASS


@dataclass(frozen=True, eq=False)
class Log:
    """The flight, and the coefficients and residuals that its authors published."""

    flight: Flight
    blades: Blades
    published: Mapping[str, float]


def vehicle(text: tuple[str, str] = ("", "")) -> Vehicle:
    """Return the vehicle file, with a text in it replaced by another."""
    return parse_vehicle(vehicle_text("hexacopter").replace(*text), "hexacopter.toml")


def read_log(folder: Path | None, mapped: bool = True) -> Log:
    """Read the log and the authors' table in a folder, or in its folder ``altlnt-hexacopter-px4``.

    With ``mapped`` the mapping brings the attitude to the clock of the gyros; else the log is read as PX4 logs are.
    """
    log, *_ = published_files(
        "hexacopter",
        folder,
        FOLDER,
        r"log_18_.*_sensor_combined_0\.csv.*",
        "holds no flight of the hexacopter",
        f"name the folder of {FOLDER} by --data DIR",
    )
    package, file = MAPPING
    with as_file(files(package).joinpath(file)) as mapping:
        flight = load(log.parent, mapping if mapped else None)
    path = log.parent / "authors_identified_acc_FFFFF.csv"
    try:
        with path.open(newline="", encoding="utf-8") as table:
            row = next(csv.DictReader(table))
        blades = Blades(**{n: float(row[n]) for n in BLADE_NAMES})
        return Log(flight, blades, {f"a{axis}": float(row[f"score_{axis}"]) for axis in "xyz"})
    except (OSError, StopIteration, KeyError, ValueError, UnicodeDecodeError):
        raise StoopError(
            f"hexacopter: {path}: the authors' table cannot be read; fetch {FOLDER} anew"
        ) from None


def identified(flight: Flight, span: Span, file: Vehicle, predicted: Sequence[Span] = ()) -> Search:
    """Identify the hexacopter by equation error from one window of its log, and keep others for prediction."""
    return search(file, flight, [span], predicted, Options(method=METHOD))


def forces(done: Search) -> tuple[predict.ForceFigures, ...]:
    """Return the residuals of the fitted window, and of the predicted one."""
    vehicle, windows = done.fit.identified_vehicle, done.fit.prepared.windows
    biases = partial(predict.expected_biases, done.fit)
    return predict.force_figures(vehicle, done.flights, windows, done.predicted, biases)


def curves(done: Search, window: Window) -> predict.ForceCurves:
    """Return measured and modelled specific force below 5 Hz."""
    biases = predict.mean_biases(done.fit, window.flight)
    return predict.force_curves(done.fit.identified_vehicle, done.flights, window, biases)


def authors_residuals(log: Log, fitted: predict.ForceCurves, shown: predict.ForceCurves) -> dict[str, float]:
    """Return those of the authors' model; a constant per axis is learned from what was fitted, as ours is."""
    force, dt = log.blades.specific_force(log.flight), 1.0 / log.flight.rate
    errors = []
    for own in (fitted, shown):
        rows = np.nan_to_num(force[np.round((own.time - log.flight.time[0]) / dt).astype(int)])
        cuts = np.flatnonzero(np.diff(own.time) > 1.5 * dt) + 1
        errors.append(
            own.measured - np.concatenate([predict.low_passed(part, dt) for part in np.split(rows, cuts)])
        )
    rms = np.sqrt(np.mean((errors[1] - errors[0].mean(axis=0)) ** 2, axis=0))
    return dict(zip(AXES, rms.tolist(), strict=True))


def show(setting: Setting, samples: Samples) -> Findings:
    """Return residuals, coefficients, and what each part of the model is worth."""
    log = read_log(setting.data)
    ahead = identified(log.flight, LEARNED, vehicle(), [SPRINTS])
    whole = identified(log.flight, WHOLE, vehicle())
    records = []
    for done in (ahead, whole):
        fitted, *_ = done.fit.prepared.windows
        for found in forces(done):
            theirs = authors_residuals(log, curves(done, fitted), curves(done, found.window))
            for axis, own in found.axes.items():
                spans = (f"{window.start:g}:{window.stop:g}" for window in (fitted, found.window))
                numbers = (own.model, own.constant, own.static, theirs[axis], log.published[axis])
                records.append(dict(zip(RESIDUALS, (*spans, axis, *numbers), strict=True)))
    coefficients = coefficient_records(ahead, whole, log.blades)
    lacking = [
        {"left_out": name, **{a: own.model for a, own in forces(done)[1].axes.items()}}
        for name, done in {"nothing": ahead, **without(setting, log)}.items()
    ]
    return Findings.of(
        "A real hexacopter: hover and climbs predict its sprints",
        _claims([r for r in records if r["window"] != "140:214"]),
        [_rounded(r) for r in records],
        {"coefficients": coefficients, "without": [_rounded(r) for r in lacking]},
    )


def _rounded(record: Mapping[str, Any]) -> dict[str, Any]:
    return {k: round(v, 5) if isinstance(v, float) else v for k, v in record.items()}


def without(setting: Setting, log: Log) -> dict[str, Search]:
    """Identify without one part of the model each, and predict the sprints."""
    wind = {f"sensors.{c}.bias": {"free": True, "prior": 3.0} for c in ("vn", "ve")}
    still = {f"sensors.accelerometer_position.{c}": {"value": 0.0, "free": False} for c in "xyz"}
    cases = {
        "the attitude brought to the clock of the gyros": vehicle(),
        "induced velocity (climb alone)": vehicle().with_numbers({"rotors.radius": {"value": 100.0}}),
        "average of the voltage": vehicle(("voltage_average = 30.0", "voltage_average = 0.1")),
        "calm air (the wind is estimated)": vehicle().with_numbers(wind),
        "lever of the accelerometers": vehicle().with_numbers(still),
        "drag with the flow through the disc": vehicle().with_numbers({"rotors.drag_inflow": {"value": 0.0}}),
    }
    flights = dict.fromkeys(cases, log.flight)
    flights[next(iter(cases))] = read_log(setting.data, mapped=False).flight
    return {name: identified(flights[name], LEARNED, file, [SPRINTS]) for name, file in cases.items()}


def _claims(records: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    """Give the claims on the residuals of the sprints and of the whole flight, three axes each."""
    sprints = ("model", "authors_here", "authors_published")
    ours, theirs, published = ({r["axis"]: r[name] for r in records[:3]} for name in sprints)
    whole = {r["axis"]: r["model"] for r in records[3:]}
    for axis in AXES:
        yield holds(
            f"{axis} is predicted as closely as the authors' fit follows it",
            ours[axis] <= published[axis],
            f"{ours[axis]:.3f} against {published[axis]:.3f} m/s2",
        )
    for what, name in (("a constant", "constant"), ("static thrust", "static_thrust")):
        shares = {r["axis"]: r["model"] / r[name] for r in records[:3]}
        yield holds(
            f"The prediction leaves at most {SHARE:g} of what {what} leaves",
            all(s <= SHARE for s in shares.values()),
            ", ".join(f"{a} {s:.2f}" for a, s in shares.items()),
        )
    yield holds(
        "It is closer than the authors' model with their coefficients on the same samples",
        all(ours[a] < theirs[a] for a in AXES),
        _pairs(ours, theirs),
    )
    yield holds(
        "Fitted to the whole flight, as theirs is, the model follows it closer in all axes",
        all(whole[a] <= published[a] for a in AXES),
        _pairs(whole, published),
    )


def _pairs(ours: Mapping[str, float], theirs: Mapping[str, float]) -> str:
    return ", ".join(f"{a} {ours[a]:.3f} against {theirs[a]:.3f}" for a in AXES)


def coefficient_records(ahead: Search, whole: Search, theirs: Blades) -> list[dict[str, Any]]:
    """Return coefficients, and what they come to at hover, beside the authors'."""
    size = SEA_LEVEL_DENSITY * AREA
    scales = {"ct1": ("T2", size * TIP**2), "ct2": ("inflow", size * TIP), "ch1": ("drag", size * TIP)}
    std = dict(
        zip((p.name for p in ahead.fit.problem.layout.parameters), error_bars(ahead.fit).std, strict=False)
    )
    errors = {n: std[f"rotors.{name}"] / scale for n, (name, scale) in scales.items()}
    errors["lag of the motors"] = std["rotors.lag"]
    columns = []
    for own in (done.fit.identified_vehicle for done in (ahead, whole)):
        blades = {n: own.value(f"rotors.{name}") / scale for n, (name, scale) in scales.items()}
        blades["ch2"] = -own.value("rotors.drag_inflow") / size
        columns.append(quantities(Blades(**blades), own.value("rotors.lag")))
    rows = (
        (name, unit, first, errors.get(name, 0.0), columns[1][name, unit], known)
        for ((name, unit), first), known in zip(columns[0].items(), quantities(theirs).values(), strict=True)
    )
    return [
        dict(zip(COEFFICIENTS, (name, unit, *(float(f"{n:.4g}") for n in numbers)), strict=True))
        for name, unit, *numbers in rows
    ]


def quantities(own: Blades, lag: float = 0.0) -> dict[tuple[str, str], float]:
    """Return coefficients by name and unit, and what they come to: at hover, and in a climb of 4 m/s per mass."""
    U, still, climbing = np.array([own.hover_speed()]), np.zeros(1), np.array([CLIMB])
    lost = float(ROTORS * (own.thrust(U, still) - own.thrust(U, climbing))[0])
    return {
        **{(name, "1"): float(getattr(own, name)) for name in BLADE_NAMES},
        ("tip speed at hover", "m/s"): float(U[0]),
        ("drag at hover", "1/s"): float(ROTORS * own.drag(U, still)[0] / MASS),
        ("lift lost in a climb", "m/s2"): (lost + DENSITY * AREA * own.dk * CLIMB**2) / MASS,
        ("lag of the motors", "s"): lag,
    }


EXPERIMENT: Final = Verification("hexacopter", show, parts=("coefficients", "without"))

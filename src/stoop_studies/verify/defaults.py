"""Forty flights of twenty made-up vehicles, from log to model by the defaults: intervals, predictions and verdicts."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.verdict import Limits as VerdictLimits
from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT
from stoop.base.variables import VARIABLES, WRAPPED
from stoop.errors import StoopError
from stoop.flight import Flight, load_flight
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import fit
from stoop_draft.vehicle_draft.draft import draft
from stoop_draft.vehicle_draft.request import Request
from stoop_plan.input_design.windows import find_windows
from stoop_studies.findings import Claim, Findings, Setting, counted, holds
from stoop_studies.verify import instruments, pilots, study, truths
from stoop_studies.verify.defects import edited
from stoop_studies.verify.made_up import GRAVITY, KINDS, MadeUp, made_up
from stoop_studies.verify.scenes import LOG_GRID

FLIGHTS: Final = 2 * len(KINDS)
INERTIA_ERROR: Final = 0.3  #: of the quick start's file, at most
GUESSED_THROW: Final = 0.35  #: rad, of the quick start's file
GRADES: Final = ("trusted", "usable", "do not use")
TITLES: Final = {"new": "stoop vehicle new", "quick": "Quick start's file"}
GUSTS: Final = {"calm": 0.0, "light": 0.015, "moderate": 0.04}  #: intensity of vertical gusts over V*


@dataclass(frozen=True, eq=False)
class Flown:
    """One flight: its log is all that a user has; the rest is the truth.

    Attributes
    ----------
    vehicle : MadeUp
    path : of the log
    simulator : "stoop" or "JSBSim"
    gusts : one of `GUSTS`
    defect : of the instruments
    time : (n,) s, clock of the log
    true : channel -> (n,) SI, at the center of gravity and without noise; commanded deflections among them, rad
    airspeed : mean, m/s, airborne
    """

    vehicle: MadeUp
    path: Path
    simulator: str
    gusts: str
    defect: instruments.Defect
    time: FloatArray
    true: Mapping[str, FloatArray]
    airspeed: float

    @property
    def commands(self) -> dict[str, FloatArray]:
        """Commanded deflections (n,) by surface, rad."""
        return {s: self.true[s] for s in self.vehicle.vehicle.controls if s in self.true}


def gusty(vehicle: Vehicle, share: float) -> Vehicle:
    """Return a vehicle in gusts whose vertical part has an intensity of so much of V*, lengths by MIL-F-8785C at 250 m."""
    if not share:
        return vehicle
    h = pilots.ALTITUDE / FOOT
    ratio = 0.177 + 0.000823 * h
    sigma = share * vehicle.value("reference.airspeed", 8.0)
    along = {"intensity": sigma / ratio**0.4, "length": FOOT * h / ratio**1.2}
    table: dict[str, Any] = {"u": along, "v": along, "w": {"intensity": sigma, "length": pilots.ALTITUDE}}
    if not vehicle.rotors:
        return parse_vehicle(edited(vehicle.text, {"turbulence": table}), vehicle.where)
    return parse_vehicle(edited(vehicle.text, {"turbulence": {**table, "airspeed": 8.0}}), vehicle.where)


def fly(number: int, folder: Path, seed: int = 0, record: str = "", gusts: str = "") -> Flown:
    """Fly one of the flights and write its log into a folder; another form of log, and other gusts, may be named."""
    vehicle = made_up(number // 2)
    vehicle = replace(vehicle, record=record) if record else vehicle
    rng = np.random.default_rng([41, seed, number])
    name = gusts or list(GUSTS)[(number + number // 2) % len(GUSTS)]
    kinds = instruments.DEFECTS if vehicle.winged else instruments.ROTOR_DEFECTS
    defect = kinds[(number + number // len(kinds)) % len(kinds)](rng)
    simulator = ("stoop", "JSBSim")[number % 2] if vehicle.winged else "stoop"
    truth, wind = gusty(vehicle.vehicle, GUSTS[name]), instruments.WIND * rng.standard_normal(2)
    if vehicle.winged:
        planned = pilots.plan(truth, vehicle.throw, rng)
        flown = pilots.FLYING[simulator](truth, planned, vehicle.throw, rng)
        flown = {n: x for n, x in flown.items() if n in VARIABLES}  # without the noise that makes gusts
        flown |= {n: flown[n] + w for n, w in zip(("vn", "ve"), wind, strict=True)}
        flown |= {f"wind_{a}": np.full(len(flown["p"]), w) for a, w in zip("ne", wind, strict=True)}
        rate = pilots.RATE
    else:
        flown, rate = pilots.on_rotors(truth, wind, rng), pilots.ROTOR_RATE
    whole = instruments.on_the_ground(vehicle, flown, wind, rate, rng)
    read = instruments.measured(vehicle, whole, rate, defect, rng)
    start = float(np.round(rng.uniform(5.0, 300.0), 2))
    path = instruments.write_log(vehicle, read, rate, start, folder, f"flight{number:02d}")
    clock = start + np.arange(len(whole["p"])) / rate
    airspeed = float(np.mean(flown["V"])) if vehicle.winged else 0.0
    return Flown(vehicle, path, simulator, name, defect, clock, whole, airspeed)


# ---------------------------------------------------------------- files of users


def known_file(flown: Flown) -> Vehicle:
    """Return the file of a user who knows all: the truth, with starting values right and lags unknown.

    What it gives says whether a flight is well posed at all.
    """
    made = flown.vehicle
    changes: dict[str, Any] = {}
    lag = {"free": True, "prior": 0.03, "bounds": [0.005, 0.2]}
    for surface in made.vehicle.controls:
        changes[f"controls.{surface}.lag"] = {"value": made.vehicle.value(f"controls.{surface}.lag"), **lag}
        if made.record != "csv":
            gain = instruments.SIGNS[surface] * made.throw[surface]
            changes[f"controls.{surface}.mix"] = {instruments.COMMANDS[surface]: gain}
    if made.vehicle.rotors:
        changes["rotors.lag"] = {"value": made.vehicle.value("rotors.lag"), **lag}
        if made.record == "ardupilot":
            changes |= {"rotors.gain": 1e-3, "rotors.idle": 1000.0}
            changes |= {f"rotor.{n}.channel": f"pwm_{i + 1}" for i, n in enumerate(made.vehicle.file.rotor)}
    return parse_vehicle(edited(made.vehicle.text, changes), f"known {made.number}")


def quick_file(flown: Flown) -> Vehicle:
    """Return a file written by hand as `docs/quickstart.md` shows: mass, guessed inertia, dimensions, airspeed, controls.

    The moments of inertia are off by up to 30 %; of a multirotor the thrust is guessed to carry it at half command.
    """
    made, tape = flown.vehicle, flown.vehicle.tape
    rng = np.random.default_rng([43, made.number])
    truth = made.vehicle
    wrong = {
        a: truth.value(f"mass.inertia.{a}") * (1.0 + INERTIA_ERROR * rng.uniform(-1.0, 1.0))
        for a in ("xx", "yy", "zz")
    }
    wrong["zz"] = float(np.clip(wrong["zz"], abs(wrong["xx"] - wrong["yy"]), wrong["xx"] + wrong["yy"]))
    entries: dict[str, Any] = {"mass.mass": tape["mass"], "mass.inertia": wrong}
    if truth.rotors:
        known = known_file(flown).text
        thrust = float(tape["mass"] * GRAVITY / len(truth.rotors) / 0.25)
        guesses: dict[str, Any] = {
            "rotors.T1": 0.0,
            "rotors.T2": thrust,
            "rotors.torque_ratio": 0.02,
            "rotors.lag": 0.05,
        }
        guesses |= {"rotors.inflow": 0.0, "rotors.drag": 0.0, "body_drag": None}
        return parse_vehicle(edited(known, entries, guesses), f"quick start {made.number}")
    text = 'format = "stoop-vehicle/1"\nname = "My aircraft"\n[mass]\n[reference]\n[environment]\ndensity = "log"\n'
    airspeed = float(f"{flown.airspeed:.2g}")
    entries["reference"] = {
        "area": tape["span"] * tape["chord"], "chord": tape["chord"], "span": tape["span"], "airspeed": airspeed,
    }  # fmt: skip
    engine, coefficients = (
        truth.file.propulsion is not None,
        {"CT0": (0.12, 0.05, 0.0, 0.4), "CT1": (-0.08, 0.05, -0.4, 0.1)},
    )
    if engine:
        free = {
            n: {"value": v, "prior": s, "free": True, "bounds": [low, high]}
            for n, (v, s, low, high) in coefficients.items()
        }
        gain = truth.value("propulsion.speed_gain") * rng.uniform(0.9, 1.1)
        entries["propulsion"] = {
            "kind": "propeller", "channel": "control_throttle", "speed_gain": gain,
            "diameter": truth.value("propulsion.diameter"), **free,
        }  # fmt: skip
    for surface in truth.controls:
        mix = {"mix": {instruments.COMMANDS[surface]: GUESSED_THROW * instruments.SIGNS[surface]}}
        entries[f"controls.{surface}"] = {} if made.record == "csv" else mix
    return parse_vehicle(edited(text, entries), f"quick start {made.number}")


def drafted_file(flown: Flown) -> Vehicle:
    """Return what `stoop vehicle new` writes of the log, mass, span, chord and template."""
    made, tape = flown.vehicle, flown.vehicle.tape
    request = Request(made.template, tape["mass"], tape["span"], tape.get("chord"))
    return draft(request, (load_flight(flown.path, rate=LOG_GRID),), f"new {made.number}").vehicle


FILES: Final[Mapping[str, Callable[[Flown], Vehicle]]] = {"new": drafted_file, "quick": quick_file}


# ---------------------------------------------------------------- the chain


def identified(flight: Flight, vehicle: Vehicle, folder: Path) -> FittedModel:
    """Do what the printed commands do: windows by `stoop maneuvers`, then `stoop identify` and its report."""
    found = find_windows({flight.name: flight.without_faults()}, vehicle)
    job = fit(vehicle, [flight], found.texts("fit"), found.texts("validate"))
    job.save(folder, overwrite=True)
    return job


def flight_of(seed: int) -> int:
    """Return the number of a seed's flight: twenty seeds fly every vehicle once, by turns in either simulator."""
    run, vehicles = seed % FLIGHTS, len(KINDS)
    return 2 * (run % vehicles) + (run // vehicles + run) % 2


@study.work
def examine(case: str, seed: int) -> dict[str, Any]:
    """Fly the flight of a seed and identify it from a file of a kind; what stops the chain is recorded."""
    with tempfile.TemporaryDirectory(prefix="stoop-defaults-") as name:
        flown = fly(flight_of(seed), Path(name), seed // FLIGHTS)
        about = {
            "template": flown.vehicle.template, "record": flown.vehicle.record, "simulator": flown.simulator,
            "gusts": flown.gusts, "defect": flown.defect.words, "flight": flight_of(seed),
        }  # fmt: skip
        began = time.perf_counter()
        try:
            vehicle = FILES[case](flown)
            job = identified(load_flight(flown.path, rate=LOG_GRID), vehicle, Path(name) / "result")
        except StoopError as error:
            return {**about, "stopped": str(error), "seconds": time.perf_counter() - began}
        seconds = time.perf_counter() - began
        return {**about, "stopped": "", "seconds": seconds, **compared(flown, job)}


def moving(flown: Flown, flight: Flight, channel: str, span: tuple[float, float]) -> bool:
    """Whether a channel truly moved within a span (s): more than the slow error of what was recorded of it."""
    if channel not in flown.true or channel not in flight.names:
        return False
    used = (flight.time >= span[0]) & (flight.time <= span[1])
    true = np.interp(flight.time[used], flown.time, flown.true[channel])
    error = flight.column(channel)[used] - true
    if channel in WRAPPED:
        error = (error + np.pi) % (2.0 * np.pi) - np.pi
    width = max(round(LIMITS.slow * flight.rate), 1)
    slow = np.convolve(error[np.isfinite(error)], np.full(width, 1.0 / width), "valid")
    return bool(slow.size and np.std(true) > LIMITS.moved * np.std(slow))


def compared(flown: Flown, job: FittedModel) -> dict[str, Any]:
    """Return estimates beside the truth, predictions beside the lag, and the verdict beside both."""
    truth, result, file = flown.vehicle.vehicle, job.result, job.vehicle
    span = (flown.time[0] + instruments.GROUND + 2.0, float(flown.time[-1]))
    moved = truths.deflections(file, job.flights[0], flown.time, flown.commands, span)
    scale = flown.vehicle.tape["chord"] if flown.vehicle.winged else 0.5 * flown.vehicle.tape["span"]
    known = truths.free_truths(
        truth, file, moved, flown.airspeed, flown.defect, scale * np.array(flown.defect.arm)
    )
    if "sensors.V.scale" in known:  # of what is left: a log is loaded with its pitot calibrated
        known["sensors.V.scale"] = airspeed_scale(flown, job.flights[0], span)
    numbers = {
        n: (one.estimate, one.std_error, known[n], one.at_bound, one.identifiable)
        for n, one in result.parameters.items()
        if n in known
    }
    values = {n: one.estimate for n, one in result.parameters.items()}
    covariance = result.covariance
    ratios = truths.relative_to_inertia([*values], values, covariance.matrix, covariance.names, file)
    own = truths.aerodynamic(truth, file, moved, flown.airspeed, False) if flown.vehicle.winged else {}
    per_inertia = {
        n: (value, sigma, own[n] / truths.inertia_of(truth, file, n), numbers[n][3], 1.0)
        for n, (value, sigma) in ratios.items()
        if n in own and n in numbers
    }
    predictions = [
        (c, one.theil, one.baseline_theil, one.theil < one.baseline_theil)
        for m in result.maneuvers
        if m.role == "validation"
        for c, one in m.channels.items()
        if np.isfinite(one.baseline_theil) and not one.innovations.known
        if moving(flown, job.flights[0], c, (m.start, m.stop))
    ]
    return {
        "numbers": {n: [float(x) for x in row] for n, row in numbers.items()},
        "per_inertia": {n: [float(x) for x in row] for n, row in per_inertia.items()},
        "predictions": [[c, float(a), float(b), bool(won)] for c, a, b, won in predictions],
        "method": result.method, "grade": result.verdict.grade, "uses": list(result.verdict.justified),
        "needs": {use.name: [list(need.parameters) for need in use.needs] for use in result.verdict.uses},
        "against": [one.code for one in result.verdict.against],
        "windows": [m.window for m in result.maneuvers], "gains": {n: m.gain for n, m in moved.items()},
    }  # fmt: skip


def airspeed_scale(flown: Flown, flight: Flight, span: tuple[float, float]) -> float:
    """Return by how much the airspeed of a flight is larger than the true one."""
    used = (flight.time >= span[0]) & (flight.time <= span[1])
    return float(
        np.nanmedian(flight.column("V")[used] / np.interp(flight.time[used], flown.time, flown.true["V"]))
    )


# ---------------------------------------------------------------- what is right


@dataclass(frozen=True)
class Limits:
    """What is asked of the defaults (the figures of the page), and what makes a verdict right."""

    coverage: tuple[float, float] = (0.90, 0.98)
    rms: float = 1.2
    far: float = 5.0  #: standard errors that no number is off
    verdicts: float = 0.95  #: share that is right
    seconds: float = 60.0
    #: of a channel: its motion over the slow error of its record, from which it counts as moved
    moved: float = 3.0
    slow: float = 0.5  #: s, over which that error is averaged
    #: a number that a use needs is wrong from so many standard errors and from this share of its size
    wrong_errors: float = 3.0
    wrong_share: float = VerdictLimits.error


LIMITS: Final = Limits()


def wrong_uses(record: Mapping[str, Any]) -> list[str]:
    """Return the uses that a number speaks against: of each need the largest true one, wrong by `LIMITS`."""
    out = []
    for use, needs in record["needs"].items():
        for names in needs:
            known = [n for n in names if n in record["numbers"]]
            largest = max(known, key=lambda n: abs(record["numbers"][n][2]), default="")
            if largest and _wrong(record["numbers"][largest]):
                out.append(use)
                break
    return out


def _wrong(number: Sequence[float]) -> bool:
    value, sigma, truth, *_ = number
    return abs(value - truth) > max(LIMITS.wrong_errors * sigma, LIMITS.wrong_share * abs(truth))


def spoiled(record: Mapping[str, Any]) -> bool:
    """Whether anything is wrong: a needed number, one that is far off, a held-back window that a lag predicts as well.

    So is a result of which no use knows what it needs within the verdict's own limit of 20 %.
    """
    rows = record["numbers"].values()
    far = any(abs(v - t) > LIMITS.far * s for v, s, t, bound, known in rows if known and not bound)
    lost = sum(not won for *_, won in record["predictions"]) > 0.25 * len(record["predictions"])
    return far or lost or bool(wrong_uses(record)) or not any(_known(record, use) for use in record["needs"])


def _known(record: Mapping[str, Any], use: str) -> bool:
    """Whether the largest number of every need of a use is known within the verdict's limit."""
    for names in record["needs"][use]:
        known = [n for n in names if n in record["numbers"]]
        if not known:
            continue
        value, sigma, _, bound, identifiable = max(
            (record["numbers"][n] for n in known), key=lambda r: abs(r[2])
        )
        if bound or not identifiable or not sigma <= LIMITS.wrong_share * abs(value):
            return False
    return True


def right(record: Mapping[str, Any]) -> bool:
    """Whether a verdict is right: trusted or usable for uses whose numbers are right, or refused where something is wrong."""
    if record["grade"] == "do not use":
        return spoiled(record)
    return not set(record["uses"]) & set(wrong_uses(record)) and not (
        record["grade"] == "trusted" and spoiled(record)
    )


# ---------------------------------------------------------------- the page


def scores(records: Iterable[Mapping[str, Any]], key: str) -> tuple[FloatArray, int]:
    """Return errors in standard errors (n,) of numbers with an interval, and how many lie on a bound."""
    rows = [row for r in records for row in r[key].values() if row[4]]
    inner = np.array([(v - t) / s for v, s, t, bound, _ in rows if not bound and s > 0.0], dtype=np.float64)
    return inner, len(rows) - len(inner)


def summary(case: str, records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of a kind of file."""
    done = [r for r in records if not r["stopped"]]
    out: dict[str, Any] = {"case": case, "flights": len(records), "stopped": len(records) - len(done)}
    for key, head in (("numbers", ""), ("per_inertia", "inertia_")):
        z, bound = scores(done, key)
        out |= {
            f"{head}numbers": len(z) + bound, f"{head}at_bound": bound,
            f"{head}coverage": float(np.sum(np.abs(z) <= NORMAL_95) / (len(z) + bound)) if len(z) + bound else None,
            f"{head}rms": float(np.sqrt(np.mean(z**2))) if len(z) else None,
            f"{head}far": int(np.sum(np.abs(z) > LIMITS.far)), f"{head}worst": float(np.max(np.abs(z), initial=0.0)),
        }  # fmt: skip
    curves = [won for r in done for *_, won in r["predictions"]]
    out |= {"curves": len(curves), "won": sum(curves), "right": sum(map(right, done))}
    out |= {grade: sum(r["grade"] == grade for r in done) for grade in GRADES}
    return {
        **out,
        "seconds": float(np.median([r["seconds"] for r in records])),
        "slowest": max(r["seconds"] for r in records),
    }


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how far the defaults carry, by kind of file."""
    table = [summary(case, samples[case]) for case in FILES]
    records = [_flight_row(case, r) for case in FILES for r in samples[case]]
    head = ("estimate", "std_error", "truth", "at_bound", "identifiable")
    numbers = [
        {"case": case, "flight": r["flight"], "number": n, **dict(zip(head, row, strict=True))}
        for case in FILES
        for r in samples[case]
        for n, row in r.get("numbers", {}).items()
    ]
    title, parts = "From log to model by the defaults", {"flights": records, "numbers": numbers}
    return Findings.of(title, _claims(table), table, parts)


def _flight_row(case: str, record: Mapping[str, Any]) -> dict[str, Any]:
    about = {
        k: record[k]
        for k in ("flight", "template", "record", "simulator", "gusts", "defect", "stopped", "seconds")
    }
    blank = dict.fromkeys(("coverage", "rms", "worst", "name", "lost", "grade", "right", "method"))
    if record["stopped"]:
        return {"case": case, **about, **blank}
    z = {n: (v - t) / s for n, (v, s, t, b, k) in record["numbers"].items() if k and not b and s > 0.0}
    worst = max(z, key=lambda n: abs(z[n]), default="")
    size = np.array([*z.values()])
    return {
        "case": case, **about, "coverage": float(np.mean(np.abs(size) <= NORMAL_95)), "rms": float(np.sqrt(np.mean(size**2))),
        "worst": z.get(worst), "name": worst, "lost": sum(not won for *_, won in record["predictions"]),
        "grade": record["grade"], "right": right(record), "method": record["method"],
    }  # fmt: skip


def claims_of_chain(title: str, row: Mapping[str, Any]) -> tuple[list[Claim], list[Claim]]:
    """Return what is claimed of every chain from log to model: that it ends and holds the truth, and of verdict and time."""
    low, high = LIMITS.coverage
    first = [
        holds(
            f"{title}: no flight stops on the way", not row["stopped"], counted(row["stopped"], row["flights"])
        ),
        holds(
            f"{title}: 95 % intervals hold {100 * low:.0f} to {100 * high:.0f} % of the truths",
            low <= (row["coverage"] or 0.0) <= high,
            f"{100 * (row['coverage'] or 0.0):.1f} % of {row['numbers']}, {row['at_bound']} at a bound",
        ),
    ]  # fmt: skip
    done = row["flights"] - row["stopped"]
    last = [
        holds(
            f"{title}: the verdict is right in {100 * LIMITS.verdicts:.0f} %",
            row["right"] >= LIMITS.verdicts * done, counted(row["right"], done),
        ),
        holds(
            f"{title}: at most {LIMITS.seconds:g} s from log to report", row["slowest"] <= LIMITS.seconds,
            f"{row['seconds']:.0f} s in the median, {row['slowest']:.0f} s at most",
        ),
    ]  # fmt: skip
    return first, last


def _claims(table: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    for row in table:
        title = TITLES[row["case"]]
        first, last = claims_of_chain(title, row)
        yield from first
        yield holds(
            f"{title}: root-mean-square error at most {LIMITS.rms:g} standard errors, none above {LIMITS.far:g}",
            row["rms"] is not None and row["rms"] <= LIMITS.rms and not row["far"],
            f"{row['rms'] or 0.0:.2f}; {row['far']} above {LIMITS.far:g}, {row['worst']:.1f} at most",
        )
        yield holds(
            f"{title}: windows held back are predicted better than by a first-order lag, in every channel that moved",
            row["won"] == row["curves"], counted(row["won"], row["curves"]),
        )  # fmt: skip
        yield from last


EXPERIMENT: Final = study.Verification(
    "defaults", show, runs=FLIGHTS, work="examine", cases=tuple(FILES), parts=("flights", "numbers")
)

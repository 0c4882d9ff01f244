"""Windows that `stoop maneuvers` proposes: maneuvers found amid gusts, and expected errors beside those of the fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.error_bars import ErrorBars
from stoop.base.numbers import finite_or_none
from stoop.base.units import KNOT
from stoop.errors import FlightError
from stoop.flight import Flight, from_columns, load_flight
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.strategy.run import fit as fit_by
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop_plan.input_design.quick_fit import FIT_ALONE
from stoop_plan.input_design.windows import FoundWindows, find_windows
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.problems import hexacopter
from stoop_studies.verify import closed_loop, scenes, study
from stoop_studies.verify.study import vehicle_text

COUNTS: Final = (
    "maneuvers", "found", "windows", "beside", "false", "bare_windows", "bare_false", "inside", "estimates",
)  # fmt: skip
Span = tuple[float, float]  #: s
Inputs = tuple[Mapping[str, Any], ...]
LEVELS: Final = {"light": 15.0, "moderate": 30.0, "severe": 45.0}  #: kn, wind at 20 ft
SECONDS: Final = 60.0
SETTLED: Final = 5.0  #: s that are left out: the simulation begins in steady flight, and runs into the gusts
STARTS: Final = (10.0, 27.0, 44.0)  #: s, of the three inputs
SWEEP: Final = 8.0  #: s that a sweep or a multisine lasts
BAND: Final = (0.3, 2.0)  #: Hz
PIECE: Final = 0.1  #: s of one level of a sweep
WHOLE: Final = 0.8  #: share of an input that a proposed window must hold for it to be found
RATIO: Final = 1.5  #: by which expected and achieved errors may differ, in the median


def steps(controls: Sequence[str], own: Sequence[tuple[str, float, float]]) -> Inputs:
    """Return one input (shape, step in s, amplitude) per control."""
    rows = zip(controls, STARTS, own, strict=True)
    return tuple(
        {"control": c, "shape": shape, "start": start, "step": step, "amplitude": amplitude}
        for c, start, (shape, step, amplitude) in rows
    )


def multisines(controls: Sequence[str], amplitudes: Sequence[float]) -> Inputs:
    """Return a multisine per control."""
    rows = zip(controls, STARTS, amplitudes, strict=True)
    more = {"shape": "multisine", "duration": SWEEP, "band": BAND[1]}
    return tuple({"control": c, "start": start, "amplitude": a, **more} for c, start, a in rows)


def sweeps(controls: Sequence[str], amplitudes: Sequence[float]) -> Inputs:
    """Return a linear frequency sweep per control, as short levels."""
    t = np.arange(0.0, SWEEP, PIECE) + 0.5 * PIECE
    phase = 2.0 * np.pi * (BAND[0] * t + 0.5 * (BAND[1] - BAND[0]) / SWEEP * t**2)
    rows = zip(controls, STARTS, amplitudes, strict=True)
    own = {"shape": "levels", "lengths": [PIECE] * len(t)}
    return tuple(
        {**own, "control": c, "start": start, "levels": (a * np.sin(phase)).tolist()} for c, start, a in rows
    )


SURFACES: Final = ("elevator", "aileron", "rudder")
TURNS: Final = ("roll", "pitch", "yaw")
AIRCRAFT: Final[Mapping[str, Inputs]] = {
    "steps": steps(SURFACES, (("3-2-1-1", 0.3, 0.12), ("doublet", 0.5, 0.10), ("doublet", 0.7, 0.15))),
    "multisine": multisines(SURFACES, (0.10, 0.10, 0.15)),
    "sweep": sweeps(SURFACES, (0.08, 0.08, 0.12)),
    "gusts": (),
}  #: rad
QUADROTOR: Final[Mapping[str, Inputs]] = {
    "steps": steps(TURNS, (("3-2-1-1", 0.15, 15.0), ("doublet", 0.2, 15.0), ("3-2-1-1", 0.4, 1.5))),
    "gusts": (),
}  #: rad/s2


@dataclass(frozen=True, eq=False)
class Flown:
    """A simulated flight, the vehicle file to begin with, the truth, and the span of each input, s."""

    flight: Flight
    start: Vehicle
    truth: Mapping[str, float]
    spans: tuple[Span, ...]


def planned(inputs: Inputs, rate: float) -> tuple[Maneuver, tuple[Span, ...]]:
    """Return a maneuver of `SECONDS` and the span of each of its inputs."""
    maneuver = Maneuver.model_validate(
        {"duration": SECONDS, "rate": rate, "altitude": scenes.ALTITUDE, "input": list(inputs)}
    )
    spans = []
    for moves in maneuver.deflections().values():
        moving = maneuver.time[moves != 0.0]
        spans += [(float(moving[0]), float(moving[-1]))] if moving.size else []
    return maneuver, tuple(spans)


def settled(flight: Flight) -> Flight:
    """Return a flight without its first `SETTLED` seconds."""
    kept = flight.time >= SETTLED
    names = [str(n) for n in flight.channels if n not in ("q0", "q1", "q2", "q3")]
    return from_columns(flight.name, flight.time[kept], {n: flight.column(n)[kept] for n in names})


def aircraft(inputs: Inputs, wind: float, seed: int) -> Flown:
    """Fly the twin-boom aircraft under its autopilot in the turbulence of a wind at 20 ft, m/s."""
    rng = np.random.default_rng(seed)
    calm = scenes.with_trim_thrust(scenes.aircraft())
    maneuver, spans = planned(inputs, scenes.RATE)
    blown = scenes.with_biases(scenes.in_turbulence(calm, wind), rng)
    flight = settled(closed_loop.fly(blown, maneuver, rng, "flight"))
    return Flown(flight, scenes.wrong_start(calm, rng), scenes.coefficients(calm), spans)


def quadrotor(inputs: Inputs, wind: float, seed: int) -> Flown:
    """Fly the quadrotor likewise, its inertia free."""
    scene = closed_loop.quadrotor_scene(0.0, seed)
    maneuver, spans = planned(inputs, closed_loop.QUADROTOR_RATE)
    blown = scenes.in_turbulence(load_vehicle(closed_loop.QUADROTOR), wind, closed_loop.PASSING)
    flight = settled(simulate_flight(blown, maneuver, seed=seed, name="flight"))
    return Flown(flight, scene.start, scene.truth, spans)


CASES: Final[Mapping[str, Callable[[int], Flown]]] = {
    f"{name}-{kind}-{level}": partial(fly, inputs, LEVELS[level] * KNOT)
    for name, fly, flown, levels in (
        ("aircraft", aircraft, AIRCRAFT, ("light", "moderate")),
        ("quadrotor", quadrotor, QUADROTOR, ("light", "moderate")),
    )
    for kind, inputs in flown.items()
    for level in (levels if inputs else tuple(LEVELS))
}


@study.work
def propose(case: str, seed: int) -> dict[str, Any]:
    """Fly a case, take the windows that are proposed, and identify them as `stoop identify` would."""
    flown = CASES[case](1000 * list(CASES).index(case) + seed)
    flights = {flown.flight.name: flown.flight}
    out: dict[str, Any] = {"maneuvers": len(flown.spans), "found": 0, "windows": 0, "beside": 0, "false": 0}
    out |= {"ratios": [], "bare_windows": 0, "bare_false": 0, "inside": 0, "estimates": 0}
    for key, vehicle in (("bare_", None), ("", flown.start)):
        try:
            found = find_windows(flights, vehicle)
        except FlightError:
            continue
        kept = [w for w in found.windows if w.accept]
        out[f"{key}windows"] = len(kept)
        without = [w for w in kept if not any(w.start < b and a < w.stop for a, b in flown.spans)]
        # of a vehicle on rotors: windows in which thrust and drag show, and no command is said to stand out
        beside = [w for w in without if flown.spans and vehicle and vehicle.rotors and w.maneuver is None]
        out[f"{key}false"] = len(without) - len(beside)
        out["beside"] += len(beside)
    if out["windows"]:
        out["found"] = sum(held(found, span) for span in flown.spans)
        estimates = identified(flown.start, flights, fit_windows(found))
        out["ratios"] = ratios(found, estimates)
        known = [(n, v) for n, v in flown.truth.items() if np.isfinite(estimates.get(n, (0.0, np.nan))[1])]
        inside = [abs(estimates[n][0] - v) <= NORMAL_95 * estimates[n][1] for n, v in known]
        out |= {"inside": int(sum(inside)), "estimates": len(inside)}
    return out


def held(found: FoundWindows, span: Span) -> bool:
    """Tell whether a proposed window holds an input."""
    a, b = span
    shares = [(min(w.stop, b) - max(w.start, a)) / (b - a) for w in found.windows if w.accept]
    return max(shares, default=0.0) >= WHOLE


def fit_windows(found: FoundWindows) -> list[Window]:
    """Return the windows to fit."""
    return [Window(w.flight, w.start, w.stop) for w in found.windows if w.accept and w.use == "fit"]


def identified(
    vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]
) -> dict[str, tuple[float, float]]:
    """Return estimates and standard errors by the method that is taken where none is named; NaN where not identifiable."""
    fit = fit_by(FIT_ALONE, vehicle, flights, windows).estimate
    bars = ErrorBars.of(fit)
    told = {n: one.identifiable for n, one in bars.identifiability.items()}
    rows = zip(fit.estimates.items(), bars.std, strict=False)
    return {n: (v, float(s) if told.get(n) and s > 0.0 else np.nan) for (n, v), s in rows}


def ratios(found: FoundWindows, estimates: Mapping[str, tuple[float, float]]) -> list[float]:
    """Return achieved over expected standard errors of the identifiable numbers."""
    pairs = [(estimates.get(e.name, (0.0, np.nan))[1], e.std_error) for e in found.expected]
    return [a / b for a, b in pairs if np.isfinite(a) and np.isfinite(b) and b > 0.0]


@dataclass(frozen=True)
class Real:
    """A real flight: where it lies, its vehicle file, its mapping, and windows that were chosen by hand."""

    words: str
    folder: str
    vehicle: str
    mapping: tuple[str, str] | None
    by_hand: tuple[Span, ...]


_HAND: Final = ((140, 145), (146, 152), (160, 168.3))
#: package and file
_MAPPING: Final = ("stoop_studies.problems", "hexacopter_mapping.toml")
REAL: Final[Mapping[str, Real]] = {
    "v-tail": Real("V-tail aeroplane", "altlnt-vtail-8kg-px4/flight2", "v_tail", None, _HAND),
    "hexacopter": Real("hexacopter", hexacopter.FOLDER, "hexacopter", _MAPPING, ((140.0, 214.0),)),
}


def fit_real(real: Real, data: Path) -> dict[str, Any]:
    """Return what is proposed of a real flight, expected and achieved errors, and agreement with the windows by hand."""
    path = data / real.folder
    if real.mapping is None:
        flight = load_flight(path)
    else:
        package, name = real.mapping
        with as_file(files(package).joinpath(name)) as mapping:
            flight = load_flight(path, mapping)
    flight = flight.without_faults()
    vehicle, flights = (
        parse_vehicle(vehicle_text(real.vehicle), f"{real.vehicle}.toml"),
        {flight.name: flight},
    )
    found = find_windows(flights, vehicle)
    own = identified(vehicle, flights, fit_windows(found))
    hand = identified(vehicle, flights, [Window(flight.name, a, b) for a, b in real.by_hand])
    shared = [n for n in own if np.isfinite([own[n][1], hand.get(n, (0.0, np.nan))[1]]).all()]
    apart = [abs(own[n][0] - hand[n][0]) / float(np.hypot(own[n][1], hand[n][1])) for n in shared]
    spans = [f"{w.start:.1f}:{w.stop:.1f}" for w in found.windows if w.accept and w.use == "fit"]
    return {
        "windows": " ".join(spans),
        "by_hand": " ".join(f"{a:g}:{b:g}" for a, b in real.by_hand),
        "compared": len(shared),
        "agree": sum(z <= NORMAL_95 for z in apart),
        **quartiles(ratios(found, own)),
    }


def quartiles(values: Sequence[float]) -> dict[str, Any]:
    """Return the quartiles of achieved over expected errors, and how many there are; None without any."""
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75)).tolist() if values else (None,) * 3
    return {"errors": len(values), "lower": low, "median": middle, "upper": high}


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return what was found in each case, and on the real flights where their folder is given."""
    records = []
    for case, results in samples.items():
        total = {k: sum(r[k] for r in results) for k in COUNTS}
        proposing = sum(r["windows"] + r["bare_windows"] > 0 for r in results)
        each = quartiles([x for r in results for x in r["ratios"]])
        coverage = finite_or_none(total["inside"] / total["estimates"]) if total["estimates"] else None
        row = {"case": case, "flights": len(results), "proposing": proposing}
        records.append({**row, **total, **each, "coverage": coverage})
    real = []
    if setting.data is not None:
        real = [{"case": k, "words": one.words, **fit_real(one, setting.data)} for k, one in REAL.items()]
    return Findings.of("Windows worth fitting", _claims(records, real), records, {"real": real})


def _claims(records: Sequence[Mapping[str, Any]], real: Sequence[Mapping[str, Any]]) -> Iterator[Claim]:
    flown, found = (sum(r[k] for r in records) for k in ("maneuvers", "found"))
    yield holds("95 % of the maneuvers are found", found >= 0.95 * flown, f"{found} of {flown}")
    calm = [r for r in records if not r["maneuvers"]]
    proposing, flights = (sum(r[k] for r in calm) for k in ("proposing", "flights"))
    yield holds("Nothing is proposed of gusts alone", proposing == 0, f"{proposing} of {flights} flights")
    false, windows = (sum(r[k] + r[f"bare_{k}"] for r in records) for k in ("false", "windows"))
    beside = sum(r["beside"] for r in records)
    yield holds(
        "No window is without a maneuver, but of rotors those for thrust and drag",
        false == 0,
        f"{false} of {windows} windows, {beside} for thrust and drag",
    )
    for r in (*records, *real):
        if r["median"] is not None:
            yield holds(
                f"{r['case']}: the median of achieved over expected errors is within a factor of {RATIO:g}",
                1.0 / RATIO <= r["median"] <= RATIO,
                f"{r['median']:.2f}, quartiles {r['lower']:.2f} and {r['upper']:.2f}, {r['errors']} errors",
            )
    for r in real:
        yield holds(
            f"{r['case']}: nine in ten numbers agree with those of windows chosen by hand",
            r["agree"] >= 0.9 * r["compared"],
            f"{r['agree']} of {r['compared']} within 95 %",
        )


EXPERIMENT: Final = study.Verification(
    "windows", show, runs=10, work="propose", cases=tuple(CASES), parts=("real",), reads_data=False
)

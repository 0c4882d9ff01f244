"""Delays recovered, in samples: of controls and sensors with the model, of sensors in a compatibility check.

Flights are simulated twenty times as fast as they are recorded, delays are whole steps of that: no interpolation of the
estimator's kind is in the data, and a delay of 0.35 sample is exactly seven steps.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
import tomlkit

from stoop.assessment.error_bars import ErrorBars
from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of, quaternions_of
from stoop.base.variables import EULER, POSITION, VELOCITY
from stoop.estimate.fit import Options, fit
from stoop.flight import Flight, from_columns
from stoop.reconstruction.compatibility import Compatibility
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.load import parse_vehicle
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify import scenes, study

RATE: Final = 100.0  #: Hz, as recorded
SUBSTEPS: Final = 20  #: of the simulation between two samples
SIMULATION_RATE: Final = RATE * SUBSTEPS
SLEW: Final = 1.0  #: rad/s: what moves between samples must be seen in them
BOX: Final = (-0.05, 0.15)  #: s, in which delays are looked for
START: Final = 0.02  #: s
MAX_DELAY: Final = 100  #: steps; the longest delay drawn, five samples
MAX_RECEIVER_DELAY: Final = 300  #: steps; of velocity and position, as a receiver delivers them
INPUTS: Final = ("elevator", "aileron", "rudder")
SENSORS: Final = ("V", "alpha", "beta", "phi", "theta", "psi")
NAMES: Final = (*(f"controls.{c}.delay" for c in INPUTS), *(f"sensors.{c}.delay" for c in SENSORS))
NOISE: Final = {
    "V": 0.02, "alpha": 0.001, "beta": 0.001, "p": 0.002, "q": 0.002, "r": 0.002, "phi": 0.0005, "theta": 0.0005,
    "psi": 0.0005, "ax": 0.03, "ay": 0.03, "az": 0.03, "vn": 0.03, "ve": 0.03, "vd": 0.03, "pn": 0.1, "pe": 0.1, "pd": 0.1,
}  #: SI, white  # fmt: skip
STEPS: Final = {
    "pitch": (("elevator", "3-2-1-1", 1.0, 0.3, 0.12), ("elevator", "doublet", 6.0, 2.0, 0.12)),
    "heave": (("elevator", "doublet", 1.0, 2.5, 0.12), ("elevator", "doublet", 8.0, 0.5, 0.12)),
    "roll": (("aileron", "doublet", 1.0, 0.5, 0.10), ("rudder", "2-1-1", 4.0, 0.6, 0.12)),
    "yaw": (("rudder", "doublet", 1.0, 0.7, 0.15), ("aileron", "2-1-1", 6.0, 0.5, -0.10)),
}  #: maneuver to its inputs: control, shape, start (s), step (s), amplitude (rad)
WIND: Final = (3.0, -2.0, 0.0)  #: m/s
GROUPS: Final = {
    "rates": ("p", "q", "r"), "attitude": EULER, "V": ("V",), "alpha": ("alpha",), "beta": ("beta",),
    "velocity": VELOCITY, "position": POSITION,
}  #: sensors of a compatibility check that are late together  # fmt: skip
TOLERANCE: Final = 0.1  #: samples
COVERED: Final = (0.90, 0.99)
CASES: Final = {
    "identify": "with the model: controls and sensors, beside 32 coefficients, initial states and biases",
    "compatibility": "in a compatibility check: sensors, beside biases, scales, positions and wind",
}


@functools.cache
def maneuvers() -> Mapping[str, Maneuver]:
    """Return the maneuvers by name, at the rate of the simulation."""
    return scenes.step_maneuvers(STEPS, scenes.DURATION, SIMULATION_RATE, slew=SLEW)


@functools.cache
def aircraft() -> Vehicle:
    """Return the twin-boom aircraft with a delay on every control and on every sensor but the inertial ones."""
    plain = load_vehicle(scenes.AIRCRAFT)
    document: Any = tomlkit.parse(plain.text)
    unknown = {"value": 0.0, "free": True, "bounds": list(BOX)}
    for table, names in (("controls", INPUTS), ("sensors", SENSORS)):
        for name in names:
            document.setdefault(table, {}).setdefault(name, {})["delay"] = dict(unknown)
    vehicle = parse_vehicle(tomlkit.dumps(document), plain.where)
    return scenes.with_trim_thrust(
        vehicle.with_numbers({name: {"value": value} for name, value in scenes.TRUTHS.items()})
    )


def late_vehicle(seed: int) -> scenes.Scene:
    """Return an identification in which nine delays are unknown beside 32 coefficients."""
    rng = np.random.default_rng(seed)
    delays = {name: int(rng.integers(0, MAX_DELAY + 1)) / SIMULATION_RATE for name in NAMES}
    truth = aircraft().with_numbers({name: {"value": value} for name, value in delays.items()})
    flights = {}
    for name, planned in maneuvers().items():
        flown = simulate_flight(scenes.with_biases(truth, rng), planned, noise=False, name=name)
        columns = {str(c): flown.column(str(c)) for c in flown.channels}
        flights[name] = recorded(name, flown.time, columns, rng)
    unknown = {name: {"value": START, "bounds": BOX} for name in delays}
    start = scenes.wrong_start(aircraft(), rng).with_numbers(unknown)
    return scenes.Scene(start, flights, scenes.whole_maneuvers(), delays)


def late_sensors(seed: int) -> tuple[Flight, dict[str, float]]:
    """Return a flight for a compatibility check, and the delay of each group of sensors, s."""
    rng = np.random.default_rng(seed)
    most = {"velocity": MAX_RECEIVER_DELAY, "position": MAX_RECEIVER_DELAY}
    steps = {name: int(rng.integers(0, most.get(name, MAX_DELAY) + 1)) for name in GROUPS}
    late = {channel: steps[name] for name, channels in GROUPS.items() for channel in channels}
    prompt = aircraft().with_numbers({name: {"value": 0.0} for name in NAMES})
    flown = [simulate_flight(prompt, maneuver, noise=False) for maneuver in maneuvers().values()]
    biases = {c: sigma * rng.standard_normal() for c, sigma in scenes.BIASES.items()}
    parts = []
    for flight in flown:  # what the vehicle's sensors read, velocity over ground and position
        columns = {c: flight.column(c) for c in prompt.outputs}
        body = rigid_states({name: columns[name] for name in ("V", "alpha", "beta")})
        rotation = matrices_of(quaternions_of(np.column_stack([columns[name] for name in EULER])))
        air = np.column_stack([body[name] for name in "uvw"])
        ground = np.einsum("nij,nj->ni", rotation, air) + np.array(WIND)
        steps_made = np.cumsum(0.5 * (ground[1:] + ground[:-1]), axis=0) / SIMULATION_RATE
        place = np.concatenate([np.zeros((1, 3)), steps_made])
        parts.append({**columns, **dict(zip((*VELOCITY, *POSITION), (*ground.T, *place.T), strict=True))})
    gap = np.full(int(SIMULATION_RATE), np.nan)  # a second without a record keeps the maneuvers apart
    whole = {}
    for channel in parts[0]:
        shift, pieces = late.get(channel, 0), []
        for part in parts:
            x = part[channel] + biases.get(channel, 0.0)
            pieces += [np.full(shift, x[0]), x[: len(x) - shift], gap]
        whole[channel] = np.concatenate(pieces)
    time = np.arange(len(whole["V"])) / SIMULATION_RATE
    return recorded(f"late {seed}", time, whole, rng), {n: k / SIMULATION_RATE for n, k in steps.items()}


def recorded(
    name: str, time: FloatArray, columns: Mapping[str, FloatArray], rng: np.random.Generator
) -> Flight:
    """Take every twentieth sample, with noise."""
    kept = {c: x[::SUBSTEPS] for c, x in columns.items() if c not in ("q0", "q1", "q2", "q3")}
    noisy = {c: x + NOISE.get(c, 0.0) * rng.standard_normal(len(x)) for c, x in kept.items()}
    return from_columns(name, time[::SUBSTEPS], noisy)


@study.work
def recover(case: str, seed: int) -> dict[str, Any]:
    """Estimate the delays of a flight in an identification, or in a compatibility check; all in samples."""
    if case == "identify":
        scene, options = late_vehicle(seed), Options(seed=seed)
        done = fit(scene.start, scene.flights, scene.windows, options)
        std = dict(
            zip((p.name for p in done.problem.layout.parameters), ErrorBars.of(done).std, strict=False)
        )
        truth, status = scene.truth, str(done.outcome.status)
        found = {name: (done.estimates[name], float(std[name])) for name in truth}
    else:
        flight, delays = late_sensors(seed)
        result, estimate = Compatibility.of(flight)
        truth = {f"{name}.delay": value for name, value in delays.items()}
        status = "converged" if estimate.converged else "weights did not rest"
        found = {name: (result.findings[name].estimate, result.findings[name].std_error) for name in truth}
    return {
        "names": list(truth),
        "truth": [RATE * value for value in truth.values()],
        "errors": [RATE * (found[name][0] - value) for name, value in truth.items()],
        "sigma": study.or_none(np.array([RATE * found[name][1] for name in truth])),
        "status": status,
    }


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how far the delays are off: the model recovers all of them, a compatibility check as well as it says."""
    claims, records = list[Claim](), dict[str, list[dict[str, Any]]]()
    for case, words in CASES.items():
        results, names = samples[case], samples[case][0]["names"]
        errors = np.abs([r["errors"] for r in results])
        rms, sigma, coverage, _ = study.error_statistics(results)
        flights = f"over {len(errors)} flights, {study.unfinished(results)} not finished"
        if case == "identify":
            worst, inside = int(np.argmax(rms)), float(np.mean(errors < TOLERANCE))
            claim = holds(
                f"Delays are recovered within {TOLERANCE:g} sample (root mean square of each), {words}",
                bool(rms[worst] < TOLERANCE),
                f"{100 * inside:.1f} % of {errors.size} errors are within; the largest root mean square is "
                f"{rms[worst]:.3f} ({names[worst]}), {flights}",
            )
            claims.append(claim)
        spread = f"of all; mean standard errors from {sigma.min():.3f} to {sigma.max():.3f} sample, {flights}"
        statement = f"95 % intervals of delays, {words}, hold the truth in"
        claims.append(study.within(statement, COVERED, float(coverage.mean()), spread))
        found = {
            "rms_error": rms,
            "largest_error": errors.max(axis=0),
            "mean_sigma": sigma,
            "coverage": coverage,
        }
        each = {"case": case, "delay": names, "flights": len(errors), **found}
        records[case] = study.records_of(pd.DataFrame(each))
    rows = [record for own in records.values() for record in own]
    return Findings.of("Delays of inputs and outputs, fractions of a sample included", claims, rows)


EXPERIMENT: Final = study.Verification("delays", show, runs=40, work="recover", cases=tuple(CASES))

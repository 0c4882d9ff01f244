"""Servo lags and delays that a vehicle file leaves out: what identification by default makes of them, and of the rest.

The file of the quick start gives neither. Flights of known truth, with servos from ideal to slow and with late measurements, are
identified from it; the intervals of lag, delay and coefficients are compared with the truth.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.assessment.error_bars import ErrorBars
from stoop.base.numbers import finite_or_none
from stoop.flight import Flight, from_columns
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.load import parse_vehicle
from stoop.workflow.identification import search
from stoop_studies.findings import Findings, Setting, holds
from stoop_studies.verify import scenes, study
from stoop_studies.verify.study import vehicle_text

TRUTH: Final = {
    "CD0": 0.05, "CDalpha": 0.2, "CDalpha2": 1.2, "CDV": 0.02, "CL0": 0.35, "CLalpha": 5.2, "CLq": 8.0, "CLV": 0.05,
    "CLelevator": 0.35, "Cm0": 0.02, "Cmalpha": -0.9, "Cmq": -14.0, "CmV": 0.02, "Cmelevator": -1.2, "CQ0": 0.003,
    "CQbeta": -0.45, "CQp": 0.05, "CQr": 0.2, "CQrudder": 0.18, "CQV": 0.01, "Cl0": 0.001, "Clbeta": -0.07, "Clp": -0.55,
    "Clr": 0.14, "Claileron": 0.25, "Clrudder": 0.015, "Cn0": 0.001, "Cnbeta": 0.06, "Cnp": -0.03, "Cnr": -0.1,
    "Cnaileron": -0.02, "Cnrudder": -0.09,
}  # fmt: skip
#: those of all servos, in the order of the file
LAG, DELAY = "controls.aileron.lag", "controls.aileron.delay"
RATE: Final = 50.0  #: Hz, as recorded
SUBSTEPS: Final = 20  #: of the simulation between two samples
SLEW: Final = 1.0  #: rad/s, of the commands: their corners are samples
DURATION: Final = 12.0  #: s
STEPS: Final[Mapping[str, tuple[scenes.Step, ...]]] = {
    "pitch": (("elevator", "3-2-1-1", 1.0, 0.3, 0.06), ("elevator", "doublet", 7.0, 0.5, 0.06)),
    "roll": (("aileron", "doublet", 1.0, 0.5, 0.08), ("rudder", "2-1-1", 4.0, 0.5, 0.12)),
    "yaw": (("rudder", "doublet", 1.0, 0.6, 0.12), ("aileron", "2-1-1", 6.0, 0.4, -0.08)),
}  #: maneuver to its inputs


@dataclass(frozen=True)
class Servos:
    """Servos of the truth: lag and delay, s."""

    lag: float
    delay: float

    @property
    def words(self) -> str:
        """What they are, for a page."""
        return f"lag {1e3 * self.lag:.0f} ms, delay {1e3 * self.delay:.0f} ms"


CASES: Final = {
    f"lag{1e3 * lag:.0f}-delay{1e3 * delay:.0f}": Servos(lag, delay)
    for delay in (0.0, 0.03)
    for lag in (0.0, 0.02, 0.05, 0.08)
}
POOLED: Final = (0.90, 0.98)
MAX_RMS_Z: Final = 1.2


@functools.cache
def maneuvers() -> Mapping[str, Maneuver]:
    """Return the maneuvers by name, at the rate of the simulation."""
    return scenes.step_maneuvers(STEPS, DURATION, RATE * SUBSTEPS, slew=SLEW)


@functools.cache
def aircraft(servos: Servos) -> Vehicle:
    """Return the truth."""
    true = {n: {"value": x} for n, x in TRUTH.items()}
    plain = parse_vehicle(vehicle_text("quick_start"), "quick start").with_numbers(true)
    numbers = {"lag": servos.lag, "delay": servos.delay}
    entries: dict[tuple[str, ...], float] = {
        ("controls", c, kind): x for c in plain.controls for kind, x in numbers.items()
    }
    return with_entries(plain, entries).with_numbers(true)


def flights(servos: Servos, seed: int) -> tuple[dict[str, Flight], dict[str, float]]:
    """Return flights of noise, biases and thrust that the seed draws, and the truth of what is free."""
    rng, flown = np.random.default_rng(seed), dict[str, Flight]()
    truth = aircraft(servos)
    thrust = {
        f"propulsion.{n}": truth.value(f"propulsion.{n}") + 0.02 * rng.standard_normal()
        for n in ("CT0", "CT1")
    }
    truth = truth.with_numbers({n: {"value": x} for n, x in thrust.items()})
    for name, maneuver in maneuvers().items():
        one = simulate_flight(scenes.with_biases(truth, rng), maneuver, noise=False, name=name)
        sigma = dict(zip(truth.outputs, scenes.sensor_noise(truth), strict=True))
        columns = {str(c): one.column(str(c))[::SUBSTEPS] for c in one.channels}
        noisy = {c: x + sigma.get(c, 0.0) * rng.standard_normal(len(x)) for c, x in columns.items()}
        flown[name] = from_columns(name, one.time[::SUBSTEPS], noisy)
    return flown, {**TRUTH, **thrust, LAG: servos.lag, DELAY: servos.delay}


@study.work
def identify(case: str, seed: int) -> dict[str, Any]:
    """Identify a flight from the file of the quick start, all by default."""
    flown, truth = flights(CASES[case], seed)
    unknown = {
        f"sensors.{c}.bias": {"free": True, "prior": s} for c, s in scenes.BIASES.items()
    }  # the truth's, so that they count in no error
    vehicle = parse_vehicle(vehicle_text("quick_start"), "quick start").with_numbers(unknown)
    windows = [Window(name, 0.0, DURATION) for name in flown]
    fit = search(vehicle, list(flown.values()), windows).estimate
    std = dict(zip((p.name for p in fit.problem.layout.parameters), ErrorBars.of(fit).std, strict=False))
    found = fit.estimates
    return {
        "names": list(truth),
        "estimates": [finite_or_none(found[n]) for n in truth],
        "errors": [found[n] - x for n, x in truth.items()],
        "sigma": study.or_none(np.array([std[n] or np.nan for n in truth])),  # zero at a bound
        "status": str(fit.outcome.status),
    }


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how the intervals of all that is free hold the truth, by servos."""
    records = [_record(case, samples[case]) for case in CASES]
    shares = [r["coverage"] for r in records]
    largest = max(records, key=lambda r: r["rms_z"])
    claims = [
        study.within(
            "95 % intervals, lag and delay included, hold the truth in",
            POOLED,
            float(np.average(shares)),
            f"of all, {100 * min(shares):.1f} to {100 * max(shares):.1f} % by servos",
        ),
        holds(
            f"The root mean square of z is at most {MAX_RMS_Z:g} for every kind of servo",
            bool(largest["rms_z"] <= MAX_RMS_Z),
            f"at most {largest['rms_z']:.2f} ({largest['servos']})",
        ),
    ]
    return Findings.of("Servo lags and delays that a vehicle file leaves out", claims, records)


def _record(case: str, results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures of one kind of servo; what lies at a bound has no interval and does not count."""
    keys = ("errors", "sigma", "estimates")
    errors, sigma, found = (np.array([r[k] for r in results], dtype=np.float64) for k in keys)
    given = np.isfinite(sigma)
    z = (errors / sigma)[given]
    lag, delay = (results[0]["names"].index(name) for name in (LAG, DELAY))
    return {
        "case": case, "servos": CASES[case].words, "flights": len(results),
        "coverage": float(np.mean(np.abs(z) <= NORMAL_95)), "rms_z": float(np.sqrt(np.mean(z**2))),
        "largest_z": float(np.max(np.abs(z))), "lag": float(1e3 * np.nanmean(found[:, lag])),
        "delay": float(1e3 * np.nanmean(found[:, delay])),
        "sum_error": float(1e3 * np.sqrt(np.mean((errors[:, lag] + errors[:, delay]) ** 2))),
        "at_bound": float(np.mean(~given[:, lag])),
    }  # fmt: skip


EXPERIMENT: Final = study.Verification("servos", show, runs=30, work="identify", cases=tuple(CASES))

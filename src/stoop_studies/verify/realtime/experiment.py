"""Recursive estimates at the end of a record against the batch over the same band, and on the way there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.estimate.fit import Options, pose
from stoop.estimate.regression.aircraft import AircraftEquations
from stoop.estimate.regression.domain import FrequencyDomain
from stoop.estimate.regression.equations import estimate, unbounded
from stoop.estimate.regression.recursive import RealTime
from stoop.flight import Flight
from stoop.parallel import Plan, Run
from stoop.problem.windows import Window
from stoop.report.plots import Series, Strip, stacked_plots
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop.simulate import parse_maneuver, simulate_flight, trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop_studies.findings import Findings, Results, Setting, holds, number

WORK: Final = "stoop_studies.verify.realtime.experiment:ends"
DURATION: Final = 60.0  #: s
RATE: Final = 50.0  #: Hz
ALTITUDE: Final = 200.0  #: m
BAND: Final = FrequencyDomain(0.05, 1.5)
AMPLITUDES: Final = {"elevator": 0.2, "aileron": 0.08, "rudder": 0.15}  #: rad
WELL: Final = (
    0.02  #: standard error of the batch over the estimate, below which a parameter is well identified
)
CLOSE: Final = 0.02
EVERY: Final = 50  #: samples between two estimates that are drawn
DRAWN: Final = ("CLalpha", "Cmalpha", "Cmq", "Clp", "Cnbeta")
HEAD: Final = (
    "parameter", "truth", "flights", "well_identified", "batch_std_error", "median_difference", "largest_difference",
    "largest_difference_well_identified",
)  # fmt: skip
LEAD: Final = """\
The twin-boom aircraft flies {duration:.0f} s at {rate:.0f} Hz with multisines on all controls at once and the sensor noise of \
its file on all channels. Its terms are estimated twice on Fourier coefficients from {low:g} to {high:g} Hz: by the batch \
(--method frequency-domain), which takes trends off the whole record and fades its ends, and sample by sample, with \
transforms that grow, a difference formula of five samples, and bias and drift fitted along. They share the equations and \
the band, not the transform."""
WORDS: Final = """\
Differences are those of the recursive estimate at the end from the batch's, over the batch's. Well identified is a \
parameter whose standard error in the batch is below {well:.0%} of its estimate; constants, which a band does not hold, \
are left to the batch."""


@dataclass(frozen=True)
class Realtime:
    """Recursive against batch."""

    name: str = "recursive"
    runs: int = 50
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return one run per flight."""
        runs = tuple(Run(_key(s), WORK, {"seed": s}) for s in setting.seeds)
        return Plan(self.name, {"experiment": self.name}, runs)

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        told = [results[_key(s)] for s in setting.seeds]
        names = tuple(told[0]["names"])
        batch, std, recursive = (np.array([t[k] for t in told]) for k in ("batch", "std", "recursive"))
        apart, well = np.abs(recursive / batch - 1.0), std < WELL * np.abs(batch)
        worst = float(apart[well].max()) if well.any() else np.nan
        claim = holds(
            "at the end of the record every well identified parameter is within 2 % of the batch",
            bool(worst < CLOSE),
            f"largest difference {100.0 * worst:.2f} %, {int(well.sum())} estimates of "
            f"{int(well.any(axis=0).sum())} parameters in {len(told)} flights",
        )
        rows = tuple(_rows(names, batch, std, apart, well))
        return Findings(
            "Recursive estimates against the batch",
            LEAD.format(duration=DURATION, rate=RATE, low=BAND.low, high=BAND.high),
            (claim,),
            (
                Section("At the end", (_table(rows), Prose(WORDS.format(well=WELL)))),
                _on_the_way(setting.seed),
            ),
            HEAD,
            rows,
        )


def _key(seed: int) -> str:
    return f"flight/{seed:06d}"


def scene(seed: int) -> tuple[Vehicle, Flight]:
    """Return an aircraft, its thrust that of the trim, and its flight."""
    vehicle = resolve_vehicle("twin-boom")
    thrust = trim(vehicle, None, ALTITUDE).changes["propulsion.thrust"]
    known = vehicle.with_numbers({"propulsion.thrust": {"value": thrust}})
    lines = [f"duration = {DURATION}", f"rate = {RATE}", f"altitude = {ALTITUDE}"]
    for i, (control, amplitude) in enumerate(AMPLITUDES.items()):
        lines += [
            "[[input]]", f'control = "{control}"', 'shape = "multisine"', "start = 0.0", f"duration = {DURATION}",
            f"amplitude = {amplitude}", "band = 1.2", f"first = {6 + i}", "stride = 3",
        ]  # fmt: skip
    return known, simulate_flight(known, parse_maneuver("\n".join(lines), "maneuver"), seed)


def replay(vehicle: Vehicle, flight: Flight, online: RealTime) -> Iterator[int]:
    """Give a flight to an estimator sample by sample; yield the count after each."""
    names = [c for c in (*vehicle.outputs, *vehicle.inputs, "altitude") if c in flight.data]
    table = np.column_stack([flight.column(c) for c in names])
    for k, row in enumerate(table, 1):
        online.update(dict(zip(names, row.tolist(), strict=True)))
        yield k


def ends(arguments: Mapping[str, Any], stops: list[int | None]) -> list[Any]:
    """Return the estimates of both at the end of the flight of ``seed``."""
    vehicle, flight = scene(int(arguments["seed"]))
    problem, _ = pose(vehicle, {flight.name: flight}, [Window(flight.name, 0.0, DURATION)], Options())
    equations = AircraftEquations.of(problem.layout, problem.pieces)
    batch = estimate(equations, BAND, unbounded(equations))
    assert batch is not None  # noqa: S101 - everything was measured
    online = RealTime(vehicle, 1.0 / RATE, BAND.frequencies(len(flight.time), 1.0 / RATE))
    for _ in replay(vehicle, flight, online):
        pass
    found = online.estimate()
    kept = [k for k, name in enumerate(equations.names) if not name.endswith("0")]
    names = [equations.names[k] for k in kept]
    std = np.sqrt(np.diag(batch.covariance))
    told = {
        "names": names,
        "batch": [float(batch.values[k]) for k in kept],
        "std": [float(std[k]) for k in kept],
        "recursive": [found[n].value for n in names],
    }
    return [told for _ in stops]


def _rows(
    names: tuple[str, ...], batch: FloatArray, std: FloatArray, apart: FloatArray, well: FloatArray
) -> Iterator[tuple[Cell, ...]]:
    truth = resolve_vehicle("twin-boom")
    for i, name in enumerate(names):
        own = well[:, i].astype(bool)
        worst = float(apart[own, i].max()) if own.any() else None
        share = float(np.median(std[:, i] / np.abs(batch[:, i])))
        yield (
            name, truth.value(name), len(batch), int(own.sum()), share, float(np.median(apart[:, i])),
            float(apart[:, i].max()), worst,
        )  # fmt: skip


def _table(rows: tuple[tuple[Cell, ...], ...]) -> Table:
    head = (
        "parameter",
        "truth",
        "well identified",
        "batch std. error",
        "median difference",
        "largest",
        "largest where well identified",
    )
    shown = tuple(
        (str(r[0]), number(_float(r[1]), 4), f"{r[3]} of {r[2]}", *(_percent(r[i]) for i in (4, 5, 6, 7)))
        for r in rows
    )
    return Table("Recursive estimates at the end of the record", head, shown)


def _float(cell: Cell) -> float:
    return float(cell) if isinstance(cell, float | int) else np.nan


def _percent(cell: Cell) -> str:
    value = _float(cell)
    return f"{100.0 * value:.2f} %" if np.isfinite(value) else "–"


def _on_the_way(seed: int) -> Section:
    """Draw estimates and their 95 % intervals over time."""
    vehicle, flight = scene(seed)
    online = RealTime(vehicle, 1.0 / RATE, BAND.frequencies(len(flight.time), 1.0 / RATE))
    told = [(k, e) for k in replay(vehicle, flight, online) if k % EVERY == 0 and (e := online.estimate())]
    time = np.array([k / RATE for k, _ in told])
    late = time > DURATION / 6.0
    strips = []
    for name in DRAWN:
        value = np.array([e[name].value for _, e in told])[late]
        reach = 1.96 * np.array([e[name].std_error for _, e in told])[late]
        truth = np.full(late.sum(), vehicle.value(name))
        curves = [("estimate", value), ("95 %", value - reach), ("95 %", value + reach), ("truth", truth)]
        strips.append(Strip(name, tuple(Series(n, time[late], y) for n, y in curves)))
    drawing = stacked_plots(strips, "time, s", "Estimates in flight")
    return Section("On the way", (Figure("Estimates of one flight as it goes on, once a second", drawing),))

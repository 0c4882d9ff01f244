"""Default bounds that an estimate reaches are widened, and all is fitted again; bounds of the file stay."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from stoop.base.notices import Notice, notice
from stoop.results.decisions import DecisionRecord
from stoop.strategy.decision import Decision, Fitted, Fitter, Setup
from stoop.strategy.likelihood import log_likelihood_rise
from stoop.vehicle import Vehicle
from stoop.vehicle.defaults import wider_bounds

NAME: Final = "bounds"
MAX_WIDENINGS: Final = 3  #: each doubles a box
DOING: Final = "default bounds that an estimate reached were widened"


def widen(setup: Setup, fit: Fitter) -> Fitted:
    """Return the fit with wider bounds where its estimates, or those of an earlier fit, reach default ones."""
    began, vehicle, known = time.perf_counter(), setup.vehicle, setup.options.start
    unbounded = {name for name, q in vehicle.quantities.items() if q.bounds is None}
    beyond = {
        p.name: min(max(known[p.name], p.lower), p.upper)
        for p in vehicle.parameters
        if p.name in unbounded & known.keys() and not p.lower <= known[p.name] <= p.upper
    }
    boxes = wider_boxes(vehicle, beyond)
    remarks, vehicle = _remarks(boxes, beyond), _with_bounds(vehicle, boxes)
    first = found = fit(replace(setup, vehicle=vehicle))
    for _ in range(MAX_WIDENINGS):
        at_bound = [u for u in found.estimate.unknowns if u.fixed == "bound" and u.name in unbounded]
        held = {u.name: u.estimate for u in at_bound}
        boxes = wider_boxes(vehicle, held)
        # a search that ends for want of trajectories finds no better optimum in a wider box
        if not boxes or found.estimate.outcome.status in ("interrupted", "budget"):
            break
        vehicle = _with_bounds(vehicle, boxes)
        try:
            wider = found.again(vehicle, fit)
        except KeyboardInterrupt:  # what was found within the narrower bounds stands
            found = found.interrupted(DOING)
            break
        more = found.estimate.trajectories + wider.estimate.trajectories
        # a search of its own, which may end in a worse optimum: then too what was found stands
        cut = wider.estimate.outcome.status == "interrupted"
        worse = not cut and log_likelihood_rise(found.estimate, wider.estimate)[0] < 0.0
        kept = found if worse else wider
        found = replace(kept, estimate=replace(kept.estimate, trajectories=more))
        if worse:
            break
        remarks |= _remarks(boxes, held)
    if not remarks:
        return found
    found = found.resuming(first)
    record = DecisionRecord(
        NAME, "applied", f"{', '.join(remarks)} at a default bound", "bounds widened, fitted again",
        log_likelihood_rise(first.estimate, found.estimate)[0], seconds=time.perf_counter() - began,
    )  # fmt: skip
    return found.noting(*remarks.values()).recorded(record)


def wider_boxes(vehicle: Vehicle, held: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Return wider boxes of numbers whose estimates a bound holds, as far as physics allows."""
    at = [p for p in vehicle.parameters if p.name in held]
    boxes = {p.name: wider_bounds(p.name, p.value, (p.lower, p.upper), held[p.name]) for p in at}
    return {p.name: boxes[p.name] for p in at if boxes[p.name] != (p.lower, p.upper)}


def _with_bounds(vehicle: Vehicle, boxes: Mapping[str, tuple[float, float]]) -> Vehicle:
    return vehicle.with_numbers({name: {"bounds": box} for name, box in boxes.items()})


def _remarks(boxes: Mapping[str, tuple[float, float]], held: Mapping[str, float]) -> dict[str, Notice]:
    """Return a notice of each box that was widened, with the bound that held its estimate."""
    return {n: notice("bounds-widened", n, bound=held[n], low=a, high=b) for n, (a, b) in boxes.items()}


BOUNDS = Decision(NAME, "Do estimates reach bounds that the file does not give?", around=widen)

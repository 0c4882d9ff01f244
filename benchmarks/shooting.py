"""Multiple shooting: all windows of a piece side by side, against a call per window."""

from __future__ import annotations

import numpy as np

from benchmarks.clock import interleave, ratio
from benchmarks.table import Row
from stoop.estimate.fit import Options, estimation_problem
from stoop.estimate.linearization import perturbations_of
from stoop.estimate.shooting_windows import Shots
from stoop.problem import Misfit
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import load_vehicle
from stoop.workflow import demo

PART = "shooting"
LENGTH = 0.5  #: s of a window
SECONDS = 60.0
ROUNDS = 5
MANEUVER = """
duration = 60.0
rate = 100.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 1.0
step = 0.5
amplitude = 0.02
"""


def run() -> list[Row]:
    """Fly and differentiate the windows of a minute."""
    windows = Shots.of(_problem(), 0, LENGTH)
    nodes = windows.measured_nodes()
    z = np.concatenate([np.full(windows.problem.dimension, 0.5), np.zeros(windows.problem.extra)])
    taken = interleave(
        {
            "flown": lambda: windows.simulate(z, nodes),
            "flown apart": lambda: _flown_one_by_one(windows, z, nodes),
            "together": lambda: windows.linearize(z, nodes),
            "apart": lambda: _one_by_one(windows, z, nodes),
        },
        ROUNDS,
    )
    size = f"{windows.count} windows, {len(z)} unknowns, {len(windows.piece.time)} samples"
    return [
        Row(PART, "all windows flown", 1e3 * float(np.median(taken["flown"])), "ms", note=size),
        Row(PART, "over one call per window", ratio(taken["flown"], taken["flown apart"]), at_most=1.0),
        Row(PART, "their derivatives", 1e3 * float(np.median(taken["together"])), "ms", note=size),
        Row(PART, "over one call per window", ratio(taken["together"], taken["apart"]), at_most=1.0),
    ]


def _flown_one_by_one(windows: Shots, z: np.ndarray, nodes: np.ndarray) -> None:
    rows, _ = windows.problem.candidates(z[None, :], windows.index)
    for w in range(windows.count):
        windows.integrate(rows, np.ascontiguousarray(nodes[:, w : w + 1]), np.array([w]))


def _one_by_one(windows: Shots, z: np.ndarray, nodes: np.ndarray) -> None:
    inverse, entries = perturbations_of(windows.vehicle, nodes[:, 1:].copy()), np.arange(len(z))
    for w in range(windows.count):
        windows.linearize_some(z, nodes, inverse, range(w, w + 1), entries)


def _problem() -> Misfit:
    aircraft = load_vehicle("twin-boom")
    flight = simulate_flight(aircraft, parse_maneuver(MANEUVER, "minute"), seed=1, name="minute")
    vehicle = demo.misled(aircraft, 1)
    return estimation_problem(vehicle, {"minute": flight}, [Window("minute", 0.0, SECONDS)], Options())[0]

"""The paper's longitudinal problem with the search that ships, and with the paper's own optimizers.

Ten coefficients of Table 1, six channels, 1500 samples at 50 Hz, the elevator of Fig. 3; cost in trajectories
of the whole record (a third of it counts a third). The boxes are those of the prototype's ``problem.py``: the
truth lies somewhere in each, never on purpose in its middle. No starting values, priors or equation-error
estimate; the first measurement is the trivial model whose cost is J0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.table import Row
from stoop import optimize
from stoop.cli.demo import MANEUVER, TABLE_1
from stoop.cost import Layout, Misfit, Piece, Weights
from stoop.cost.misfit import horizon_ladder
from stoop.optimize.ledger import blank
from stoop.simulate import parse_maneuver
from stoop.simulate.fly import Flown, fly
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

FloatArray = NDArray[np.float64]

PART = "paper"
SEEDS = 100
SEEDS_OF_POPULATIONS = 20
SAMPLES = 1500
SIGMA = np.array([0.3, 0.005, 0.005, 0.005, 0.05, 0.10])  #: V, alpha, q, theta, ax, az; SI
ASKED = {"N": 15.0, "W": 20.0}  #: mean trajectories to the target
PROTOTYPE = {
    ("ps-gde", "N"): 5752, ("ps-gde", "W"): 9538, ("de-best-2-bin", "N"): 5320, ("de-best-2-bin", "W"): 9242,
}  # fmt: skip
NEAR = 1e-6  #: of J0 without noise; of the maximum-likelihood cost with it
WRONG = 1e-3  #: an end above the optimum by more than this share is another optimum
BUDGET = 3000.0
PATIENT = optimize.Settings(iterations=200, gain=1e-14, predicted=1e-14, stall=0, stall_damping=np.inf)


@dataclass(frozen=True)
class Paper:
    """The vehicle and its flight."""

    vehicle: Vehicle
    flown: Flown

    @property
    def truth(self) -> FloatArray:
        """The ten coefficients."""
        return np.array([self.vehicle.value(n) for n in TABLE_1])

    def problem(self, kind: str, seed: int, noise: bool) -> Misfit:
        """Pose the least-squares problem of one box."""
        low, high = box(kind, seed, self.truth)
        bounds = {
            n: {"free": True, "bounds": (a, b), "value": (a + b) / 2.0}
            for n, a, b in zip(TABLE_1, low.tolist(), high.tolist(), strict=True)
        }
        others = {p.name: {"free": False} for p in self.vehicle.parameters if p.name not in TABLE_1}
        measured = self.flown.outputs[:SAMPLES]
        if noise:
            measured = measured + SIGMA * np.random.default_rng(seed).standard_normal(measured.shape)
        trim = self.flown.trim
        piece = Piece(
            0, self.flown.time[:SAMPLES], self.flown.inputs[:SAMPLES], measured, trim.start, trim.changes
        )
        layout = Layout.of(self.vehicle.with_numbers(others | bounds), ())
        return Misfit(layout, (piece,), Weights.of(SIGMA**2), horizon_ladder([piece]))

    def optimum(self, problem: Misfit) -> float:
        """Return the least cost about the truth: of the truth itself without noise, else by a dive from it."""
        names = [p.name for p in problem.layout.parameters]
        z = problem.layout.unit(np.array([self.vehicle.value(n) for n in names]))
        ledger = optimize.Ledger(problem, blank(problem))
        return optimize.dive(ledger, z, len(problem.prices) - 1, PATIENT).cost


def box(kind: str, seed: int, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return bounds: N is as wide as each value, W eight times, S begins or ends at zero (sign known)."""
    rng, size = np.random.default_rng(10_000 + seed), np.abs(truth)
    if kind == "S":
        far = rng.uniform(2.0, 8.0, len(truth)) * truth
        return np.minimum(0.0, far), np.maximum(0.0, far)
    width = size if kind == "N" else 8.0 * size
    low = truth - rng.uniform(0.1, 0.9, len(truth)) * width
    return low, low + width


@dataclass(frozen=True)
class Tally:
    """What many seeds took, and how many ended elsewhere."""

    trajectories: FloatArray
    missed: int

    @property
    def words(self) -> str:
        """Median, largest, and how many seeds."""
        t = self.trajectories
        return f"median {np.median(t):.1f}, largest {t.max():.1f}, {len(t)} seeds"


def run() -> list[Row]:
    """Search every box."""
    vehicle = resolve_vehicle("twin-boom").reduced("longitudinal")
    paper = Paper(vehicle, fly(vehicle, parse_maneuver(MANEUVER, "paper")))
    rows = [row for kind in ("N", "W", "S") for row in _noise_free(paper, kind)]
    rows += [row for kind in ("N", "W") for row in _noisy(paper, kind)]
    return rows + [_population(paper, name, kind) for name, kind in PROTOTYPE]


def _noise_free(paper: Paper, kind: str) -> Iterator[Row]:
    """Search to J <= 1e-6 J0, and once more until the search itself says that it is done."""
    asked = ASKED.get(kind)
    never = None if asked is None else 0.0
    tally = _search(paper, kind, to_target=True)
    yield Row(
        PART, f"box {kind}: mean trajectories to 1e-6 J0", _mean(tally), at_most=asked, note=tally.words
    )
    yield Row(PART, f"box {kind}: did not get there", tally.missed, at_most=never)
    tally = _search(paper, kind, to_target=False)
    yield Row(PART, f"box {kind}: mean trajectories until confirmed", _mean(tally), note=tally.words)
    yield Row(PART, f"box {kind}: ended in a wrong optimum", tally.missed, at_most=never)


def _noisy(paper: Paper, kind: str) -> Iterator[Row]:
    """Search to the maximum-likelihood cost, and until the search itself says that it is done."""
    to = f"box {kind}, 1-sigma noise"
    tally = _search(paper, kind, to_target=True, noise=True)
    yield Row(PART, f"{to}: mean trajectories to the ML cost", _mean(tally), note=tally.words)
    yield Row(PART, f"{to}: did not get there", tally.missed)
    tally = _search(paper, kind, to_target=False, noise=True)
    yield Row(PART, f"{to}: mean trajectories until confirmed", _mean(tally), note=tally.words)
    yield Row(PART, f"{to}: ended in a wrong optimum", tally.missed, at_most=0.0)


def _mean(tally: Tally) -> float:
    return float(tally.trajectories.mean())


def _search(paper: Paper, kind: str, *, to_target: bool, noise: bool = False) -> Tally:
    """Run the default search on every seed of a box, to the target or to its own end."""
    spent, missed = [], 0
    for seed in range(SEEDS):
        problem = paper.problem(kind, seed, noise)
        optimum = paper.optimum(problem) if noise else 0.0
        slack = NEAR * (optimum if noise else problem.reference(len(problem.prices) - 1))
        near = optimum + slack if to_target or not noise else optimum * (1.0 + WRONG)
        stop = optimize.Stop(budget=BUDGET, target_cost=near if to_target else -np.inf)
        outcome = optimize.minimize(optimize.create(), problem, seed=seed, stop=stop)
        spent.append(outcome.trajectories)
        missed += not outcome.cost <= near
    return Tally(np.array(spent), missed)


def _population(paper: Paper, name: str, kind: str) -> Row:
    """Run an optimizer without dives on a box to J <= 1e-6 J0."""
    spent = []
    for seed in range(SEEDS_OF_POPULATIONS):
        problem = paper.problem(kind, seed, noise=False)
        target = NEAR * problem.reference(len(problem.prices) - 1)
        stop = optimize.Stop(generations=10**6, budget=60_000.0, target_cost=target)
        outcome = optimize.minimize(optimize.create(name), problem, seed=seed, stop=stop)
        spent.append(outcome.trajectories if outcome.status == "target" else np.inf)
    note = f"{SEEDS_OF_POPULATIONS} seeds, to 1e-6 J0; the prototype took {PROTOTYPE[name, kind]}"
    return Row(PART, f"{name}, box {kind}: median trajectories", float(np.median(spent)), note=note)

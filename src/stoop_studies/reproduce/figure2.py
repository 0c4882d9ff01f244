"""Figure 2: local search along the negative gradient, on a picture of the cost, and the pseudo-code as printed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize import Ledger
from stoop.optimize.ledger import Evaluations
from stoop.report.plots import Mark, Series, contour_plot, plot
from stoop.report.sheet import Code, Figure, Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number
from stoop_studies.optimizers.local_search import (
    BETA,
    SteepestDescent,
    golden_section,
    steepest_line,
)
from stoop_studies.problems.paper import Paper, paper
from stoop_studies.reproduce.suite import PaperExperiment, tabulated

PAIR: Final = ("CLalpha", "Cmalpha")
LOW: Final = (3.2, -3.2)
HIGH: Final = (6.4, -1.2)
START: Final = (0.20, 0.80)  #: in the unit box
NEAR_END: Final = (0.45, 0.55)  #: a place near the truth
CHAIN: Final = 20  #: local searches in a row
DRAWN: Final = 4  #: of them
NEAR: Final = 0.05  #: of the unit box, about the truth: where the best members of a late population are
GRID: Final = 61
REACH: Final = 0.1
TOLERANCE: Final = 0.1  #: relative to the reach
LINES: Final = 41
PLACES: Final = {"from anywhere": 1.0, "near the optimum": NEAR}
LEAD: Final = """\
The paper's local search takes one step along the negative gradient of the cost, as far as a golden-section search \
says. Here it is drawn on the cost over two of the ten coefficients, the other eight at their true values, with every \
evaluation: those of the forward differences, and those along each line."""
PRINTED_CODE: Final = """\
i2 = a + beta (b - a), f2 = f(i2)
i1 = a + b - i2,       f1 = f(i1)
while |i1 - i2| >= epsilon
    if f1 <= f2:  b = i2, i2 = i1, f2 = f1         <- i1 is not moved, f1 not evaluated
    else:         a = i1, i1 = i2, f1 = f2, i2 = a + beta (b - a), f2 = f(i2)
return (i1 + i2) / 2"""
WORDS: Final = """\
As printed, the first branch sets i2 to i1 and leaves i1 where it is. The two then coincide, the loop ends, and i1 \
is the answer, however far from the minimum: whenever the lower half of the line is the better one, the search stops \
at the next point. The repaired search moves i1 to a + b - i2 and evaluates it."""


Function = Callable[[float], float]


@dataclass(frozen=True)
class LineSearch:
    """A search along a line.

    Attributes
    ----------
    end : float
        Distance at its end.
    cost : float
        There.
    points : (k,)
        What it evaluated, in order.
    """

    end: float
    cost: float
    points: FloatArray


@dataclass(frozen=True)
class Pair:
    """One line, searched both ways.

    Attributes
    ----------
    cost : float
        At its beginning.
    repaired, printed : LineSearch
    """

    cost: float
    repaired: LineSearch
    printed: LineSearch

    def gain(self, line: LineSearch) -> float:
        """Return the share of the cost that a search takes away; none where its end is refused as worse."""
        return max(0.0, 1.0 - line.cost / self.cost)


@dataclass
class Recorder:
    """The problem on the full record, with all points that were evaluated."""

    case: Paper
    points: list[FloatArray] = field(default_factory=list)

    def __post_init__(self) -> None:
        layout = self.case.bounded(np.array(LOW), np.array(HIGH))
        self.problem = self.case.misfit(layout, self.case.measured(0, noise=False))
        self.full = len(self.problem.prices) - 1
        self.dimension, self.extra, self.prices = 2, 0, (1.0,)

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the costs (B,) of X (B, 2) in the order of `PAIR`."""
        self.points.extend(X)
        return self.problem.costs(X, self.full)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return the residuals."""
        return self.problem.residuals(Z, self.full)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return the Jacobian."""
        return self.problem.jacobian(z, self.full, r)

    def reference(self, rung: int) -> float:
        """Return the trivial model's cost."""
        return self.problem.reference(self.full)


@dataclass(frozen=True)
class End:
    """End of one of a chain of searches: in the unit box (2,), its cost, evaluations so far."""

    x: FloatArray
    cost: float
    evaluations: int


class Figure2(PaperExperiment):
    """Local search along the gradient."""

    name, runs = "figure2", 100

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return the picture, and what the printed pseudo-code does on the same lines."""
        recorder = Recorder(replace(paper(), names=PAIR))
        ends = chain(recorder, np.array(START))
        evaluated = np.array(recorder.points)
        found = {where: lines(recorder, setting.seeds, reach) for where, reach in PLACES.items()}
        ends_table = tabulated(
            "Where dives end",
            {
                "dive": lambda i: str(i),
                PAIR[0]: lambda i: number(float(_physical(ends[i].x)[0]), 5),
                PAIR[1]: lambda i: number(float(_physical(ends[i].x)[1]), 5),
                "J": lambda i: number(ends[i].cost, 4),
                "evaluations so far": lambda i: str(ends[i].evaluations),
            },
            [i for i in range(len(ends)) if i <= DRAWN or i % 5 == 0],
        )
        code = (Code(PRINTED_CODE), Prose(WORDS), _profile(recorder), _table(found))
        return Findings(
            "Figure 2: golden section along the negative gradient",
            LEAD,
            _claims(found, ends),
            (
                Section("On a picture of the cost", (_picture(recorder, ends, evaluated), ends_table)),
                Section("The pseudo-code as printed", code),
            ),
            ("dive", *PAIR, "J", "evaluations_so_far"),
            tuple((i, *_physical(e.x).tolist(), e.cost, e.evaluations) for i, e in enumerate(ends)),
        )


def chain(recorder: Recorder, x: FloatArray) -> list[End]:
    """Search again and again from the end of the last search."""
    ledger = Ledger(recorder, Evaluations.none(recorder))
    cost = float(ledger.costs(x[None], 0)[0])
    ends = [End(x, cost, 1)]
    for _ in range(CHAIN):
        x, cost = SteepestDescent(REACH, TOLERANCE)(ledger, x, cost)
        ends.append(End(x, cost, len(recorder.points)))
    return ends


def lines(recorder: Recorder, seeds: range, reach: float) -> list[Pair]:
    """Search one line per seed, from a random place within ``reach`` of the truth in each variable."""
    low, high = np.array(LOW), np.array(HIGH)
    middle = (recorder.case.truth - low) / (high - low)
    steps = [reach * np.random.default_rng(seed).uniform(-1.0, 1.0, 2) for seed in seeds]
    pairs = [both(recorder, np.clip(middle + step, 0.0, 1.0)) for step in steps]
    return [pair for pair in pairs if pair is not None]


def both(recorder: Recorder, x: FloatArray) -> Pair | None:
    """Search the line down the gradient from x, as repaired and as printed; None without a gradient."""
    along = cost_along(recorder, x)
    if along is None:
        return None
    return Pair(along(0.0), searched(along, golden_section), searched(along, printed_section))


def cost_along(recorder: Recorder, x: FloatArray) -> Function | None:
    """Return the cost along the unit negative gradient from x, by the distance."""
    ledger = Ledger(recorder, Evaluations.none(recorder))
    line = steepest_line(ledger, x, float(ledger.costs(x[None], 0)[0]))
    if line is None:
        return None
    return lambda t: float(ledger.costs(line(t)[None], 0)[0])


def searched(function: Function, section: Callable[[Function, float, float, float], float]) -> LineSearch:
    """Search [0, `REACH`] by a golden section."""
    points: list[float] = []

    def recorded(t: float) -> float:
        points.append(t)
        return function(t)

    end = section(recorded, 0.0, REACH, TOLERANCE * REACH)
    return LineSearch(end, function(end), np.array(points))


def printed_section(function: Function, low: float, high: float, tolerance: float) -> float:
    """Return the end of the golden section as printed: its first branch moves and evaluates no new point."""
    right = low + BETA * (high - low)
    left = low + high - right
    f_right, f_left = function(right), function(left)
    while abs(left - right) >= tolerance:
        if f_left <= f_right:
            high, right, f_right = right, left, f_left
        else:
            low, left, f_left = left, right, f_right
            right = low + BETA * (high - low)
            f_right = function(right)
    return 0.5 * (left + right)


def _claims(found: Mapping[str, list[Pair]], ends: list[End]) -> tuple[Claim, ...]:
    close = found["near the optimum"]
    early = [sum(len(p.printed.points) < len(p.repaired.points) for p in pairs) for pairs in found.values()]
    repaired = float(np.median([p.gain(p.repaired) for p in close]))
    printed = float(np.median([p.gain(p.printed) for p in close]))
    reached = next((e for e in ends if e.cost < 1e-6 * ends[0].cost), None)
    return (
        holds(
            "The pseudo-code as printed ends its search before the interval is small",
            min(early) > 0,
            ", ".join(
                f"{n} of {len(pairs)} lines {where}"
                for n, (where, pairs) in zip(early, found.items(), strict=True)
            ),
        ),
        holds(
            "Near the optimum, where the best members are, the repaired search brings more",
            repaired > printed,
            f"median gain {100 * repaired:.1f} % of the cost against {100 * printed:.1f} %",
        ),
        holds(
            f"{CHAIN} dives in a row reach the optimum (1e-6 of the cost that they start from)",
            reached is not None,
            f"{number(ends[0].cost)} falls to {number(ends[-1].cost)} in {ends[-1].evaluations} evaluations",
        ),
    )


def _physical(points: FloatArray) -> FloatArray:
    low, high = np.array(LOW), np.array(HIGH)
    return np.asarray(low + points * (high - low))


def _picture(recorder: Recorder, ends: list[End], evaluated: FloatArray) -> Figure:
    axis = np.linspace(0.0, 1.0, GRID)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    values = recorder.problem.costs(places, recorder.full).reshape(GRID, GRID)
    drawn = ends[: DRAWN + 1]
    trail, points = _physical(np.array([e.x for e in drawn])), _physical(evaluated[: drawn[-1].evaluations])
    x, y = _physical(np.column_stack([axis, axis])).T
    drawing = contour_plot(
        x,
        y,
        np.log10(np.maximum(values, 1e-12)),
        trail,
        [
            *(Mark("evaluated", *map(float, p)) for p in points),
            Mark("start", *map(float, trail[0])),
            Mark("truth", *map(float, recorder.case.truth)),
        ],
        *PAIR,
        "Lines of equal cost over two coefficients with a chain of dives",
    )
    return Figure(
        f"log J over {PAIR[0]} and {PAIR[1]}, and the first {DRAWN} of {CHAIN} dives in a row", drawing
    )


def _profile(recorder: Recorder) -> Figure:
    x = np.array(NEAR_END)
    along, pair = cost_along(recorder, x), both(recorder, x)
    assert along is not None and pair is not None  # noqa: S101, PT018 - this place is not an optimum
    t = np.linspace(0.0, REACH, LINES)
    drawing = plot(
        [
            Series("cost along the line", t, np.array([along(v) for v in t])),
            Series("evaluated, repaired", pair.repaired.points, np.array([along(v) for v in pair.repaired.points]), "points"),
            Series("end, repaired", np.array([pair.repaired.end]), np.array([pair.repaired.cost]), "points"),
            Series("end, as printed", np.array([pair.printed.end]), np.array([pair.printed.cost]), "points"),
        ],
        "distance in the unit box", "J", "Cost along one line near the optimum",
    )  # fmt: skip
    return Figure("A line from a place near the optimum", drawing)


def _table(found: Mapping[str, list[Pair]]) -> Table:
    searches = {
        f"{name}, {where}": [(pair, getattr(pair, attribute)) for pair in pairs]
        for where, pairs in found.items()
        for name, attribute in (("repaired", "repaired"), ("as printed", "printed"))
    }
    gains = {name: np.array([p.gain(line) for p, line in chosen]) for name, chosen in searches.items()}
    return tabulated(
        "Lines from random places; a worse end is refused, and gains nothing",
        {
            "search": lambda name: name,
            "median gain": lambda name: f"{100 * np.median(gains[name]):.1f} %",
            "mean gain": lambda name: f"{100 * gains[name].mean():.1f} %",
            "lines with a gain": lambda name: f"{100 * np.mean(gains[name] > 0):.0f} %",
            "evaluations on the line": lambda name: (
                f"{np.mean([len(line.points) + 1 for _, line in searches[name]]):.1f}"
            ),
        },
        searches,
    )

"""Figure 2: local search along the negative gradient, on a picture of the cost, and the pseudo-code as printed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize import Ledger, ScalarProblem
from stoop.optimize.ledger import Evaluations
from stoop.report.plots import contour_plot, plot
from stoop.report.series import Mark, Series
from stoop.report.sheet import Figure, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number, tabulated
from stoop_studies.optimizers.local_search import BETA, SteepestDescent, golden_section, steepest_line
from stoop_studies.problems.paper import Paper, paper
from stoop_studies.reproduce.suite import PaperExperiment

PAIR: Final = ("CLalpha", "Cmalpha")
LOW: Final = np.array((3.2, -3.2))
HIGH: Final = np.array((6.4, -1.2))
CHAIN: Final = 20  #: local searches in a row
DRAWN: Final = 4  #: of them
REACH: Final = 0.1
TOLERANCE: Final = 0.1  #: relative to the reach
#: of the unit box, about the truth; near it are the best members of a late population
PLACES: Final = {"from anywhere": 1.0, "near the optimum": 0.05}
Function = Callable[[float], float]


class Recorder(ScalarProblem):
    """The cost over `PAIR` on the full record, with all points that were evaluated."""

    dimension = 2

    def __init__(self, case: Paper) -> None:
        self.case, self.points = case, list[FloatArray]()
        self.problem = case.misfit(case.bounded(LOW, HIGH), case.measured(0, noise=False))
        self.full = len(self.problem.prices) - 1

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the costs (B,) of X (B, 2) in the order of `PAIR`."""
        self.points.extend(X)
        return self.problem.costs(X, self.full)

    def along(self, x: FloatArray) -> Function | None:
        """Return the cost along the unit negative gradient from x, by the distance; None without a gradient."""
        ledger = Ledger(self, Evaluations.none(self))
        line = steepest_line(ledger, x, float(ledger.costs(x[None], 0)[0]))
        return None if line is None else lambda t: float(ledger.costs(line(t)[None], 0)[0])


@dataclass(frozen=True)
class LineSearch:
    """A search along a line: costs at its beginning and end, distance of its end, and what it evaluated, (k,), in order."""

    start: float
    cost: float
    end: float
    points: FloatArray

    @property
    def gain(self) -> float:
        """Share of the cost that it takes away; none where its end is refused as worse."""
        return max(0.0, 1.0 - self.cost / self.start)


def both(recorder: Recorder, x: FloatArray) -> dict[str, LineSearch]:
    """Search the line down the gradient from x, as repaired and as printed; empty without a gradient."""
    along = recorder.along(x)
    if along is None:
        return {}
    return {name: searched(along, section) for name, section in SECTIONS.items()}


def searched(function: Function, section: Callable[[Function, float, float, float], float]) -> LineSearch:
    """Search [0, `REACH`] by a golden section."""
    points: list[float] = []

    def recorded(t: float) -> float:
        points.append(t)
        return function(t)

    start, end = function(0.0), section(recorded, 0.0, REACH, TOLERANCE * REACH)
    return LineSearch(start, function(end), end, np.array(points))


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


SECTIONS: Final = {"repaired": golden_section, "as printed": printed_section}
Found = Mapping[str, Mapping[str, list[LineSearch]]]  #: section -> where from -> lines


class Figure2(PaperExperiment):
    """Local search along the gradient."""

    name, runs = "figure2", 100

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return the picture, and what the printed pseudo-code does on the same lines."""
        recorder = Recorder(replace(paper(), names=PAIR))
        # a chain of searches: end in physical values, cost and evaluations so far
        ledger, x = Ledger(recorder, Evaluations.none(recorder)), np.array((0.20, 0.80))
        cost = float(ledger.costs(x[None], 0)[0])
        ends = [(*_physical(x).tolist(), cost, 1)]
        for _ in range(CHAIN):
            x, cost = SteepestDescent(REACH, TOLERANCE)(ledger, x, cost)
            ends.append((*_physical(x).tolist(), cost, len(recorder.points)))
        picture = _picture(recorder, ends)
        middle = (recorder.case.truth - LOW) / (HIGH - LOW)
        found: dict[str, dict[str, list[LineSearch]]] = {name: {} for name in SECTIONS}
        for where, reach in PLACES.items():
            steps = [reach * np.random.default_rng(seed).uniform(-1.0, 1.0, 2) for seed in setting.seeds]
            pairs = [both(recorder, np.clip(middle + step, 0.0, 1.0)) for step in steps]
            for name, lines in found.items():
                lines[where] = [pair[name] for pair in pairs if pair]
        figures = (picture, _profile(recorder), _table(found))
        head = ("search", *PAIR, "J", "evaluations_so_far")
        rows = [dict(zip(head, (i, *end), strict=True)) for i, end in enumerate(ends)]
        title = "Figure 2: golden section along the negative gradient"
        return Findings.of(title, _claims(found, ends), rows, figures=figures)


def _claims(found: Found, ends: list[tuple[float, float, float, int]]) -> tuple[Claim, ...]:
    (*_, first, _), (*_, last, evaluations) = ends[0], ends[-1]
    repaired, printed = found.values()
    early = {
        where: sum(
            len(p.points) < len(r.points) for p, r in zip(printed[where], repaired[where], strict=True)
        )
        for where in PLACES
    }
    gains = [float(np.median([line.gain for line in lines["near the optimum"]])) for lines in found.values()]
    return (
        holds(
            "The pseudo-code as printed ends its search before the interval is small",
            min(early.values()) > 0,
            ", ".join(f"{n} of {len(printed[where])} lines {where}" for where, n in early.items()),
        ),
        holds(
            "Near the optimum, where the best members are, the repaired search brings more",
            gains[0] > gains[1],
            f"median gain {100 * gains[0]:.1f} % of the cost against {100 * gains[1]:.1f} %",
        ),
        holds(
            f"{CHAIN} local searches in a row reach the optimum (1e-6 of the cost that they start from)",
            any(cost < 1e-6 * first for _, _, cost, _ in ends),
            f"{number(first)} falls to {number(last)} in {evaluations} evaluations",
        ),
    )


def _physical(points: FloatArray) -> FloatArray:
    return np.asarray(LOW + points * (HIGH - LOW))


def _picture(recorder: Recorder, ends: list[tuple[float, float, float, int]]) -> Figure:
    axis = np.linspace(0.0, 1.0, 61)
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    values = recorder.problem.costs(places, recorder.full).reshape(len(axis), len(axis))
    trail = np.array([end[:2] for end in ends[: DRAWN + 1]])
    points = _physical(np.array(recorder.points)[: ends[DRAWN][3]])
    x, y = _physical(np.column_stack([axis, axis])).T
    named = [("evaluated", p) for p in points] + [("start", trail[0]), ("truth", recorder.case.truth)]
    marks = [Mark(name, float(a), float(b)) for name, (a, b) in named]
    caption = "Lines of equal cost over two coefficients with a chain of local searches"
    drawing = contour_plot(x, y, np.log10(np.maximum(values, 1e-12)), trail, marks, *PAIR, caption)
    words = f"log J over {PAIR[0]} and {PAIR[1]}, and the first {DRAWN} of {CHAIN} local searches in a row"
    return Figure(words, drawing)


def _profile(recorder: Recorder) -> Figure:
    x = np.array((0.45, 0.55))
    along, pair = recorder.along(x), both(recorder, x)
    assert along is not None  # noqa: S101 - this place is not an optimum
    t, points = np.linspace(0.0, REACH, 41), pair["repaired"].points
    curves = [
        Series("cost along the line", t, np.array([along(v) for v in t])),
        Series("evaluated, repaired", points, np.array([along(v) for v in points]), "points"),
        *(
            Series(f"end, {name}", np.array([line.end]), np.array([line.cost]), "points")
            for name, line in pair.items()
        ),
    ]
    drawing = plot(curves, "distance in the unit box", "J", "Cost along one line near the optimum")
    return Figure("A line from a place near the optimum", drawing)


def _table(found: Found) -> Table:
    searches = {f"{name}, {where}": found[name][where] for where in PLACES for name in found}
    gains = {name: np.array([line.gain for line in lines]) for name, lines in searches.items()}
    counts = {name: [len(line.points) + 1 for line in lines] for name, lines in searches.items()}
    return tabulated(
        "Lines from random places; a worse end is refused, and gains nothing",
        {
            "search": lambda name: name,
            "median gain": lambda name: f"{100 * np.median(gains[name]):.1f} %",
            "mean gain": lambda name: f"{100 * gains[name].mean():.1f} %",
            "lines with a gain": lambda name: f"{100 * np.mean(gains[name] > 0):.0f} %",
            "evaluations on the line": lambda name: f"{np.mean(counts[name]):.1f}",
        },
        searches,
    )

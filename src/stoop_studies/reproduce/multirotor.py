"""GA, PSO, PS-GDE and the default on the multirotor that the paper's title promises: a quadrotor, a real hexacopter."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.base.numbers import finite_or_none
from stoop.estimate.fit import Options
from stoop.estimate.multiple_shooting import MultipleShooting
from stoop.parallel import Run
from stoop.problem.windows import Window
from stoop.report.sheet import Prose
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number
from stoop_studies.problems import pose
from stoop_studies.problems.multirotor import LENGTH, MANEUVER, NOISE, quad
from stoop_studies.reproduce.suite import (
    EXACT,
    METHODS,
    SUCCESS,
    Group,
    PaperExperiment,
    Searches,
    bound_deviations,
    percent,
    rms,
)
from stoop_studies.reproduce.table1 import ITERATIONS, order_of_errors

PROBLEM: Final = "multirotor"
STOPS: Final = {"clean": ITERATIONS, "noise": ITERATIONS[-1:], "real": (100, 200)}  #: iterations of each case
QUADROTOR: Final = "quadrotor"  #: name of its flight
NOISY_BOX: Final = "S"  #: begins at zero: the bounds of box N would cut the scatter off
CSV: Final[dict[str, Callable[[Case, Group], Cell]]] = {
    "case": lambda case, g: case.name,
    "method": lambda case, g: METHODS[g.method],
    "iterations": lambda case, g: g.iterations,
    "runs": lambda case, g: len(g.costs),
    "reached_target": lambda case, g: g.reached,
    "within_1e-2": lambda case, g: g.within(SUCCESS) if case.known else None,
    "within_1e-6": lambda case, g: g.within(EXACT) if case.known else None,
    "mean_error": lambda case, g: g.mean_error if case.known else None,
    "median_fitness": lambda case, g: g.median_cost,
    "worst_fitness": lambda case, g: float(g.costs.max()),
    "median_evaluations_to_target": lambda case, g: finite_or_none(g.median_hit),
    "mean_evaluations": lambda case, g: float(g.evaluations.mean()),
}


@dataclass(frozen=True, eq=False)
class Case:
    """One of the three problems."""

    name: str  #: ``clean``, ``noise`` or ``real``
    parameters: tuple[str, ...]
    values: FloatArray  #: (D,), the truth; of the real flight the values of least cost in any run
    #: (D,), standard deviation that noise must cause (Cramer-Rao); of the real flight the standard error
    sigma: FloatArray
    groups: dict[str, list[Group]]  #: method -> its runs by iterations

    @property
    def known(self) -> bool:
        """Whether the truth is known."""
        return self.name != "real"

    @property
    def every(self) -> list[Group]:
        """All groups, method by method."""
        return [g for groups in self.groups.values() for g in groups]

    def last(self, method: str) -> Group:
        """Return the group of one method with the most iterations."""
        return self.groups[method][-1]


class Multirotor(PaperExperiment):
    """The paper's comparison, on multirotors."""

    name, runs, parts = PROBLEM, 20, ("parameters",)

    def searches(self, setting: Setting) -> list[Run]:
        """Return every case, method, seed and number of iterations."""
        return [run for case in cases(setting) for run in _searches(case, setting).runs()]

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        by_case = {case: _case(case, setting, results) for case in cases(setting)}
        noisy, real = by_case["noise"], by_case.get("real")
        shot = shots(setting.seeds, NOISY_BOX, noisy.parameters) / noisy.values - 1.0
        clean, errors = by_case["clean"], rms(np.abs(shot))
        title = f"Multirotors: a simulated quadrotor, box {setting.box}, and a real hexacopter"
        rows = [{name: cell(c, g) for name, cell in CSV.items()} for c in by_case.values() for g in c.every]
        words = "The real hexacopter was left out: name the folder of its log by --data DIR."
        left_out = (Prose(words),) if real is None else ()
        parts = {"parameters": list(_parameters(by_case, errors))}
        return Findings.of(title, _claims(clean, noisy, real, errors), rows, parts, figures=left_out)


def cases(setting: Setting) -> tuple[str, ...]:
    """Return what is run: the real flight only where its data is."""
    return ("clean", "noise") if setting.data is None else ("clean", "noise", "real")


def seeds(case: str, setting: Setting) -> range:
    """Return the seeds of a case: half as many on the real flight, whose trajectories cost fifty times as much."""
    return setting.seeds if case != "real" else setting.seeds[: (setting.runs + 1) // 2]


def _searches(case: str, setting: Setting) -> Searches:
    """Return the searches of a case."""
    problem, arguments = {
        "clean": (PROBLEM, {"box": setting.box}),
        "noise": (f"{PROBLEM}+noise", {"box": NOISY_BOX}),
        "real": ("hexacopter", {"data": str(setting.data)}),
    }[case]
    stops = dict.fromkeys(METHODS, STOPS[case])
    return Searches(case + "/{who}/{seed:06d}/{stop:05d}", problem, seeds(case, setting), stops, arguments)


def _case(name: str, setting: Setting, results: Results) -> Case:
    searches = _searches(name, setting)
    posed = pose(searches.problem, setting.seed, **searches.arguments)
    truth = np.full(len(posed.parameters), np.nan) if posed.truth is None else posed.truth
    groups = searches.groups(results, truth)
    if posed.truth is None:
        best = min((g for own in groups.values() for g in own), key=lambda g: float(g.costs.min()))
        truth = best.values[int(np.argmin(best.costs))]
        groups = searches.groups(results, truth)
    return Case(name, posed.parameters, truth, bound_deviations(posed, truth), groups)


@functools.cache
def shot(seed: int, box: str) -> dict[str, float]:
    """Return estimates of multiple shooting from the flight with the noise and the box of this seed, from its center.

    The noisy flights of the other methods, by the method of `stoop identify`: states are estimated too.
    """
    case = quad()
    noise = "\n".join(["[noise]", *(f"{c} = {s}" for c, s in NOISE.items())])
    flight = simulate_flight(
        case.vehicle, parse_maneuver(f"{MANEUVER}\n{noise}\n", QUADROTOR), seed, name=QUADROTOR
    )
    window = Window(QUADROTOR, 0.0, float(flight.time[-1]))
    known = Options(seed=seed, covariance=np.diag(case.sigma**2))
    return MultipleShooting(LENGTH)(case.boxed(box, seed), {QUADROTOR: flight}, [window], known).estimates


def shots(seeds: range, box: str, parameters: tuple[str, ...]) -> FloatArray:
    """Return the same (n, D) of the flights of several seeds."""
    found = [shot(seed, box) for seed in seeds]
    return np.array([[one[name] for name in parameters] for one in found])


def _claims(clean: Case, noisy: Case, real: Case | None, shot: FloatArray) -> Iterator[Claim]:
    """Give every statement with its verdict; `shot` are the root mean square errors, (D,), of multiple shooting."""
    three = [clean.groups[m] for m in ("GA", "PSO", "PS-GDE")]
    yield order_of_errors(three, ", on a quadrotor as on the paper's airplane", "; ")
    for method, limit, words in (("PS-GDE", SUCCESS, "1 %"), ("default", EXACT, "1e-6")):
        groups = clean.groups[method]
        many, whole = sum(g.within(limit) for g in groups), sum(len(g.costs) for g in groups)
        yield holds(
            f"{method}, without noise: all ten values within {words} in every run, at every number of iterations",
            many == whole,
            f"{counted(many, whole)}; largest error {percent(max(float(g.errors.max()) for g in groups))}",
        )
    hits = {m: clean.last(m) for m in METHODS}
    others = [g.median_hit for m, g in hits.items() if m != "default" and g.reached]
    yield holds(
        "The default reaches 1e-6 of J0 with a tenth of the evaluations of any other, or fewer",
        all(hits["default"].median_hit <= 0.1 * other for other in others),
        "median evaluations, and in how many runs: "
        + ", ".join(f"{m} {g.hits_text}" for m, g in hits.items()),
    )
    ends = [(noisy, "with noise", "the optimum, to 1e-6 of J")]
    ends += [] if real is None else [(real, "real flight", "the least J known, to 0.1 %")]
    for case, title, where in ends:
        for method, group in ((m, case.last(m)) for m in METHODS):
            yield holds(
                f"{method}, {title}: ends at {where}, in every run",
                group.reached == len(group.costs),
                f"{counted(group.reached, len(group.costs))} at {group.iterations} iterations, median J "
                f"{number(group.median_cost, 6)}, worst {number(float(group.costs.max()), 6)}",
            )
    theirs = rms(noisy.last("default").errors)
    yield holds(
        "Multiple shooting, which estimates the states of the windows, has smaller errors of all ten on the same flights",
        bool((shot < theirs).all()),
        f"root mean square of all {percent(float(rms(shot)))} instead of {percent(float(rms(theirs)))}; by parameter "
        f"{number(float((shot / theirs).min()), 2)} to {number(float((shot / theirs).max()), 2)} times as large",
    )
    if real is None:
        return
    for method in METHODS:
        ratio = real.last(method).spread / real.sigma
        yield holds(
            f"{method}, real flight: where it ends scatters over seeds by less than a tenth of the standard errors",
            float(ratio.max()) < 0.1,
            f"at most {number(float(ratio.max()), 2)} of the standard error, {real.parameters[int(np.argmax(ratio))]}",
        )


def _parameters(found: Mapping[str, Case], shot: FloatArray) -> Iterator[dict[str, Cell]]:
    """Give a row for each method with the most iterations, and for multiple shooting; deviations are those of the bound."""
    head = (
        "case", "method", "iterations", "parameter", "truth_or_best", "deviation", "mean", "spread", "rms_relative_error",
    )  # fmt: skip

    def record(*cells: Cell) -> dict[str, Cell]:
        return dict(zip(head, cells, strict=True))

    for case in found.values():
        for m, g in ((m, case.last(m)) for m in METHODS):
            columns = (case.values, case.sigma, g.values.mean(axis=0), g.spread)
            for i, name in enumerate(case.parameters):
                error = float(rms(g.errors)[i]) if case.known else None
                yield record(
                    case.name, METHODS[m], g.iterations, name, *(float(c[i]) for c in columns), error
                )
    noisy = found["noise"]
    for name, value, sigma, error in zip(noisy.parameters, noisy.values, noisy.sigma, shot, strict=True):
        known = (float(value), float(sigma), None, None, float(error))
        yield record(noisy.name, "multiple-shooting", None, name, *known)

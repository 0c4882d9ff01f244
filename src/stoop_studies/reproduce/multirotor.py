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
from stoop.report.series import HUES
from stoop.report.sheet import Code, Figure, Prose, Section, Table
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop_studies.findings import (
    Claim,
    Findings,
    Results,
    Setting,
    by_columns,
    counted,
    holds,
    number,
    tabulated,
)
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
from stoop_studies.reproduce.table1 import (
    ITERATIONS,
    SUMMARY,
    by_iterations,
    order_of_errors,
    summary_columns,
)

PROBLEM: Final = "multirotor"
STOPS: Final = {"clean": ITERATIONS, "noise": ITERATIONS[-1:], "real": (100, 200)}  #: iterations of each case
QUADROTOR: Final = "quadrotor"  #: name of its flight
NOISY_BOX: Final = "S"  #: begins at zero: the bounds of box N would cut the scatter off
LEAD: Final = """\
The paper's title promises multirotors, its experiment flies an airplane. Here GA, PSO, PS-GDE and stoop's default \
identify a simulated quadrotor of known truth, without noise and with the noise of the paper's problem, and a real \
hexacopter. Bounds, budget and the cost J = (Z - Y)' Q (Z - Y) of all twelve channels are the same for each. The count \
is that of table 1: one evaluation is one trajectory of the whole record. How the paper's airplane is read, at the end \
of the page, says where boxes, Q and the settings of the optimizers come from."""
OPEN_LOOP: Final = """\
A vehicle on rotors is unstable: simulated open loop it leaves any record after a second or two, whatever the numbers. So \
J is summed over short windows, each of which begins in its measured state, {length}. Nothing else is done for the \
optimizers: no starting values, no equation-error estimate, no states to estimate."""
QUAD: Final = """\
Ten numbers of the built-in quad-x: thrust (T1, T2), torque per thrust, inflow, drag, lag, three inertias and the \
drag of the body along x. The mass is known; without it only ratios would show. Speeds of the motors and the altitude are \
taken as measured exactly. Box N is as wide as each value, the truth lies somewhere in it, drawn with the seed."""
NOISE_WORDS: Final = """\
Windows begin in noisy readings, so that even the truth costs more than noise alone, and errors are larger than the \
bound, which is that of known beginnings. All four minimize the same J: how near they come to its optimum (1e-6, where \
a local refinement from the truth ends) is the optimizer's part, the rest is the cost's. The last column is of the \
same flights, noise and bounds: multiple shooting, the method of stoop identify for vehicles on rotors, estimates the \
states in which windows begin, and the speeds of the motors, too; it starts from the center of the box. Box S begins \
at zero and ends at 2 to 8 times the truth; the sign alone is known."""
REAL_WORDS: Final = """\
140 to 214 s of PX4's log 18: hover, two climbs of 6 m/s and slow descents. Q is what the residuals of a local \
refinement from the file's own values say, colored as they are, and is then held; that refinement is also what counts \
as reached (its J and 0.1 %). No optimizer is given its end. The real flight is run with half the seeds. Motors begin \
where their commands and a lag of 0.05 s put them. Errors behind ± are standard errors at the least J known \
(Cramer-Rao with this Q), and the scatter over seeds of each method. Inertias are what answers the commands within a \
quarter of a second, with arms and torque per thrust as assumed; hub moments and gusts are not in the model and make \
xx and yy too large. The page on the hexacopter (docs/hexacopter.md) holds its forces against the authors' figures."""
NO_DATA: Final = """\
The real flight was left out: no folder was named. Give --data DIR with the log of \
https://github.com/altlnt/id_mod_helice, logs/copter/vol2/log_18_2019-7-26-10-48-46."""
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
        return Findings.tabulated(
            f"Multirotors: a simulated quadrotor, box {setting.box}, and a real hexacopter",
            LEAD,
            _claims(clean, noisy, real, errors),
            (_clean_section(clean), _noisy_section(noisy, errors), _real_section(real)),
            [{name: cell(c, g) for name, cell in CSV.items()} for c in by_case.values() for g in c.every],
            {"parameters": list(_parameters(by_case, errors))},
        )


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


def _clean_section(case: Case) -> Section:
    # the default in dashes: others lie below it
    looks = {m: i + HUES * (m == "default") for i, m in enumerate(METHODS)}
    words = "Median fitness by method"
    drawn = by_iterations(case.groups, "median fitness J", words, lambda g: g.median_cost, looks=looks)
    fitness: dict[str, Callable[[Group], str]] = {"median fitness": lambda g: number(g.median_cost)}
    return Section(
        "A simulated quadrotor, without noise",
        (
            Prose(OPEN_LOOP.format(length="0.5 s of the quadrotor and 0.25 s of the hexacopter")),
            Prose(QUAD),
            tabulated(SUMMARY, summary_columns(fitness), case.every),
            Figure("Median fitness of all runs", drawn),
            Prose("Its maneuver, on top of what the autopilot does (`stoop simulate quad-x --maneuver`):"),
            Code(MANEUVER.strip()),
        ),
    )


def _noisy_section(case: Case, shot: FloatArray) -> Section:
    columns = {
        "parameter": list(case.parameters),
        "truth": [number(float(v), 4) for v in case.values],
        "bound": [percent(float(s)) for s in case.sigma / np.abs(case.values)],
    }
    columns |= {m: [percent(float(e)) for e in rms(case.last(m).errors)] for m in METHODS}
    columns["multiple shooting"] = [percent(float(e)) for e in shot]
    errors = by_columns("Root mean square of the relative errors over seeds", columns)
    return Section("The same with noise, box S", (_endings(case, "optimum"), errors, Prose(NOISE_WORDS)))


def _real_section(case: Case | None) -> Section:
    if case is None:
        return Section("A real hexacopter", (Prose(NO_DATA),))
    columns = {
        "parameter": list(case.parameters),
        "least J known ± standard error": _with_errors(case.values, case.sigma),
    }
    for m in METHODS:
        columns[f"{m} ± scatter"] = _with_errors(case.last(m).values.mean(axis=0), case.last(m).spread)
    table = by_columns("Estimates, SI units", columns)
    return Section("A real hexacopter", (_endings(case, "least J known, 0.1 %"), table, Prose(REAL_WORDS)))


def _with_errors(values: FloatArray, errors: FloatArray) -> list[str]:
    pairs = zip(values.tolist(), errors.tolist(), strict=True)
    return [f"{number(value, 4)} ± {number(error, 2)}" for value, error in pairs]


def _endings(case: Case, where: str) -> Table:
    return tabulated(
        "Where runs end",
        {
            "method": lambda g: g.method,
            "iterations": lambda g: str(g.iterations),
            f"reached: {where}": lambda g: counted(g.reached, len(g.costs)),
            "median J": lambda g: number(g.median_cost, 6),
            "worst J": lambda g: number(float(g.costs.max()), 6),
            "evaluations to it": lambda g: g.hits_text,
            "evaluations spent": lambda g: f"{g.evaluations.mean():.0f}",
        },
        case.every,
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

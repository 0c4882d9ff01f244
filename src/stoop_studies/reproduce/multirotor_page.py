"""The multirotor that the paper's title promises, in words, tables and a figure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.parallel import Plan
from stoop.report.plots import HUES, Series, plot
from stoop.report.sheet import Code, Figure, Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number, reproduces
from stoop_studies.problems.quad import MANEUVER
from stoop_studies.reproduce.groups import Group
from stoop_studies.reproduce.multirotor import NOISY_BOX, Case, counts, found, plan
from stoop_studies.reproduce.shots import shots
from stoop_studies.reproduce.table1 import EXACT, METHODS, SUCCESS

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
bound, which is that of known beginnings. All four minimize the same J: how near they come to its optimum (1e-6, where a \
dive from the truth ends) is the optimizer's part, the rest is the cost's. The last column is of the same flights, noise and \
bounds: multiple shooting, the method of stoop identify for vehicles on rotors, estimates the states in which windows \
begin, and the speeds of the motors, too; it starts from the center of the box. Box S begins at \
zero and ends at 2 to 8 times the truth; the sign alone is known."""
REAL_WORDS: Final = """\
140 to 214 s of PX4's log 18: hover, two climbs of 6 m/s and slow descents. Q is what the residuals of a dive from the \
file's own values say, colored as they are, and is then held; that dive is also what counts as reached (its J and 0.1 %). \
No optimizer is given its end. The real flight is run with half the seeds. Motors begin \
where their commands and a lag of 0.05 s put them. Errors behind ± are standard errors at the least J known (Cramer-Rao \
with this Q), and the scatter over seeds of each method. Inertias are what answers the commands within a quarter of a \
second, with arms and torque per thrust as assumed; hub moments and gusts are not in the model and make xx and yy too \
large. The page on the hexacopter (docs/hexacopter.md) holds its forces against the authors' figures."""
NO_DATA: Final = """\
The real flight was left out: no folder was named. Give --data DIR with the log of \
https://github.com/altlnt/id_mod_helice, logs/copter/vol2/log_18_2019-7-26-10-48-46."""
TITLES: Final = {"clean": "without noise", "noise": "with noise", "real": "real flight"}
HEAD: Final = (
    "case", "method", "iterations", "runs", "reached_target", "within_1e-2", "within_1e-6", "mean_error", "median_fitness",
    "worst_fitness", "median_evaluations_to_target", "mean_evaluations",
)  # fmt: skip
PARAMETERS_HEAD: Final = (
    "case", "method", "iterations", "parameter", "truth_or_best", "deviation", "mean", "spread", "rms_relative_error",
)  # fmt: skip
LOOKS: Final = {
    m: i + HUES * (m == "default") for i, m in enumerate(METHODS)
}  #: the default in dashes, where others lie below


@dataclass(frozen=True)
class Multirotor:
    """The paper's comparison, on multirotors."""

    name: str = "multirotor"
    runs: int = 20
    box: str = "N"
    parts: tuple[str, ...] = ("parameters",)

    def plan(self, setting: Setting) -> Plan:
        """Return all runs."""
        return plan(setting)

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        by_case = found(setting, results)
        real = (
            _real(by_case["real"]) if "real" in by_case else Section("A real hexacopter", (Prose(NO_DATA),))
        )
        noisy = by_case["noise"]
        shot = np.abs(shots(setting.seeds, NOISY_BOX, noisy.parameters) / noisy.values - 1.0)
        rows = tuple(_row(case, g) for case in by_case.values() for g in case.groups)
        parameters = tuple(row for case in by_case.values() for row in _parameter_rows(case))
        parameters += tuple(_shot_rows(noisy, shot))
        return Findings(
            f"Multirotors: a simulated quadrotor, box {setting.box}, and a real hexacopter",
            LEAD,
            tuple(_claims(by_case, shot)),
            (_clean(by_case["clean"]), _noisy(by_case["noise"], shot), real),
            HEAD,
            rows,
            {"parameters": (PARAMETERS_HEAD, parameters)},
        )


def _claims(by_case: dict[str, Case], shot: FloatArray) -> Iterator[Claim]:
    clean, noisy = by_case["clean"], by_case["noise"]
    yield _order(clean)
    yield _successful(clean, "PS-GDE", SUCCESS, "1 %")
    yield _successful(clean, "default", EXACT, "1e-6")
    yield _cheaper(clean)
    for case in (noisy, *([by_case["real"]] if "real" in by_case else [])):
        for method in METHODS:
            yield _reached(case, method)
    yield _better(noisy, shot)
    if "real" in by_case:
        for method in METHODS:
            yield _settled(by_case["real"], method)


def _order(clean: Case) -> Claim:
    rows = [
        [float(clean.errors(g).mean()) for g in groups]
        for groups in zip(*(clean.of(m) for m in ("GA", "PSO", "PS-GDE")), strict=True)
    ]
    so = [a > b > c for a, b, c in rows]
    stops = [g.iterations for g in clean.of("GA")]
    shown = "; ".join(
        f"{' > '.join(_percent(e) for e in rows[i])} at {stops[i]}" for i in dict.fromkeys((0, len(rows) - 1))
    )
    return reproduces(
        "The mean error falls from GA over PSO to PS-GDE, on a quadrotor as on the paper's airplane",
        all(so),
        f"at {sum(so)} of {len(so)} iteration counts; {shown}",
    )


def _successful(clean: Case, method: str, limit: float, said: str) -> Claim:
    groups = clean.of(method)
    many, whole = sum(clean.within(g, limit) for g in groups), sum(len(g.costs) for g in groups)
    worst = max(float(clean.errors(g).max()) for g in groups)
    return holds(
        f"{method}, without noise: all ten values within {said} in every run, at every number of iterations",
        many == whole,
        f"{counted(many, whole)}; largest error {_percent(worst)}",
    )


def _cheaper(clean: Case) -> Claim:
    hits = {m: clean.last(m) for m in METHODS}
    least = hits["default"].median_hit
    others = [g.median_hit for m, g in hits.items() if m != "default" and g.reached]
    shown = ", ".join(f"{m} {g.hits_told}" for m, g in hits.items())
    return holds(
        "The default reaches 1e-6 of J0 with a tenth of the evaluations of any other, or fewer",
        all(least <= 0.1 * other for other in others),
        f"median evaluations, and in how many runs: {shown}",
    )


def _reached(case: Case, method: str) -> Claim:
    group = case.last(method)
    where = {"noise": "the optimum, to 1e-6 of J", "real": "the least J known, to 0.1 %"}[case.name]
    return holds(
        f"{method}, {TITLES[case.name]}: ends at {where}, in every run",
        group.reached == len(group.costs),
        f"{counted(group.reached, len(group.costs))} at {group.iterations} iterations, median J "
        f"{number(float(np.median(group.costs)), 6)}, worst {number(float(group.costs.max()), 6)}",
    )


def _better(noisy: Case, shot: FloatArray) -> Claim:
    ours, theirs = _rms(shot), noisy.rms(noisy.last("default"))
    return holds(
        "Multiple shooting, which estimates the states of the windows, has smaller errors of all ten on the same flights",
        bool((ours < theirs).all()),
        f"root mean square of all {_percent(float(np.sqrt(np.mean(ours**2))))} instead of "
        f"{_percent(float(np.sqrt(np.mean(theirs**2))))}; by parameter "
        f"{number(float((ours / theirs).min()), 2)} to {number(float((ours / theirs).max()), 2)} times as large",
    )


def _rms(errors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def _settled(real: Case, method: str) -> Claim:
    ratio = real.spread(real.last(method)) / real.sigma
    at = int(np.argmax(ratio))
    return holds(
        f"{method}, real flight: where it ends scatters over seeds by less than a tenth of the standard errors",
        float(ratio.max()) < 0.1,
        f"at most {number(float(ratio.max()), 2)} of the standard error, {real.parameters[at]}",
    )


def _clean(case: Case) -> Section:
    drawn = plot(
        [
            Series(
                m,
                np.array([g.iterations for g in case.of(m)], dtype=float),
                np.array([float(np.median(g.costs)) for g in case.of(m)]),
            )
            for m in METHODS
        ],
        "iterations",
        "median fitness J",
        "Median fitness by method",
        log_y=True,
        looks=LOOKS,
    )
    return Section(
        "A simulated quadrotor, without noise",
        (
            Prose(OPEN_LOOP.format(length="0.5 s of the quadrotor and 0.25 s of the hexacopter")),
            Prose(QUAD),
            _summary(case),
            Figure("Median fitness of all runs", drawn),
            Prose("Its maneuver, on top of what the autopilot does (`stoop simulate quad-x --maneuver`):"),
            Code(MANEUVER.strip()),
        ),
    )


def _noisy(case: Case, shot: FloatArray) -> Section:
    return Section(
        "The same with noise, box S", (_endings(case, "optimum"), _errors(case, shot), Prose(NOISE_WORDS))
    )


def _real(case: Case) -> Section:
    return Section(
        "A real hexacopter", (_endings(case, "least J known, 0.1 %"), _estimates(case), Prose(REAL_WORDS))
    )


def _summary(case: Case) -> Table:
    head = (
        "method", "iterations", "within 1 %", "within 1e-6", "mean error", "median fitness", "evaluations to 1e-6 J0",
        "evaluations spent",
    )  # fmt: skip
    rows = tuple(
        (
            g.method,
            str(g.iterations),
            *(counted(n, len(g.costs)) for n in counts(case, g)),
            _percent(float(case.errors(g).mean())),
            number(float(np.median(g.costs))),
            g.hits_told,
            f"{g.evaluations.mean():.0f}",
        )
        for g in case.groups
    )
    return Table("All methods; evaluations are the median of those that got there, and the mean", head, rows)


def _endings(case: Case, where: str) -> Table:
    head = (
        "method",
        "iterations",
        f"reached: {where}",
        "median J",
        "worst J",
        "evaluations to it",
        "evaluations spent",
    )
    rows = tuple(
        (
            g.method,
            str(g.iterations),
            counted(g.reached, len(g.costs)),
            number(float(np.median(g.costs)), 6),
            number(float(g.costs.max()), 6),
            g.hits_told,
            f"{g.evaluations.mean():.0f}",
        )
        for g in case.groups
    )
    return Table("Where runs end", head, rows)


def _errors(case: Case, shot: FloatArray) -> Table:
    rows = tuple(
        (
            name,
            number(float(case.values[i]), 4),
            _percent(float(case.sigma[i] / abs(case.values[i]))),
            *(_percent(float(case.rms(case.last(m))[i])) for m in METHODS),
            _percent(float(_rms(shot)[i])),
        )
        for i, name in enumerate(case.parameters)
    )
    head = ("parameter", "truth", "bound", *METHODS, "multiple shooting")
    return Table("Root mean square of the relative errors over seeds", head, rows)


def _estimates(case: Case) -> Table:
    rows = tuple(
        (
            name,
            _with_error(float(case.values[i]), float(case.sigma[i])),
            *(
                _with_error(float(case.last(m).values[:, i].mean()), float(case.spread(case.last(m))[i]))
                for m in METHODS
            ),
        )
        for i, name in enumerate(case.parameters)
    )
    head = ("parameter", "least J known ± standard error", *(f"{m} ± scatter" for m in METHODS))
    return Table("Estimates, SI units", head, rows)


def _with_error(value: float, error: float) -> str:
    return f"{number(value, 4)} ± {number(error, 2)}"


def _percent(share: float) -> str:
    return f"{number(100.0 * share)} %"


def _row(case: Case, g: Group) -> tuple[Cell, ...]:
    known = case.name != "real"
    within = counts(case, g) if known else (None, None)
    return (
        case.name, METHODS[g.method], g.iterations, len(g.costs), g.reached, *within,
        float(case.errors(g).mean()) if known else None, float(np.median(g.costs)), float(g.costs.max()),
        g.median_hit if g.reached else None, float(g.evaluations.mean()),
    )  # fmt: skip


def _parameter_rows(case: Case) -> Iterator[tuple[Cell, ...]]:
    for m in METHODS:
        g = case.last(m)
        for i, name in enumerate(case.parameters):
            rms = float(case.rms(g)[i]) if case.name != "real" else None
            yield (
                case.name, METHODS[m], g.iterations, name, float(case.values[i]), float(case.sigma[i]),
                float(g.values[:, i].mean()), float(case.spread(g)[i]), rms,
            )  # fmt: skip


def _shot_rows(case: Case, shot: FloatArray) -> Iterator[tuple[Cell, ...]]:
    for i, name in enumerate(case.parameters):
        rms = float(_rms(shot)[i])
        yield (
            case.name, "multiple-shooting", None, name, float(case.values[i]), float(case.sigma[i]), None, None, rms,
        )  # fmt: skip

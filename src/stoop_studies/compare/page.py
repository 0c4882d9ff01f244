"""The folder of a comparison: tables, and the page with empirical distributions of running times.

``compare.csv`` has a row per optimizer and problem, ``runs.csv`` a row per run; they and ``compare.html`` lie beside the
campaign's store ``compare.sqlite``. All sentences are computed.

References
----------
Hansen, Auger, Brockhoff and Tusar (2022), Anytime performance assessment in blackbox optimization benchmarking,
IEEE Transactions on Evolutionary Computation 26, 1293-1305.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from stoop.base.csv_text import csv_text
from stoop.base.files import check_targets, write_files
from stoop.base.numbers import count, number
from stoop.base.text import enumerated
from stoop.errors import OutputError
from stoop.parallel.store import forget
from stoop.report.plots import plot
from stoop.report.series import Series
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table, render_sheet
from stoop_studies.compare.field import Field
from stoop_studies.compare.measures import Score, duel, score
from stoop_studies.compare.race import Race
from stoop_studies.findings import Record, table_of
from stoop_studies.outputs import GUIDE

STORE: Final = "compare.sqlite"
SCORES: Final = "compare.csv"
RUNS: Final = "runs.csv"
PAGE: Final = "compare.html"
SCORE_COLUMNS: Final = (
    "problem", "optimizer", "runs", "successes", "ert", "ert_low", "ert_high", "median_of_successes",
    "baseline", "ratio", "ratio_low", "ratio_high", "wrong_optima", "ended_short", "evaluations",
)  # fmt: skip
RUN_COLUMNS: Final = (
    "problem", "optimizer", "seed", "hit", "evaluations", "cost", "status", "target", "reference",
)  # fmt: skip
BEGIN: Final = 1.0  #: evaluation at which the axis begins
POINTS: Final = 160  #: of a drawn distribution: finer than a line's width
Races = Mapping[tuple[str, str], Sequence[Race]]


def prepare(folder: Path, overwrite: bool) -> None:
    """See to it that a folder may be written into: continue the store that is there, or with `overwrite` forget it.

    Raises
    ------
    OutputError
        It is a file, holds tables of something else, or with `overwrite`: the store is another program's file, or in use.
    """
    check_targets(folder, (SCORES, RUNS, PAGE), overwrite=True)
    if (store := folder / STORE).exists():
        if overwrite:
            forget(store)
        return
    strange = [folder / name for name in (SCORES, RUNS, PAGE) if (folder / name).exists()]
    if strange and not overwrite:
        raise OutputError(
            f"{strange[0]}: exists already, and no {STORE} beside it; add --overwrite to replace it, or choose another folder"
        )


def conclude(field: Field, results: Mapping[str, Any], folder: Path, command: str) -> list[Score]:
    """Write tables and page of a campaign's results; return the scores by problem, the fastest first.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    races = field.races(results)
    scores = scored(field, races)

    def known(value: float) -> float | None:
        """Return nothing where there is no ratio; inf where no run succeeded."""
        return None if math.isnan(value) else value

    rows = [
        (
            s.problem, s.optimizer, s.runs, s.successes, known(s.ert.value), known(s.ert.low), known(s.ert.high),
            known(s.median), s.baseline, known(s.ratio.value), known(s.ratio.low), known(s.ratio.high),
            s.wrong, s.short, s.evaluations,
        )
        for s in scores
    ]  # fmt: skip
    texts = {
        SCORES: csv_text(SCORE_COLUMNS, rows),
        RUNS: races_text(race for found in races.values() for race in found),
        PAGE: render_sheet(page(field, races, scores, command)),
    }
    write_files(folder, texts)
    return scores


def scored(field: Field, races: Races) -> list[Score]:
    """Return the scores of all pairs, by problem in the field's order, the fastest first."""
    found = [score(races[p, o], races[p, field.baseline(p)]) for p, o in field.pairs]
    return sorted(
        found,
        key=lambda s: (field.problems.index(s.problem), s.ert.value, -s.successes, s.optimizer),
    )


def races_text(races: Iterable[Race]) -> str:
    """Return a row per run; ``hit`` is empty where the target was not reached."""
    return csv_text(RUN_COLUMNS, [tuple(getattr(r, column) for column in RUN_COLUMNS) for r in races])


def beaten_text(scores: Sequence[Score]) -> str:
    """Return who beats the baseline on a problem; where nobody does, who cannot be told apart from it."""
    if not any(s.successes for s in scores):
        return "Nobody reached the target here."
    if ahead := rivals_text(scores):
        return ahead
    close = [s for s in scores if s.optimizer != s.baseline and s.ratio.value < math.inf and not s.clear]
    names = [f"{s.optimizer} ({s.ratio.interval} times its evaluations)" for s in close]
    doubt = f" These seeds do not tell it apart from {enumerated(names)}." if names else ""
    return f"No rival beats {scores[0].baseline} here.{doubt}"


def rivals_text(scores: Sequence[Score]) -> str:
    """Return who beats the baseline on a problem, and how surely; empty if nobody does."""
    ahead = sorted((s for s in scores if s.ahead), key=lambda s: s.ratio.value)
    if not ahead:
        return ""
    parts = [
        f"{s.optimizer} takes {s.ratio_text} of its evaluations "
        f"({'clearly less' if s.clear else 'not told apart with these seeds'})"
        for s in ahead
    ]
    return f"{scores[0].problem}: {ahead[0].baseline} is beaten: {'; '.join(parts)}."


def ends_text(scores: Sequence[Score]) -> list[str]:
    """Return who claimed wrong optima, and who stopped at the right one before the target was reached."""
    wrong = [f"{s.optimizer} on {s.problem} ({s.wrong} of {s.runs} runs)" for s in scores if s.wrong]
    short = [f"{s.optimizer} on {s.problem} ({s.short} of {s.runs} runs)" for s in scores if s.short]
    claimed = (
        f"Wrong optima claimed: {', '.join(wrong)}."
        if wrong
        else "No optimizer claimed a wrong optimum in any run."
    )
    return [
        claimed,
        *([f"At the right optimum, but ended short of the target: {', '.join(short)}."] if short else []),
    ]


def page(field: Field, races: Races, scores: Sequence[Score], command: str) -> Sheet:
    """Return the page of a comparison; `scores` are sorted by problem, then by expected running time."""
    own = {p: [s for s in scores if s.problem == p] for p in field.problems}
    sections = [
        _overview(field, own),
        *(_problem(p, found, field, races) for p, found in own.items() if found),
        _together(field, races),
        _how(field),
        Section("Command", (Code(command),)),
    ]
    runs = sum(len(found) for found in races.values())
    return Sheet("Optimizers compared", _lead(scores, runs), tuple(sections))


def _lead(scores: Sequence[Score], runs: int) -> str:
    """Return the result in a few sentences."""
    best = {problem: list(group) for problem, group in groupby(scores, lambda s: s.problem)}
    nobody = [problem for problem, group in best.items() if not any(s.successes for s in group)]
    won = [problem for problem, group in best.items() if not any(s.ahead for s in group)]
    baseline = enumerated(dict.fromkeys(s.baseline for s in scores))
    optimizers = len({s.optimizer for s in scores})
    said = (
        f"{count(optimizers, 'optimizer')} on {count(len(best), 'problem')}, {runs} runs, all counted alike. "
        f"Compared with {baseline}: no rival is faster on {len(won) - len(nobody)} of {count(len(best), 'problem')}."
    )
    said += f" Nobody reached the target on {enumerated(nobody)}." if nobody else ""
    rivals = [sentence for group in best.values() if (sentence := rivals_text(group))]
    return "\n\n".join([said, "\n".join(f"- {line}" for line in [*rivals, *ends_text(scores)])])


def _overview(field: Field, scores: Mapping[str, Sequence[Score]]) -> Section:
    """Return the ratios at a glance; first the optimizers that rank better in the median over the problems they ran on."""
    cells, places = {}, {o: list[int]() for o in field.optimizers}
    for found in scores.values():
        for place, s in enumerate(found):
            places[s.optimizer].append(place)
            share = "" if s.successes == s.runs else f" ({100.0 * s.successes / s.runs:.0f} %)"
            cells[s.problem, s.optimizer] = f"{s.ratio_text}{share}" if s.successes else "0 %"
    rank = {o: sorted(p)[len(p) // 2] if p else len(scores) for o, p in places.items()}
    names = sorted(field.optimizers, key=lambda o: (rank[o], field.optimizers.index(o)))
    rows = tuple((o, *(cells.get((p, o), "–") for p in field.problems)) for o in names)
    caption = (
        "Expected running time over the baseline's; in brackets the share of runs that succeeded, if not all"
    )
    return Section("At a glance", (Table(caption, ("optimizer", *field.problems), rows),))


def _problem(problem: str, scores: Sequence[Score], field: Field, races: Races) -> Section:
    rows: list[Record] = [
        {
            "optimizer": s.optimizer,
            "successes": s.rate_text,
            "ERT": s.ert_text,
            "95 %": s.ert.interval,
            "ratio": s.ratio_text,
            "95 % of the ratio": s.ratio.interval,
            "median of successes": number(s.median, 3),
            "wrong optima": s.wrong,
        }
        for s in scores
    ]
    table = table_of(f"Sorted by expected running time; ratio to {scores[0].baseline}", rows)
    groups = {o: races[problem, o] for p, o in field.pairs if p == problem}
    drawn = distributions(groups, problem, field.optimizers)
    figure = Figure("Share of targets reached against evaluations", drawn)
    return Section(problem, (Prose(beaten_text(scores)), table, figure))


def _together(field: Field, races: Races) -> Section:
    """Return all problems in one: solved instances against the baseline, and the curves."""
    everything = {o: [r for p in field.problems for r in races.get((p, o), ())] for o in field.optimizers}
    groups = {o: found for o, found in everything.items() if found}
    baseline = field.baseline(field.problems[0])
    duels = [duel(found, groups[baseline]) for o, found in groups.items() if o != baseline]
    caption = (
        f"Instances (problem and seed) solved, beside {baseline}; p: that chance parts those solved by one alone so "
        "unevenly (two-sided sign test); evaluations over the baseline's, geometric mean over instances both solved"
    )
    rows: list[Record] = [
        {
            "optimizer": d.optimizer,
            "solved": d.both + d.only_own,
            "both": d.both,
            "it alone": d.only_own,
            "baseline alone": d.only_other,
            "neither": d.neither,
            "p": number(d.probability, 2),
            "evaluations, both": "–" if math.isnan(d.ratio) else f"{number(d.ratio, 3)}×",
        }
        for d in duels
    ]
    drawn = distributions(groups, "all problems", field.optimizers)
    figure = Figure("Over all problems that an optimizer ran on", drawn)
    return Section("All problems together", (table_of(caption, rows), figure) if rows else (figure,))


def _how(field: Field) -> Section:
    seeds = field.seeds
    span = f"Seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else f"Seed {seeds[0]}"
    guide = f"How evaluations, successes, running times and intervals are counted: {GUIDE}#compare"
    texts = [f"{span}; at most {field.budget:.0f} evaluations a run.", guide]
    absent = [f"- {name}: {reason}" for name, reason in field.absent.items()]
    absent += [f"- {o} on {p}: needs residuals, of which there are none" for p, o in field.impossible]
    if absent:
        texts.append("\n".join(["Left out:", *absent]))
    return Section("How it was counted", tuple(Prose(text) for text in texts))


def distribution(races: Sequence[Race], name: str, last: float) -> Series:
    """Return the share of (problem, seed, level) reached, a staircase from 1 to `last` evaluations."""
    times = np.sort([hit for race in races for hit in race.hits if hit is not None])
    total = sum(len(race.hits) for race in races)
    shares = np.arange(1, len(times) + 1) / max(total, 1)
    if len(times) > POINTS:
        kept = np.unique(np.rint(np.linspace(0, len(times) - 1, POINTS)).astype(int))
        times, shares = times[kept], shares[kept]
    end = shares[-1] if len(shares) else 0.0
    x = np.concatenate([[BEGIN], np.maximum(times, BEGIN), [max(last, BEGIN)]])
    return Series(name, x, np.concatenate([[0.0], shares, [end]]), "steps")


def distributions(groups: Mapping[str, Sequence[Race]], what: str, everyone: Sequence[str]) -> Markup:
    """Return the drawing of the distributions of optimizers on `what`; each of `everyone` looks the same in all drawings."""
    last = max((race.evaluations for races in groups.values() for race in races), default=10.0)
    series = [distribution(races, name, last) for name, races in groups.items()]
    ends = ", ".join(f"{one.name} {100.0 * one.y[-1]:.0f} %" for one in series)
    return plot(
        series,
        "evaluations",
        "share of targets reached",
        f"Share of all targets reached against evaluations on {what}, one curve an optimizer. In the end: {ends}.",
        log_x=True,
        x_range=(BEGIN, max(last, 10.0)),
        y_range=(0.0, 1.0),
        looks={name: i for i, name in enumerate(everyone)},
    )

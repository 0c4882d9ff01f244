"""The comparison as a page, with empirical distributions of running times.

References
----------
Hansen, Auger, Brockhoff and Tusar (2022), Anytime performance assessment in blackbox optimization benchmarking,
IEEE Transactions on Evolutionary Computation 26, 1293-1305.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.base.numbers import number
from stoop.report.plots import Series, plot
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table
from stoop_studies.compare import words
from stoop_studies.compare.field import FLIGHT, Field
from stoop_studies.compare.measures import Score, duel
from stoop_studies.compare.race import Race

BEGIN: Final = 1.0  #: evaluation at which the axis begins
POINTS: Final = 160  #: of a drawn distribution: finer than a line's width
Races = Mapping[tuple[str, str], Sequence[Race]]
HEAD = ("optimizer", "successes", "ERT", "95 %", "ratio", "95 %", "median of successes", "wrong optima")
SOLVED = ("optimizer", "solved", "both", "it alone", "baseline alone", "neither", "p", "evaluations, both")


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
    return Sheet("Optimizers compared", words.lead(scores, runs), tuple(sections))


def _overview(field: Field, scores: Mapping[str, Sequence[Score]]) -> Section:
    cells = {(s.problem, s.optimizer): _cell(s) for found in scores.values() for s in found}
    rows = tuple((o, *(cells.get((p, o), "–") for p in field.problems)) for o in _by_ratio(field, scores))
    caption = (
        "Expected running time over the baseline's; in brackets the share of runs that succeeded, if not all"
    )
    return Section("At a glance", (Table(caption, ("optimizer", *field.problems), rows),))


def _by_ratio(field: Field, scores: Mapping[str, Sequence[Score]]) -> list[str]:
    """Return the optimizers, those first that rank better in the median over the problems they ran on."""
    places: dict[str, list[int]] = {o: [] for o in field.optimizers}
    for found in scores.values():
        for place, s in enumerate(found):
            places[s.optimizer].append(place)
    ranked = [(sorted(p)[len(p) // 2] if p else len(places), o) for o, p in places.items()]
    return [o for _, o in sorted(ranked, key=lambda pair: (pair[0], field.optimizers.index(pair[1])))]


def _cell(score: Score) -> str:
    if not score.successes:
        return "0 %"
    share = "" if score.successes == score.runs else f" ({100.0 * score.rate:.0f} %)"
    return f"{words.ratio_text(score)}{share}"


def _problem(problem: str, scores: Sequence[Score], field: Field, races: Races) -> Section:
    rows = tuple(
        (
            s.optimizer, words.rate_text(s), words.ert_text(s), words.span_text(s.ert), words.ratio_text(s),
            words.span_text(s.ratio), number(s.median, 3), str(s.wrong),
        )
        for s in scores
    )  # fmt: skip
    caption = f"Sorted by expected running time; ratio to {scores[0].baseline}"
    groups = {o: races[problem, o] for p, o in field.pairs if p == problem}
    drawn = distributions(groups, problem, field.optimizers)
    figure = Figure("Share of targets reached against evaluations", drawn)
    return Section(problem, (Prose(words.beaten_text(scores)), Table(caption, HEAD, rows), figure))


def _together(field: Field, races: Races) -> Section:
    """Return all problems in one: solved instances against the baseline, and the curves."""
    everything = {o: [r for p in field.problems for r in races.get((p, o), ())] for o in field.optimizers}
    groups = {o: found for o, found in everything.items() if found}
    baseline = field.baseline(field.problems[0])
    rows = tuple(
        words.duel_row(duel(found, groups[baseline])) for o, found in groups.items() if o != baseline
    )
    caption = (
        f"Instances (problem and seed) solved, beside {baseline}; p: that chance parts those solved by one alone so "
        "unevenly (two-sided sign test); evaluations over the baseline's, geometric mean over instances both solved"
    )
    drawn = distributions(groups, "all problems", field.optimizers)
    parts = (Table(caption, SOLVED, rows), Figure("Over all problems that an optimizer ran on", drawn))
    return Section("All problems together", parts)


def _how(field: Field) -> Section:
    seeds = field.seeds
    said = (
        f"Seeds {seeds[0]} to {seeds[-1]}; at most {field.budget:.0f} evaluations a run."
        if len(seeds) > 1
        else f"Seed {seeds[0]}; at most {field.budget:.0f} evaluations a run."
    )
    texts = [said, words.HOW, words.BLIND]
    if any(p.startswith("paper-") for p in field.problems):
        texts.append(words.NOISY)
    if FLIGHT in field.problems:
        texts.append(words.JOINED)
    texts += [_left_out(field)] if _left_out(field) else []
    return Section("How it was counted", tuple(Prose(text) for text in texts))


def _left_out(field: Field) -> str:
    lines = [f"- {name}: {reason}" for name, reason in field.absent.items()]
    lines += [f"- {o} on {p}: needs residuals, of which there are none" for p, o in field.impossible]
    return "\n".join(["Left out:", *lines]) if lines else ""


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
    """Return the drawing of several optimizers' distributions.

    Parameters
    ----------
    groups : mapping of optimizer to its runs
    what : str, which problems
    everyone : sequence of str, all optimizers of the page: each looks the same in all of its drawings
    """
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

"""What a comparison says in sentences; all of it is computed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from math import inf, isnan

from stoop.base.numbers import count, number
from stoop_studies.compare.measures import Duel, Score, Span

HOW = """Everything is counted in evaluations: one flight of the whole record by one candidate. A third of the \
record counts a third; every column of a finite-difference Jacobian counts what is flown for it. All optimizers reach \
the problem through the same ledger, which does the counting.

- A run succeeds when its cost falls to the target, and ends there. It fails when its budget is used up, or when the \
optimizer itself claims convergence above the target.
- The expected running time (ERT) is the sum of the evaluations of all runs, failures included, over the number of \
successes: what it takes on average when a failure is followed by a fresh start. Without a success it is infinite; then \
the table shows what was spent.
- Optimizers of other packages are restarted by their adapter when they end by themselves, until the target or the end \
of the budget. That is inside the run, and counted.
- L-SHADE and jSO plan ahead: they are told the budget, shrink their population towards its end, and so arrive late \
in it by design. A smaller budget would make them faster, or fail.
- Intervals hold 95 % of 2000 resamples of the seeds. For a ratio the same seeds are drawn for both.
- A wrong optimum is a convergence claimed at a cost more than 0.1 % above the target.
- The curves show which share of all targets has been reached after so many evaluations: ten costs for each seed, \
evenly spaced in their logarithm from the trivial model's down to the target itself."""

BLIND = """Nobody is given starting values: every optimizer knows the box and no more."""

JOINED = """On the flight, initial states and sensor biases are searched in the unit box with the parameters, 5 prior \
standard deviations to either side, so that every optimizer searches the same numbers. stoop identify keeps them \
apart, which is easier for it. Target: the least cost that long searches from the vehicle file's own values found, and \
a thousandth more."""

NOISY = """On the paper's problems the target is one millionth of the trivial model's cost without noise, and within \
one millionth of the cost at the optimum with it. The seed draws the box about the truth, the noise and the search."""


def lead(scores: Sequence[Score], runs: int) -> str:
    """Return the result in a few sentences."""
    best = {problem: list(group) for problem, group in groupby(scores, lambda s: s.problem)}
    nobody = [problem for problem, group in best.items() if unsolved(group)]
    won = [problem for problem, group in best.items() if not any(s.ahead for s in group)]
    baseline = _listed(dict.fromkeys(s.baseline for s in scores))
    optimizers = len({s.optimizer for s in scores})
    said = (
        f"{count(optimizers, 'optimizer')} on {count(len(best), 'problem')}, {runs} runs, all counted alike. "
        f"Compared with {baseline}: no rival is faster on {len(won) - len(nobody)} of {count(len(best), 'problem')}."
    )
    said += f" Nobody reached the target on {_listed(nobody)}." if nobody else ""
    rivals = [sentence for group in best.values() if (sentence := rivals_text(group))]
    ends = [wrong_text(scores), short_text(scores)]
    return "\n\n".join([said, "\n".join(f"- {line}" for line in [*rivals, *filter(None, ends)])])


def unsolved(scores: Sequence[Score]) -> bool:
    """Whether nobody reached the target of a problem."""
    return not any(s.successes for s in scores)


def rivals_text(scores: Sequence[Score]) -> str:
    """Return who beats the baseline on a problem, and how surely; empty if nobody does."""
    ahead = sorted((s for s in scores if s.ahead), key=lambda s: s.ratio.value)
    if not ahead:
        return ""
    parts = [
        f"{s.optimizer} takes {ratio_text(s)} of its evaluations "
        f"({'clearly less' if s.clear else 'not told apart with these seeds'})"
        for s in ahead
    ]
    return f"{scores[0].problem}: {ahead[0].baseline} is beaten: {'; '.join(parts)}."


def beaten_text(scores: Sequence[Score]) -> str:
    """Return who beats the baseline on a problem; where nobody does, who cannot be told apart from it."""
    if unsolved(scores):
        return "Nobody reached the target here."
    if ahead := rivals_text(scores):
        return ahead
    close = [s for s in scores if s.optimizer != s.baseline and s.ratio.value < inf and not s.clear]
    told = [f"{s.optimizer} ({span_text(s.ratio)} times its evaluations)" for s in close]
    doubt = f" These seeds do not tell it apart from {_listed(told)}." if told else ""
    return f"No rival beats {scores[0].baseline} here.{doubt}"


def wrong_text(scores: Sequence[Score]) -> str:
    """Return who claimed wrong optima."""
    found = [s for s in scores if s.wrong]
    if not found:
        return "No optimizer claimed a wrong optimum in any run."
    told = [f"{s.optimizer} on {s.problem} ({s.wrong} of {s.runs} runs)" for s in found]
    return f"Wrong optima claimed: {', '.join(told)}."


def short_text(scores: Sequence[Score]) -> str:
    """Return who stopped at the right optimum before the target was reached; empty if nobody did."""
    found = [f"{s.optimizer} on {s.problem} ({s.short} of {s.runs} runs)" for s in scores if s.short]
    return f"At the right optimum, but ended short of the target: {', '.join(found)}." if found else ""


def rate_text(score: Score) -> str:
    """Return successes of runs."""
    return f"{score.successes} / {score.runs}"


def ert_text(score: Score) -> str:
    """Return the expected running time; what was spent without success where there was none."""
    return number(score.ert.value, 3) if score.ert.value < inf else f"> {number(score.evaluations, 3)}"


def ratio_text(score: Score) -> str:
    """Return the ratio to the baseline as a multiple."""
    value = score.ratio.value
    return "–" if isnan(value) or value == inf else f"{number(value, 3)}×"


def span_text(span: Span, digits: int = 3) -> str:
    """Return an interval."""
    if isnan(span.low) or span.low == inf:
        return "–"
    return f"{number(span.low, digits)} to {number(span.high, digits)}"


def duel_row(it: Duel) -> tuple[str, ...]:
    """Return a row of the table of solved instances."""
    return (
        it.optimizer, str(it.both + it.only_own), str(it.both), str(it.only_own), str(it.only_other), str(it.neither),
        number(it.probability, 2), "–" if isnan(it.ratio) else f"{number(it.ratio, 3)}×",
    )  # fmt: skip


def _listed(names: Iterable[str]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last

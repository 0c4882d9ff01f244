"""The verdict at the top of the page, from notices, goodness of fit and identifiability."""

from __future__ import annotations

import math
from typing import Final

from stoop.base.numbers import count, listed, number, window
from stoop.report.sheet import Level, Verdict
from stoop.results.result import ManeuverResult, Result, Role

MAX_NOT_IDENTIFIABLE: Final = 0.5  #: share of the parameters; above it the estimates are no model
MAX_LOST_TO_LAG: Final = (
    0.6  #: share of the fitted channels that a lag matches as well; above it the model shows nothing
)
FINISHED: Final = frozenset({"converged", "target"})
ENDINGS: Final = {
    "converged": "The search converged",
    "target": "The search reached the target cost",
    "budget": "The search ran out of its budget before it converged",
    "generations": "The search ran out of generations before it converged",
    "interrupted": "The search was interrupted; this is the best it had found",
}
HEADLINES: Final[dict[Level, str]] = {
    "good": "The model matches the flight, and its parameters are identifiable.",
    "caution": "Usable, with reservations: read the points below first.",
    "bad": "Do not rely on these numbers yet.",
}


def verdict(result: Result) -> Verdict:
    """Return the verdict on a result."""
    level = _level(result)
    sentences = (_ending(result), _parameters(result), _match(result, "fit"), _match(result, "validation"))
    return Verdict(level, HEADLINES[level], tuple(sentence for sentence in sentences if sentence))


def prediction(result: Result) -> str:
    """Return how well the maneuvers that were not fitted are predicted, in one sentence."""
    return _match(result, "validation")


def _level(result: Result) -> Level:
    unknown = [one for one in result.parameters.values() if not one.identifiable]
    if result.status not in FINISHED or not math.isfinite(result.cost):
        return "bad"
    too_many = len(unknown) > MAX_NOT_IDENTIFIABLE * len(result.parameters)
    if (result.parameters and too_many) or _share_lost(result) > MAX_LOST_TO_LAG:
        return "bad"
    doubts = [
        bool(unknown),
        any(one.at_bound for one in result.parameters.values()),
        bool(result.warnings),
        not any(m.role == "validation" for m in result.maneuvers),
        bool(_lost(result, "fit") or _lost(result, "validation")),
    ]
    return "caution" if any(doubts) else "good"


def _share_lost(result: Result) -> float:
    """Return in which share of the fitted channels a first-order lag does as well."""
    compared = [one for m in result.maneuvers if m.role == "fit" for one in _compared(m)]
    return len(_lost(result, "fit")) / len(compared) if compared else 0.0


def _ending(result: Result) -> str:
    how = ENDINGS.get(result.status, f"The search ended with status “{result.status}”")
    spent = f"{number(result.trajectories, 3)} simulated trajectories in {number(result.seconds, 2)} s"
    return f"{how}, after {spent}. {result.advice}".rstrip()


def _parameters(result: Result) -> str:
    unknown = [name for name, one in result.parameters.items() if not one.identifiable]
    bounded = [name for name, one in result.parameters.items() if one.at_bound]
    total = len(result.parameters)
    text = f"{count(total, 'parameter')} estimated"
    if unknown:
        text += f"; {count(len(unknown), 'of them is', 'of them are')} not identifiable ({listed(unknown)})"
    if bounded:
        lie = "lies" if len(bounded) == 1 else "lie"
        text += f"; {len(bounded)} {lie} at a bound ({listed(bounded)})"
    if not (unknown or bounded):
        text += ", all of them identifiable"
    # An identifiable parameter is in doubt only where others can almost replace it.
    doubts = result.identifiability.parameters.items()
    together = sum(bool(one.doubt) and name not in unknown for name, one in doubts)
    return text + (f"; {together} of them known only in combination with others." if together else ".")


def _match(result: Result, role: Role) -> str:
    maneuvers = [m for m in result.maneuvers if m.role == role]
    if not maneuvers:
        return "" if role == "fit" else "No window was held back, so the prediction error is not known."
    opening = "In the maneuvers it was fitted to" if role == "fit" else "Where nothing was fitted"
    text = "; ".join(part for part in (_theil_range(maneuvers), _against_lag(result, role)) if part)
    return f"{opening}, {text}." if text else ""


def _theil_range(maneuvers: list[ManeuverResult]) -> str:
    found = sorted(
        (one.theil, name) for m in maneuvers for name, one in m.channels.items() if math.isfinite(one.theil)
    )
    if not found:
        return ""
    (least, best), (most, worst) = found[0], found[-1]
    return f"Theil’s coefficient runs from {least:.3f} ({best}) to {most:.3f} ({worst}), 0 being perfect and 1 worst"


def _against_lag(result: Result, role: Role) -> str:
    compared = [one for m in result.maneuvers if m.role == role for one in _compared(m)]
    if not compared:
        return ""
    lost, better = _lost(result, role), sum(better for _, better in compared)
    text = f"the model beats a trivial first-order lag in {better} of {count(len(compared), 'comparison')}"
    drawn = len(compared) - better - len(lost)
    text += f" and leaves only noise in {drawn} more" if drawn else ""
    return f"{text}, not in {listed(lost)}" if lost else text


def _compared(maneuver: ManeuverResult) -> list[tuple[str, bool]]:
    """Return the channels that have a baseline, and whether the model beats it."""
    return [
        (name, one.theil < one.baseline_theil)
        for name, one in maneuver.channels.items()
        if math.isfinite(one.baseline_theil)
    ]


def _lost(result: Result, role: Role) -> list[str]:
    return [
        f"{name} ({window(m.start, m.stop)})"
        for m in result.maneuvers
        if m.role == role
        for name, one in m.channels.items()
        if one.lost
    ]

"""A result in a few lines of text: estimates by group, windows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Final

from stoop.base.numbers import count, rounded_to_error
from stoop.base.text import enumerated
from stoop.results.result import ManeuverResult, ParameterEstimate
from stoop.results.verdict import few_names

#: characters of a line of estimates
LINE: Final = 118
GAP: Final = "    "


def with_error(value: float, error: float) -> str:
    """Return ``value +- error``, both to the second significant digit of the error."""
    shown, spread = (text.replace("−", "-") for text in rounded_to_error(value, error))
    return f"{shown} +- {spread}" if math.isfinite(error) else shown


def estimate_blocks(estimates: Mapping[str, tuple[float, float]], width: int = LINE) -> list[str]:
    """Return estimates with their standard errors, each group in lines of its own, columns aligned within a group.

    Parameters
    ----------
    estimates : mapping of str to (float, float)
        Estimate and standard error by name, each in its unit.
    width : int
        Characters of a line.
    """
    groups: dict[str, list[str]] = {}
    for name in estimates:  # grouped by table, terms by coefficient (``CL`` of ``CLalpha``)
        table, dot, _ = name.partition(".")
        groups.setdefault(table if dot else name[:2], []).append(name)
    lines = []
    for names in groups.values():
        longest = max(map(len, names))
        cells = [f"{name:{longest}}  {with_error(*estimates[name])}" for name in names]
        wide = max(map(len, cells)) + len(GAP)
        columns = max((width + len(GAP)) // wide, 1)
        rows = (cells[i : i + columns] for i in range(0, len(cells), columns))
        lines += ["".join(f"{cell:{wide}}" for cell in row).rstrip() for row in rows]
    return lines


def determined(parameters: Mapping[str, ParameterEstimate]) -> dict[str, ParameterEstimate]:
    """Return the parameters that the data determine: identifiable, and at no bound."""
    return {name: p for name, p in parameters.items() if p.identifiable and not p.at_bound}


def undetermined_lines(parameters: Mapping[str, ParameterEstimate]) -> list[str]:
    """Return one line for the parameters at a bound, and one for the others that the data do not determine."""
    bound = [name for name, p in parameters.items() if p.at_bound]
    unknown = [name for name, p in parameters.items() if not (p.identifiable or p.at_bound)]
    lines = [f"not identifiable: {enumerated(unknown)}"] if unknown else []
    return lines + ([f"at a bound: {enumerated(bound)}"] if bound else [])


def window_line(maneuver: ManeuverResult) -> str:
    """Return how well one window is matched, or predicted: against a first-order lag, and against its 95 % band."""
    found = maneuver.channels
    filtered = [one for one in found.values() if one.innovations.known]
    compared = {name: one for name, one in found.items() if one.compared}
    parts = []
    if filtered:
        white = sum(one.innovations.whiteness.verdict == "white" for one in filtered)
        parts.append(f"innovations white in {white} of {count(len(filtered), 'channel')}")
    elif compared:
        better, lost = sum(one.better for one in compared.values()), [n for n in found if found[n].lost]
        text = f"better than a first-order lag in {better} of {count(len(compared), 'channel')}"
        unjudged = [name for name, one in found.items() if one.below_noise]
        exceptions = {"not in": lost, "not judged:": unjudged}
        notes = [f"{words} {enumerated(few_names(own))}" for words, own in exceptions.items() if own]
        parts.append(f"{text} ({'; '.join(notes)})" if notes else text)
    elif all(one.below_noise for one in found.values()):
        parts.append("no channel moves more than its noise")
    else:
        parts.append("no first-order lag to compare with")
    if within := {name: one.within for name, one in found.items() if math.isfinite(one.within)}:
        least = min(within, key=lambda name: within[name])
        parts.append(
            f"within the 95 % band {median(within.values()):.0%} of the readings of the median channel, "
            f"{within[least]:.0%} of {least}"
        )
    return f"{maneuver.window}: {'; '.join(parts)}"


def matched_line(maneuvers: Sequence[ManeuverResult]) -> str:
    """Return how well several windows together compare with first-order lags."""
    compared = [one for m in maneuvers for one in m.channels.values() if one.compared]
    windows = count(len(maneuvers), "window")
    if not compared:
        return windows
    better = sum(one.better for one in compared)
    return f"{windows}: better than a first-order lag in {better} of {len(compared)} comparisons"

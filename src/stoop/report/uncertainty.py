"""The uncertainty of the estimates, one method beside the other, and the identifiability of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.numbers import NOTHING, number, readable_unit, rounded_to_error
from stoop.report.charts import method_intervals
from stoop.report.estimates import label
from stoop.report.sheet import Bullets, Heading, Legend, Part, Prose, Section, Table
from stoop.results.result import Identification, ParameterEstimate
from stoop.results.uncertainty import Interval, MethodIntervals

TITLES: Final = {
    "corrected": "corrected for color",
    "cramer_rao": "Cramér–Rao, white",
    "bootstrap": "block bootstrap",
    "posterior": "posterior",
    "profile": "profile likelihood",
}
FIGURES: Final = {
    "replicates": "replicates",
    "dived": "of them by a full search",
    "lost": "of them without an optimum",
    "rhat": "greatest R-hat",
    "ess_bulk": "least effective sample size, bulk",
    "ess_tail": "least effective sample size, tails",
    "autocorrelation_time": "longest autocorrelation time, steps",
    "acceptance": "acceptance",
    "walkers": "walkers",
    "steps": "steps",
    "marginalization_error": "greatest error of the marginalization, log density",
    "refits": "refits",
}
LEAD: Final = (
    "The same estimates with 95 % intervals by each method, on a scale of each parameter’s own; the dashed line is the "
    "estimate. A faded bar that runs to the edge is open: the data give no limit there. A hollow dot has no interval: the "
    "parameter is not identifiable."
)
MULTIPLE: Final = "With a multiple correlation of nearly 1 the others can replace a parameter."


def uncertainty_section(identification: Identification) -> Section | None:
    """Return what to show; None for a result without it."""
    result = identification.result
    if not result.uncertainty:
        return None
    methods = {name: TITLES.get(name, name) for name in result.uncertainty}
    keys = []
    for name, one in result.uncertainty.items():
        figures = method_figures(one)
        keys.append((f"swatch {_kind(name)}key", methods[name] + (f" ({figures})" if figures else "")))
    notes = [f"{methods[name]}: {note}" for name, one in result.uncertainty.items() for note in one.notes]
    parts: list[Part] = [Prose(LEAD, muted=True)]
    parts += [Bullets(result.trust)] if result.trust else []
    parts += [Legend(keys)]
    parts += [Bullets(notes, "notes")] if notes else []
    rows = tuple(_row(identification, name, p) for name, p in result.parameters.items())
    kinds = ("", "methods", *("n" for _ in methods), "")
    sure = tuple("sure" if _is_sure(p) else "unsure" for p in result.parameters.values())
    head = ("Parameter", "95 % intervals, drawn", *methods.values(), "Unit")
    parts.append(Table("", head, rows, kinds, sure, "Standard errors and intervals by method"))
    parts += _identifiability(identification)
    return Section("Uncertainty, by method", parts, "Uncertainty")


def method_figures(one: MethodIntervals) -> str:
    """Return the statistics of a method; counts as whole numbers, others to three digits."""
    shown = {
        key: f"{value:.0f}" if float(value).is_integer() else number(value, 3)
        for key, value in one.figures.items()
    }
    return "; ".join(f"{FIGURES.get(key, key)} {text}" for key, text in shown.items())


def _kind(name: str) -> str:
    return f"method-{name if name in TITLES else 'other'}"


def _is_sure(one: ParameterEstimate) -> bool:
    return one.identifiable and not one.at_bound


def _row(identification: Identification, name: str, one: ParameterEstimate) -> tuple[str, ...]:
    found = {key: m.parameters.get(name) for key, m in identification.result.uncertainty.items()}
    texts = [
        f"{TITLES.get(key, key)} from {number(i.ci95_lower, 4)} to {number(i.ci95_upper, 4)}"
        for key, i in found.items()
        if i is not None
    ]
    drawn = [(_kind(key), interval) for key, interval in found.items()]
    return (
        label(identification, name),
        method_intervals(one.estimate, drawn, f"{name}: {'; '.join(texts)}"),
        *(_error(one, interval) for interval in found.values()),
        readable_unit(one.unit),
    )


def _error(one: ParameterEstimate, interval: Interval | None) -> str:
    if interval is None:
        return ""
    if not np.isfinite(interval.std_error):
        return NOTHING
    shown = rounded_to_error(one.estimate, interval.std_error)[1]
    return shown if _is_sure(one) else f"({shown})"


def _identifiability(identification: Identification) -> list[Part]:
    found = identification.result.identifiability
    rows = tuple(
        (
            label(identification, name),
            str(one.doubt),
            number(one.multiple_correlation, 5),
            ", ".join(one.partners),
            str(one.advice),
        )
        for name, one in found.parameters.items()
        if one.doubt
    )
    parts: list[Part] = []
    if rows:
        head = (
            "Parameter",
            "Doubt",
            "Multiple correlation",
            "Correlated with",
            "What would make it identifiable",
        )
        kinds = ("", "wrap", "n", "wrap", "wrap advice")
        parts += [
            Heading("Identifiability"),
            Prose(f"{_condition(found.singular_values)}{MULTIPLE}", muted=True),
            Table("", head, rows, kinds, label="Doubtful parameters"),
        ]
    if found.directions:
        lines = [f"{d.words} (singular value {number(d.singular_value, 2)})" for d in found.directions]
        parts += [Prose("Near-null directions, along which the data hardly change:"), Bullets(lines, "notes")]
    return parts


def _condition(values: Sequence[float]) -> str:
    if not values:
        return ""
    least = values[-1]
    ratio = f"{values[0] / least:.3g}" if least > 0.0 else "infinite"
    return (
        f"The sensitivities to all unknowns have {len(values)} singular values from {values[0]:.3g} to {least:.2g}, "
        f"condition {ratio}. "
    )

"""The uncertainty of the estimates, one method beside the other, and what the data can tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.base.numbers import NOTHING, number, readable_unit, rounded_to_error
from stoop.report.estimates import label
from stoop.report.svg import Scale, drawing, element, spanning
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
    "dived": "of them by a full dive",
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
WIDTH: Final = 340.0
BAR: Final = 9.0  #: px from one bar to the next


@dataclass(frozen=True)
class MethodView:
    """One method: its title, the class that colors it, how it went, and its notes."""

    title: str
    kind: str
    figures: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class MethodsRow:
    """One parameter: its bars and its standard error by each method; texts as shown."""

    name: Markup
    unit: str
    bars: Markup
    errors: tuple[str, ...]
    kind: str


@dataclass(frozen=True)
class DoubtRow:
    """One parameter that is in doubt, why, what could stand in for it, and what to do."""

    name: Markup
    doubt: str
    multiple: str
    partners: str
    advice: str


@dataclass(frozen=True)
class UncertaintyView:
    """What the page says about uncertainty."""

    methods: tuple[MethodView, ...]
    rows: tuple[MethodsRow, ...]
    doubts: tuple[DoubtRow, ...]
    condition: str


def uncertainty_view(identification: Identification) -> UncertaintyView | None:
    """Return what to show; None for a result that does not say."""
    result = identification.result
    if not result.uncertainty:
        return None
    return UncertaintyView(
        tuple(_method(name, spread) for name, spread in result.uncertainty.items()),
        tuple(_row(identification, name, p) for name, p in result.parameters.items()),
        tuple(_doubts(identification)),
        _condition(result.identifiability.singular_values),
    )


def _method(name: str, spread: MethodIntervals) -> MethodView:
    said = [f"{FIGURES.get(key, key)} {_figure(value)}" for key, value in spread.figures.items()]
    return MethodView(TITLES.get(name, name), f"method-{_class(name)}", "; ".join(said), spread.notes)


def _figure(value: float) -> str:
    """Return a count as the whole number that it is, any other figure to three digits."""
    return f"{value:.0f}" if float(value).is_integer() else number(value, 3)


def _class(name: str) -> str:
    return name if name in TITLES else "other"


def _row(identification: Identification, name: str, one: ParameterEstimate) -> MethodsRow:
    methods = identification.result.uncertainty
    spreads = [(key, m.parameters.get(name)) for key, m in methods.items()]
    sure = one.identifiable and not one.at_bound
    return MethodsRow(
        label(identification, name),
        readable_unit(one.unit),
        method_bars(one.estimate, spreads, f"{name}: {'; '.join(_said(key, s) for key, s in spreads if s)}"),
        tuple(_error(one, spread, sure) for _, spread in spreads),
        "sure" if sure else "unsure",
    )


def _error(one: ParameterEstimate, spread: Interval | None, sure: bool) -> str:
    if spread is None:
        return ""
    shown = rounded_to_error(one.estimate, spread.std_error)[1] if np.isfinite(spread.std_error) else NOTHING
    return shown if sure or shown == NOTHING else f"({shown})"


def _said(key: str, spread: Interval) -> str:
    ends = [number(end, 4) for end in (spread.ci95_lower, spread.ci95_upper)]
    return f"{TITLES.get(key, key)} from {ends[0]} to {ends[1]}"


def method_bars(estimate: float, spreads: Sequence[tuple[str, Interval | None]], description: str) -> Markup:
    """Return the estimate as a line and one interval per method under another; an open end runs to the edge."""
    ends = [e for _, s in spreads if s is not None for e in (s.ci95_lower, s.ci95_upper)]
    scale = Scale(*spanning([np.array([estimate, *ends])], 0.08), 4.0, WIDTH - 4.0)
    height = BAR * len(spreads) + 4.0
    parts = [
        element(
            "line",
            x1=scale.at(estimate),
            x2=scale.at(estimate),
            y1=1.0,
            y2=height - 1.0,
            class_="zeroline",
        )
    ]
    if scale.low < 0.0 < scale.high:
        parts.append(
            element("line", x1=scale.at(0.0), x2=scale.at(0.0), y1=0.0, y2=height, class_="grid zero")
        )
    for i, (key, spread) in enumerate(spreads):
        if spread is not None:
            parts += _bar(scale, estimate, spread, 2.0 + BAR * (i + 0.5), f"method-{_class(key)}")
    return drawing(WIDTH, height, description, parts)


def _bar(scale: Scale, estimate: float, spread: Interval, y: float, kind: str) -> list[Markup]:
    known = np.isfinite([spread.ci95_lower, spread.ci95_upper])
    dot = element(
        "circle", cx=scale.at(estimate), cy=y, r=2.6, class_=f"dot {kind}{'' if known.any() else ' nothing'}"
    )
    if not known.any():
        return [dot]
    left = scale.at(spread.ci95_lower) if known[0] else 0.0
    right = scale.at(spread.ci95_upper) if known[1] else WIDTH
    bar = element(
        "line", x1=left, x2=right, y1=y, y2=y, class_=f"interval {kind}{'' if known.all() else ' open'}"
    )
    return [bar, dot]


def _doubts(identification: Identification) -> list[DoubtRow]:
    seen = identification.result.identifiability.parameters
    return [
        DoubtRow(
            label(identification, name),
            sight.doubt,
            number(sight.multiple_correlation, 5),
            ", ".join(sight.partners),
            sight.advice,
        )
        for name, sight in seen.items()
        if sight.doubt
    ]


def _condition(values: Sequence[float]) -> str:
    if not values:
        return ""
    least = values[-1]
    ratio = f"{values[0] / least:.3g}" if least > 0.0 else "infinite"
    return f"{len(values)} singular values from {values[0]:.3g} to {least:.2g}, condition {ratio}"

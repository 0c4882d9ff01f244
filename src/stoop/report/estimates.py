"""Rows of the tables about what was estimated: parameters, correlations, states, biases, wind, noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from stoop.assess.covariance import NORMAL_95, correlation
from stoop.base.arrays import FloatArray
from stoop.base.numbers import NOTHING, clock, compact, number, readable_unit, rounded_to_error, window
from stoop.report.charts import ForestRow, forest_row
from stoop.report.formula import mathml
from stoop.results.result import Identification, ParameterEstimate, Quantity

STRONG: Final = 0.9  #: correlations above are listed
MOST_PAIRS: Final = 12


@dataclass(frozen=True)
class ParameterRow:
    """One line of the table of estimates; texts as shown."""

    name: Markup
    estimate: str
    error: str
    interval: str
    unit: str
    start: str
    prior: str
    bounds: str
    remark: str
    kind: str
    forest: Markup


@dataclass(frozen=True)
class QuantityRow:
    """One line of a table of states, biases or winds."""

    where: str
    name: Markup
    estimate: str
    error: str
    unit: str


def label(identification: Identification, name: str) -> Markup:
    """Return a name as its symbol with the plain name as its title, or the plain name."""
    latex = identification.symbols.get(name)
    if latex is None:
        return escape(name)
    return Markup('<span class="symbol" title="{}">{}</span>').format(name, mathml(latex))


def parameter_rows(identification: Identification) -> list[ParameterRow]:
    """Return the table of estimates."""
    return [_row(identification, name, one) for name, one in identification.result.parameters.items()]


def _row(identification: Identification, name: str, one: ParameterEstimate) -> ParameterRow:
    estimate, error = rounded_to_error(one.estimate, one.std_error)
    return ParameterRow(
        name=label(identification, name),
        estimate=estimate,
        error=error if one.identifiable else f"({error})",
        interval=_span(one.ci95_lower, one.ci95_upper, one.std_error),
        unit=readable_unit(one.unit),
        start=compact(one.start, 4),
        prior=NOTHING
        if math.isnan(one.prior_std)
        else f"{compact(one.prior_mean, 4)} ± {compact(one.prior_std)}",
        bounds=_bounds(one.bound_lower, one.bound_upper),
        remark=_remark(one),
        kind=_kind(one),
        forest=forest_row(_interval(one), f"{name}: {estimate}, standard error {error}, {_kind(one)}"),
    )


def _interval(one: ParameterEstimate) -> ForestRow:
    lower, upper = _drawn(one)
    return ForestRow(
        one.estimate,
        lower,
        upper,
        one.start,
        one.prior_mean - NORMAL_95 * one.prior_std,
        one.prior_mean + NORMAL_95 * one.prior_std,
        (one.bound_lower, one.bound_upper),
        _kind(one),
    )


def _drawn(one: ParameterEstimate) -> tuple[float, float]:
    """Return the ends of the bar: of a parameter that the data cannot tell, how wide its doubt is."""
    if one.identifiable or one.at_bound:
        return one.ci95_lower, one.ci95_upper
    return one.estimate - NORMAL_95 * one.std_error, one.estimate + NORMAL_95 * one.std_error


def _kind(one: ParameterEstimate) -> str:
    return "bound" if one.at_bound else "sure" if one.identifiable else "unsure"


def _remark(one: ParameterEstimate) -> str:
    said = []
    if one.at_bound:
        said.append("on its bound")
    if not one.identifiable:
        said.append("the data cannot tell")
    if math.isfinite(one.prior_std) and abs(one.estimate - one.prior_mean) > 3.0 * one.prior_std:
        said.append("more than 3 σ from its prior")
    return "; ".join(said)


def _span(lower: float, upper: float, error: float) -> str:
    if not (math.isfinite(lower) and math.isfinite(upper)):
        return NOTHING
    return f"{rounded_to_error(lower, error)[0]} … {rounded_to_error(upper, error)[0]}"


def _bounds(lower: float, upper: float) -> str:
    if math.isinf(lower) and math.isinf(upper):
        return NOTHING
    if lower == -upper:
        return f"± {compact(upper)}"
    return f"{compact(lower)} … {compact(upper)}"


def correlations(identification: Identification) -> tuple[list[str], FloatArray]:
    """Return the names and the correlation matrix (k, k) of the parameters."""
    covariance = identification.result.covariance
    return list(covariance.names), correlation(covariance.matrix)


def strong_pairs(names: list[str], matrix: FloatArray) -> list[tuple[str, str, str]]:
    """Return the most correlated pairs, with the coefficient."""
    pairs = [
        (abs(float(matrix[i, j])), names[i], names[j], number(float(matrix[i, j]), 3))
        for i in range(len(names))
        for j in range(i)
        if np.isfinite(matrix[i, j]) and abs(matrix[i, j]) >= STRONG
    ]
    return [pair[1:] for pair in sorted(pairs, key=lambda pair: -pair[0])[:MOST_PAIRS]]


def state_rows(identification: Identification) -> list[QuantityRow]:
    """Return the initial states of all segments."""
    rows = []
    for state in identification.result.initial_states:
        segment = f"segment {state.segment + 1} at {clock(state.time)} s"
        where = f"{_maneuver(identification, state.maneuver)}, {segment}"
        rows += _quantities(identification, where, state.values)
    return rows


def bias_rows(identification: Identification) -> list[QuantityRow]:
    """Return the sensor biases of all maneuvers."""
    return [
        row
        for bias in identification.result.biases
        for row in _quantities(identification, _maneuver(identification, bias.maneuver), bias.values)
    ]


def wind_rows(identification: Identification) -> list[QuantityRow]:
    """Return wind and pitot calibration of all flights."""
    return [
        row
        for wind in identification.result.wind
        for row in _quantities(identification, wind.flight, wind.values)
    ]


def noise_rows(identification: Identification) -> list[tuple[Markup, str, str]]:
    """Return the standard deviation of the measurement noise of every channel, with its unit."""
    noise = identification.result.noise_covariance
    deviations = np.sqrt(np.maximum(np.diag(noise.matrix), 0.0))
    return [
        (
            label(identification, name),
            number(float(value), 3),
            readable_unit(identification.units.get(name, "")),
        )
        for name, value in zip(noise.channels, deviations, strict=True)
    ]


def _maneuver(identification: Identification, index: int) -> str:
    maneuvers = identification.result.maneuvers
    if not 0 <= index < len(maneuvers):
        return f"maneuver {index + 1}"
    one = maneuvers[index]
    return f"{one.flight} {window(one.start, one.stop)}"


def _quantities(
    identification: Identification, where: str, values: Mapping[str, Quantity]
) -> list[QuantityRow]:
    rows = []
    for name, one in values.items():
        estimate, error = rounded_to_error(one.estimate, one.std_error)
        rows.append(QuantityRow(where, label(identification, name), estimate, error, readable_unit(one.unit)))
    return rows

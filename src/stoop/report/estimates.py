"""Tables of what was estimated: parameters and their correlation, states, biases, wind, noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from stoop.assessment.covariance import NORMAL_95, correlation
from stoop.base.numbers import NOTHING, clock, compact, number, readable_unit, rounded_to_error, window
from stoop.report.charts import correlation_map, forest_row
from stoop.report.formula import mathml
from stoop.report.sheet import Details, Drawing, Legend, Part, Prose, Section, Table
from stoop.results.result import Identification, ParameterEstimate, Quantity

STRONG_CORRELATION: Final = 0.9  #: pairs above are listed
MAX_PAIRS: Final = 12
FAR_FROM_PRIOR: Final = 3.0  #: standard deviations of the prior
ESTIMATES_LEAD: Final = (
    "Each row of the drawing has a scale of its own. A standard error in brackets belongs to a parameter that is not "
    "identifiable: it is no confident statement."
)
KEYS: Final = (
    ("swatch surekey", "estimate and 95 % interval"),
    ("swatch unsurekey", "not identifiable"),
    ("swatch boundkey", "at its bound"),
    ("swatch priorkey", "prior, 95 %"),
    ("swatch startkey", "vehicle file"),
    ("swatch edgekey", "bound"),
)
HEAD: Final = (
    "Parameter", "Estimate", "Std. error", "Unit", "Interval and prior, drawn", "95 % interval", "Start", "Prior",
    "Bounds", "Remark",
)  # fmt: skip


def label(identification: Identification, name: str) -> Markup:
    """Return a name as its symbol with the plain name as its title, or the plain name."""
    latex = identification.symbols.get(name)
    if latex is None:
        return escape(name)
    return Markup('<span class="symbol" title="{}">{}</span>').format(name, mathml(latex))


def estimates_section(identification: Identification) -> Section:
    """Return the table of estimates."""
    parameters = identification.result.parameters
    rows = tuple(_row(identification, name, one) for name, one in parameters.items())
    kinds = ("", "n", "n", "", "forest", "n", "n", "n", "n", "remark")
    row_kinds = tuple(estimate_kind(one) for one in parameters.values())
    table = Table("", HEAD, rows, kinds, row_kinds, "Estimates")
    return Section("Estimates", (Prose(ESTIMATES_LEAD, muted=True), Legend(KEYS), table))


def estimate_kind(one: ParameterEstimate) -> str:
    """Return the class of an estimate."""
    return "bound" if one.at_bound else "sure" if one.identifiable else "unsure"


def _row(identification: Identification, name: str, one: ParameterEstimate) -> tuple[str, ...]:
    estimate, error = rounded_to_error(one.estimate, one.std_error)
    kind, drawn = estimate_kind(one), (one.ci95_lower, one.ci95_upper)
    if kind == "unsure":  # no interval is given; the drawing shows how wide it would be
        drawn = (one.estimate - NORMAL_95 * one.std_error, one.estimate + NORMAL_95 * one.std_error)
    interval = prior = NOTHING
    if math.isfinite(one.ci95_lower) and math.isfinite(one.ci95_upper):
        ends = (rounded_to_error(end, one.std_error)[0] for end in (one.ci95_lower, one.ci95_upper))
        interval = " … ".join(ends)
    if not math.isnan(one.prior_std):
        prior = f"{compact(one.prior_mean, 4)} ± {compact(one.prior_std)}"
    return (
        label(identification, name),
        estimate,
        error if one.identifiable else f"({error})",
        readable_unit(one.unit),
        forest_row(one, drawn, kind, f"{name}: {estimate}, standard error {error}, {kind}"),
        interval,
        compact(one.start, 4),
        prior,
        _bounds(one.bound_lower, one.bound_upper),
        _remark(one),
    )


def _remark(one: ParameterEstimate) -> str:
    far = abs(one.estimate - one.prior_mean) > FAR_FROM_PRIOR * one.prior_std
    remarks = {
        "at its bound": one.at_bound,
        "not identifiable": not one.identifiable,
        "more than 3 σ from its prior": math.isfinite(one.prior_std) and far,
    }
    return "; ".join(text for text, holds in remarks.items() if holds)


def _bounds(lower: float, upper: float) -> str:
    if math.isinf(lower) and math.isinf(upper):
        return NOTHING
    return f"± {compact(upper)}" if lower == -upper else f"{compact(lower)} … {compact(upper)}"


def correlation_section(identification: Identification) -> Section | None:
    """Return the map of correlations; None with fewer than two parameters."""
    names = list(identification.result.covariance.names)
    if len(names) < 2:
        return None
    matrix = correlation(identification.result.covariance.matrix)
    pairs = [
        (abs(float(matrix[i, j])), f"{names[i]} and {names[j]} ({number(float(matrix[i, j]), 3)})")
        for i in range(len(names))
        for j in range(i)
        if np.isfinite(matrix[i, j]) and abs(matrix[i, j]) >= STRONG_CORRELATION
    ]
    strongest = "; ".join(text for _, text in sorted(pairs, key=lambda pair: -pair[0])[:MAX_PAIRS])
    lead = "Blue below zero, red above. Strongly correlated parameters are known together, not one by one. "
    lead += f"Strongest: {strongest}." if strongest else f"No pair exceeds {STRONG_CORRELATION}."
    drawn = Drawing("map", correlation_map(names, matrix), "Correlation map")
    return Section("Correlation between parameters", (Prose(lead, muted=True), drawn), "Correlation")


def nuisance_section(identification: Identification) -> Section | None:
    """Return noise, biases and initial states; None where there are none."""
    result = identification.result
    parts: list[Part] = []
    if result.noise_covariance.channels:
        parts.append(_noise(identification))
    biases = [(maneuver_name(identification, one.maneuver), one.values) for one in result.biases]
    states = [
        (
            f"{maneuver_name(identification, s.maneuver)}, segment {s.segment + 1} at {clock(s.time)} s",
            s.values,
        )
        for s in result.initial_states
    ]
    for title, place, groups in (
        ("Sensor biases", "Maneuver", biases),
        ("Initial states", "Segment", states),
    ):
        table = quantity_table(identification, title, place, groups)
        if table.rows:
            parts.append(Details(f"{title} ({len(table.rows)})", (table,)))
    return Section("Initial states, biases and noise", parts, "States and biases") if parts else None


def _noise(identification: Identification) -> Table:
    """Return the standard deviation of the measurement noise of every channel."""
    noise = identification.result.noise_covariance
    deviations = np.sqrt(np.maximum(np.diag(noise.matrix), 0.0))
    units = (readable_unit(identification.units.get(name, "")) for name in noise.channels)
    cells = tuple(f"{number(float(v), 3)} {u}" for v, u in zip(deviations, units, strict=True))
    caption = "Measurement noise used as weight, standard deviation"
    return Table(caption, tuple(label(identification, name) for name in noise.channels), (cells,))


def maneuver_name(identification: Identification, index: int) -> str:
    """Return the flight and the window of a maneuver."""
    maneuvers = identification.result.maneuvers
    if not 0 <= index < len(maneuvers):
        return f"maneuver {index + 1}"
    one = maneuvers[index]
    return f"{one.flight} {window(one.start, one.stop)}"


def quantity_table(
    identification: Identification,
    caption: str,
    place: str,
    groups: Iterable[tuple[str, Mapping[str, Quantity]]],
) -> Table:
    """Return quantities with their standard errors, each group named at its first."""
    rows: list[tuple[str, ...]] = []
    last = None
    for where, values in groups:
        for name, one in values.items():
            estimate, error = rounded_to_error(one.estimate, one.std_error)
            unit = readable_unit(one.unit)
            rows.append((where if where != last else "", label(identification, name), estimate, error, unit))
            last = where
    head = (place, "Quantity", "Estimate", "Std. error", "Unit")
    return Table(caption, head, tuple(rows), ("", "", "n", "n", ""))

"""What was estimated: parameters, correlation, uncertainty, identifiability; states, biases, noise; modes; repeatability."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from stoop.assessment.covariance import NORMAL_95, correlation
from stoop.base.notices import paragraph
from stoop.base.numbers import NOTHING, clock, compact, number, readable_unit, rounded_to_error, window
from stoop.report.charts import correlation_map, forest_row, interval_rows, repeatability_panel, share_row
from stoop.report.model import Model
from stoop.report.sheet import (
    Bullets,
    Details,
    Drawing,
    Heading,
    Legend,
    Panel,
    Panels,
    Part,
    Prose,
    Section,
    Table,
    mathml,
)
from stoop.results.modes import ConditionModes, DerivedValue, MeasuredMode, ModeEstimate
from stoop.results.result import Quantity, Result
from stoop.results.uncertainty import COMPONENTS, MethodIntervals

STRONG_CORRELATION: Final = 0.9  #: pairs above are listed
MAX_PAIRS: Final = 12
ROUNDING: Final = 1e-9  #: of the largest entry of a row: what rounding leaves where zero belongs
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
TITLES: Final = {
    "corrected": "corrected",
    "conditional": "given the model",
    "cramer_rao": "Cramér–Rao, white",
    "bootstrap": "block bootstrap",
    "posterior": "posterior",
    "profile": "profile likelihood",
}
#: figures that have longer names than their keys
FIGURES: Final = {
    "refined": "of them by a full search",
    "failed": "of them without an optimum",
    "dived": "of them by a full search",  # of results up to 0.1
    "lost": "of them without an optimum",  # likewise
    "rhat": "greatest R-hat",
    "ess_bulk": "least effective sample size, bulk",
    "ess_tail": "least effective sample size, tails",
    "std_error": "greatest Monte Carlo error of a standard deviation, of this",
    "autocorrelation_time": "longest autocorrelation time, steps",  # of results up to 0.1
    "divergences": "divergent transitions",
    "marginalization_error": "greatest error of the marginalization, log density",
}
UNCERTAINTY_LEAD: Final = (
    "The same estimates with 95 % intervals by each method, on a scale of each parameter’s own; the dashed line is the "
    "estimate. A faded bar that runs to the edge is open: the data give no limit there. A hollow dot has no interval: the "
    "parameter is not identifiable."
)
COMPONENTS_LEAD: Final = (
    "The covariance is the sum of these components; the bars show the share of each in the variance of a parameter. A component "
    "of less than nothing, where correlated residuals tell more than white ones would, is not drawn."
)
HOW_IDENTIFIABLE: Final = "What would make it identifiable"
MULTIPLE: Final = "With a multiple correlation of nearly 1 the others can replace a parameter."
MAX_DEVIATION: Final = 3.0  #: standard errors; of some twenty numbers on a page one is beyond two by chance
MODES_LEAD: Final = (
    "Of the fitted model, with 95 % intervals from the covariance of the parameters; beside them what a damped "
    "oscillation fitted to the record after the input shows, without any model of the aircraft; its error (±, one standard "
    "error) counts noise, what is no single oscillation, and that the response was flown about other airspeeds."
)
MODES_HEAD: Final = ("Mode", "rad/s", "95 %", "Damping", "95 %", "Time constant, s", "95 %", "In the record")
LINEAR_LEAD: Final = (
    "x′ = A x + B u of the fitted model: dimensional derivatives, SI units and radians, for deviations from the steady flight, "
    "with one standard error (±) from the covariance of the parameters. A dash in its place: the entry depends on a parameter "
    "that the data do not determine. Delays are in series with the inputs; stoop linearize and stoop export give C and D too."
)
BODY_HEAD: Final = ("Mass and reference values", "Value", "Unit", "From")
REPEATABILITY_LEAD: Final = (
    "Each fit has the same free parameters, bounds and priors; then each estimate’s own prior is taken out, so that it is "
    "the maneuver’s alone. A dash: not identifiable from that maneuver. Blue: one maneuver, 95 %; band: their weighted "
    "mean; black: the joint fit."
)
VERDICTS: Final = {"agree": "✓ agree", "scatter": "▲ scatter", "": NOTHING}


def label(identification: Model, name: str) -> Markup:
    """Return a name as its symbol with the plain name as its title, or the plain name."""
    if (latex := identification.symbols.get(name)) is None:
        return escape(name)
    return Markup('<span class="symbol" title="{}">{}</span>').format(name, mathml(latex))


def estimates_section(identification: Model) -> Section:
    """Return the table of estimates."""
    rows, kinds = [], []
    for name, one in identification.result.parameters.items():
        estimate, error = rounded_to_error(one.estimate, one.std_error)
        kind, drawn = "sure", (one.ci95_lower, one.ci95_upper)
        interval = prior = bounds = NOTHING
        if one.at_bound:
            kind = "bound"
        elif not one.identifiable:  # no interval is given; the drawing shows how wide it would be
            kind = "unsure"
            drawn = (one.estimate - NORMAL_95 * one.std_error, one.estimate + NORMAL_95 * one.std_error)
        if math.isfinite(one.ci95_lower) and math.isfinite(one.ci95_upper):
            ends = (rounded_to_error(end, one.std_error)[0] for end in (one.ci95_lower, one.ci95_upper))
            interval = " … ".join(ends)
        if not math.isnan(one.prior_std):
            prior = f"{compact(one.prior_mean, 4)} ± {compact(one.prior_std)}"
        lower, upper = one.bound_lower, one.bound_upper
        if not (math.isinf(lower) and math.isinf(upper)):
            bounds = f"± {compact(upper)}" if lower == -upper else f"{compact(lower)} … {compact(upper)}"
        far = abs(one.estimate - one.prior_mean) > FAR_FROM_PRIOR * one.prior_std
        remarks = ["at its bound"] if one.at_bound else []
        remarks += [] if one.identifiable else ["not identifiable"]
        remarks += ["more than 3 σ from its prior"] if math.isfinite(one.prior_std) and far else []
        row = forest_row(one, drawn, kind, f"{name}: {estimate}, standard error {error}, {kind}")
        numbers = (estimate, error if one.identifiable else f"({error})", readable_unit(one.unit))
        given = (compact(one.start, 4), prior, bounds)
        rows.append((label(identification, name), *numbers, row, interval, *given, "; ".join(remarks)))
        kinds.append(kind)
    columns = ("", "n", "n", "", "forest", "n", "n", "n", "n", "remark")
    table = Table("", HEAD, tuple(rows), columns, tuple(kinds), "Estimates")
    return Section("Estimates", (Prose(ESTIMATES_LEAD, muted=True), Legend(KEYS), table))


def correlation_section(identification: Model) -> Section | None:
    """Return the map of correlations; None with fewer than two parameters."""
    names = list(identification.result.covariance.names)
    if len(names) < 2:
        return None
    matrix = correlation(identification.result.covariance.matrix)
    places = ((i, j, float(matrix[i, j])) for i in range(len(names)) for j in range(i))
    pairs = sorted((p for p in places if abs(p[2]) >= STRONG_CORRELATION), key=lambda pair: -abs(pair[2]))
    strongest = "; ".join(f"{names[i]} and {names[j]} ({number(r, 3)})" for i, j, r in pairs[:MAX_PAIRS])
    lead = "Blue below zero, red above. Strongly correlated parameters are known together, not one by one. "
    lead += f"Strongest: {strongest}." if strongest else f"No pair exceeds {STRONG_CORRELATION}."
    drawn = Drawing("map", correlation_map(names, matrix), "Correlation map")
    return Section("Correlation between parameters", (Prose(lead, muted=True), drawn), "Correlation")


def nuisance_section(identification: Model) -> Section | None:
    """Return noise, biases and initial states; None where there are none."""
    result = identification.result
    parts: list[Part] = []
    noise = result.noise_covariance
    if noise.channels:
        deviations = np.sqrt(np.maximum(np.diag(noise.matrix), 0.0))
        units = (readable_unit(identification.units.get(name, "")) for name in noise.channels)
        cells = tuple(f"{number(float(v), 3)} {u}" for v, u in zip(deviations, units, strict=True))
        caption = "Measurement noise used as weight, standard deviation"
        parts.append(Table(caption, tuple(label(identification, n) for n in noise.channels), (cells,)))
    biases = [(_place(result, one.maneuver), one.values) for one in result.biases]
    states = []
    for one in result.initial_states:
        place = f"{_place(result, one.maneuver)}, segment {one.segment + 1} at {clock(one.time)} s"
        states.append((place, one.values))
    named = (("Sensor biases", "Maneuver", biases), ("Initial states", "Segment", states))
    for title, place, groups in named:
        table = quantity_table(identification, title, place, groups)
        if table.rows:
            parts.append(Details(f"{title} ({len(table.rows)})", (table,)))
    return Section("Initial states, biases and noise", parts, "States and biases") if parts else None


def _place(result: Result, index: int) -> str:
    """Return the flight and the window of a maneuver."""
    if not 0 <= index < len(result.maneuvers):
        return f"maneuver {index + 1}"
    one = result.maneuvers[index]
    return f"{one.flight} {window(one.start, one.stop)}"


def quantity_table(
    identification: Model, caption: str, place: str, groups: Iterable[tuple[str, Mapping[str, Quantity]]]
) -> Table:
    """Return quantities with their standard errors, each group named at its first."""
    rows: list[tuple[str, ...]] = []
    for where, values in groups:
        for i, (name, one) in enumerate(values.items()):
            numbers = rounded_to_error(one.estimate, one.std_error)
            rows.append(("" if i else where, label(identification, name), *numbers, readable_unit(one.unit)))
    head = (place, "Quantity", "Estimate", "Std. error", "Unit")
    return Table(caption, head, tuple(rows), ("", "", "n", "n", ""))


def uncertainty_section(identification: Model) -> Section | None:
    """Return uncertainty by method, one beside the other, and identifiability; None for a result without it."""
    result = identification.result
    if not result.uncertainty:
        return None
    methods = {name: TITLES.get(name, name) for name in result.uncertainty}
    classes = {name: f"method-{name if name in TITLES else 'other'}" for name in methods}
    keys, notes = [], []
    for name, method in result.uncertainty.items():
        figures = method_figures(method)
        keys.append((f"swatch {classes[name]}key", methods[name] + (f" ({figures})" if figures else "")))
        notes += [f"{methods[name]}: {note}" for note in method.notes]
    rows, kinds = [], []
    for name, one in result.parameters.items():
        sure = one.identifiable and not one.at_bound
        found = {key: m.parameters.get(name) for key, m in result.uncertainty.items()}
        texts, errors = [], dict.fromkeys(found, "")
        for key, interval in found.items():
            if interval is not None:
                ends = f"{number(interval.ci95_lower, 4)} to {number(interval.ci95_upper, 4)}"
                texts.append(f"{methods[key]} from {ends}")
                shown = rounded_to_error(one.estimate, interval.std_error)[1]
                known = np.isfinite(interval.std_error)
                errors[key] = NOTHING if not known else shown if sure else f"({shown})"
        intervals = [(classes[key], one.estimate, interval) for key, interval in found.items()]
        drawn = interval_rows(intervals, f"{name}: {'; '.join(texts)}")
        rows.append((label(identification, name), drawn, *errors.values(), readable_unit(one.unit)))
        kinds.append("sure" if sure else "unsure")
    columns = ("", "methods", *("n" for _ in methods), "")
    head = ("Parameter", "95 % intervals, drawn", *methods.values(), "Unit")
    caption = "Standard errors and intervals by method"
    parts: list[Part] = [Prose(UNCERTAINTY_LEAD, muted=True)]
    parts += [Bullets(result.trust)] if result.trust else []
    parts += [Legend(keys)]
    parts += [Bullets(notes, "notes")] if notes else []
    parts += [Table("", head, tuple(rows), columns, tuple(kinds), caption), *_components(identification)]
    parts += _identifiability(identification)
    return Section("Uncertainty, by method", parts, "Uncertainty")


def _components(identification: Model) -> list[Part]:
    """Return what each component adds to the variances, as stacked bars; nothing for a result of an older version."""
    found, rows = identification.result.components, []
    for name, one in identification.result.parameters.items():
        shares = found.shares(name)
        if shares:
            texts = [f"{c} {100.0 * share:.0f} %" for c, share in shares.items()]
            drawn = share_row({f"component-{c}": s for c, s in shares.items()}, f"{name}: {', '.join(texts)}")
            rows.append((label(identification, name), drawn, rounded_to_error(one.estimate, one.std_error)[1],
                         *(f"{100.0 * share:.0f} %" for share in shares.values())))  # fmt: skip
    if not rows:
        return []
    names = list(found.variances)
    keys = [(f"swatch component-{name}key", f"{name}: {COMPONENTS.get(name, name)}") for name in names]
    head = ("Parameter", "Shares, drawn", "Std. error", *names)
    table = Table("Shares of the variance", head, tuple(rows), ("", "methods", "n", *("n" for _ in names)))
    lead = COMPONENTS_LEAD + (f" Left out: {', '.join(found.left_out)}." if found.left_out else "")
    return [Heading("Components of the covariance"), Prose(lead, muted=True), Legend(keys), table]


def method_figures(one: MethodIntervals) -> str:
    """Return the statistics of a method; counts as whole numbers, others to three digits."""
    shown = {n: f"{x:.0f}" if float(x).is_integer() else number(x, 3) for n, x in one.figures.items()}
    return "; ".join(f"{FIGURES.get(name, name)} {text}" for name, text in shown.items())


def _identifiability(identification: Model) -> list[Part]:
    found, parts = identification.result.identifiability, list[Part]()
    rows = []
    for name, one in ((name, one) for name, one in found.parameters.items() if one.doubt):
        correlated = number(one.multiple_correlation, 5), ", ".join(one.partners)
        rows.append((label(identification, name), str(one.doubt), *correlated, paragraph(one.advice)))
    if rows:
        condition, values = "", found.singular_values
        if values:
            ratio = f"{values[0] / values[-1]:.3g}" if values[-1] > 0.0 else "infinite"
            condition = (
                f"The sensitivities to all unknowns have {len(values)} singular values from {values[0]:.3g} to "
                f"{values[-1]:.2g}, condition {ratio}. "
            )
        head = ("Parameter", "Doubt", "Multiple correlation", "Correlated with", HOW_IDENTIFIABLE)
        kinds = ("", "wrap", "n", "wrap", "wrap advice")
        parts += [Heading("Identifiability"), Prose(condition + MULTIPLE, muted=True)]
        parts += [Table("", head, tuple(rows), kinds, label="Doubtful parameters")]
    if found.directions:
        lines = [f"{d.words} (singular value {number(d.singular_value, 2)})" for d in found.directions]
        parts += [Prose("Near-null directions, along which the data hardly change:"), Bullets(lines, "notes")]
    return parts


def body_parts(identification: Model) -> list[Part]:
    """Return the table of mass, inertia and reference values: what the coefficients are for."""
    rows = []
    for name, one in identification.body.items():
        fixed = math.isnan(one.std_error)
        value = number(one.estimate) if fixed else " ± ".join(rounded_to_error(one.estimate, one.std_error))
        origin = "estimated" if name in identification.result.parameters else "vehicle file"
        rows.append((label(identification, name), value, readable_unit(one.unit), origin))
    return [Table("", BODY_HEAD, tuple(rows), ("", "n", "", ""), label=BODY_HEAD[0])] if rows else []


def linear_section(identification: Model) -> Section | None:
    """Return A and B with their standard errors, of further flight conditions folded up; None without any."""
    parts: list[Part] = [Prose(LINEAR_LEAD, muted=True)]
    for condition in (c for c in identification.result.modes if c.linear.states):
        title, found = _condition_title(identification, condition), condition.linear
        values, errors = np.hstack([found.A, found.B]), np.hstack([found.A_std, found.B_std])
        rows = tuple(
            (f"{state}′", *map(_entry, value, error, [ROUNDING * np.abs(value).max()] * len(value)))
            for state, value, error in zip(found.states, values, errors, strict=True)
        )
        head = ("", *found.states, *found.inputs)
        table = Table("", head, rows, ("", *["n"] * (len(head) - 1)), label=title)
        parts += [Heading(title), table] if len(parts) == 1 else [Details(title, (table,))]
    return Section("Linear model", parts) if len(parts) > 1 else None


def _entry(value: float, error: float, rounding: float) -> str:
    """Return an entry of a matrix over its standard error; what rounding leaves is zero."""
    if error <= rounding:
        return "0" if abs(value) <= rounding else compact(value, 4)
    return Markup('{}<br><span class="error">± {}</span>').format(*rounded_to_error(value, error))


def _condition_title(identification: Model, condition: ConditionModes) -> str:
    flown = ", ".join(filter(None, (_window(identification, i) for i in condition.maneuvers)))
    about = "steady straight flight" if condition.about == "trim" else "the mean state"
    place = f"{number(condition.airspeed, 3)} m/s, {number(condition.altitude, 3)} m, flown in {flown}"
    return f"About {about} at {place}"


def modes_section(identification: Model) -> Section | None:
    """Return the tables of all flight conditions; None without modes."""
    parts: list[Part] = [Prose(MODES_LEAD, muted=True)]
    for condition in identification.result.modes:
        title = _condition_title(identification, condition)
        parts.append(Heading(title))
        parts += [Prose(str(condition.remark), muted=True)] if condition.remark else []
        rows = []
        for mode in condition.modes:
            oscillates = mode.imag.estimate > 0.0
            remarks = [_measured(identification, mode, one) for one in mode.measured if oscillates]
            remarks += [*map(str, mode.remark), "intervals sampled" if mode.method == "sampled" else ""]
            remark = "; ".join(filter(None, remarks))
            oscillation = (*_pair(mode.frequency), *_pair(mode.damping)) if oscillates else (NOTHING, "") * 2
            rows.append((mode.name, *oscillation, *_pair(mode.time_constant), remark))
        kinds = ("", *("n",) * 6, "wrap")
        parts += [Table("", MODES_HEAD, tuple(rows), kinds, label=title)] if rows else []
    return Section("Natural modes", parts, "Modes") if identification.result.modes else None


def _window(identification: Model, maneuver: int) -> str:
    maneuvers = identification.result.maneuvers
    return window(maneuvers[maneuver].start, maneuvers[maneuver].stop) if maneuver < len(maneuvers) else ""


def _pair(one: DerivedValue) -> tuple[str, str]:
    """Return an estimate and its interval."""
    value = rounded_to_error(one.estimate, one.std_error)[0]
    if not (math.isfinite(one.ci95_lower) and math.isfinite(one.ci95_upper)):
        return value, NOTHING
    width = 0.25 * (one.ci95_upper - one.ci95_lower)
    return value, " … ".join(rounded_to_error(end, width)[0] for end in (one.ci95_lower, one.ci95_upper))


def _measured(identification: Model, mode: ModeEstimate, one: MeasuredMode) -> str:
    """Return a mode as the record shows it, compared with the model in units of both standard errors."""
    if math.isnan(one.frequency.estimate):
        return f"{_window(identification, one.maneuver)}: {one.remark}"
    pairs = ((mode.frequency, one.frequency), (mode.damping, one.damping))
    errors = [math.hypot(a.std_error, b.std_error) for a, b in pairs]
    off = [abs(a.estimate - b.estimate) / e for (a, b), e in zip(pairs, errors, strict=True) if e > 0.0]
    agreement = "agrees with the model"
    if not off or not all(map(math.isfinite, off)):
        agreement = "no interval to compare with"
    elif max(off) > MAX_DEVIATION:
        agreement = f"{max(off):.1f} standard errors from the model"
    found = (one.frequency, one.damping)
    frequency, damping = (" ± ".join(rounded_to_error(e.estimate, e.std_error)) for e in found)
    where = f"{', '.join(one.channels)} in {window(one.start, one.stop)}"
    return f"{frequency} rad/s, damping {damping} ({where}): {agreement}"


def repeatability_section(identification: Model) -> Section | None:
    """Return plots and table of the maneuvers fitted alone; None where that was not asked for."""
    found, result = identification.result.repeatability, identification.result
    if not found.maneuvers:
        return None
    titles = tuple(_window(identification, i) for i in found.maneuvers)
    listed = [f"{i}: {title}" for i, title in enumerate(titles, 1)] + list(map(str, found.remarks))
    lead = Prose(f"{found.summary()}\n\n{REPEATABILITY_LEAD}", muted=True)
    parts: list[Part] = [lead, Bullets(listed)]
    panels, rows = [], []
    for name, one in found.parameters.items():
        if not any(single.counted for single in one.singles):
            continue
        joint = result.parameters[name]
        verdict = VERDICTS[one.verdict] + (f" (p = {number(one.p_value, 2)})" if one.verdict else "")
        shown, unit = label(identification, name), readable_unit(joint.unit)
        panels.append(Panel(shown, repeatability_panel(name, one, joint), unit, note=verdict))
        singles = (_with_error(s.estimate, s.std_error) if s.counted else NOTHING for s in one.singles)
        mean, whole = _with_error(one.mean, one.std_error), _with_error(joint.estimate, joint.std_error)
        chi = f"{number(one.chi_square, 3)} / {one.degrees}" if one.verdict else NOTHING
        rows.append((shown, *singles, mean, whole, unit, chi, verdict))
    if rows:
        head = ("Parameter", *titles, "Weighted mean", "Joint fit", "Unit", "χ² / degrees", "Scatter")
        kinds = ("", *("n" for _ in titles), "n", "n", "", "n", "")
        parts += [Panels(panels), Table("", head, tuple(rows), kinds, label="Repeatability")]
    return Section("Repeatability: each maneuver fitted alone", parts, "Repeatability")


def _with_error(value: float, error: float) -> str:
    return " ± ".join(rounded_to_error(value, error)) if math.isfinite(error) else number(value)

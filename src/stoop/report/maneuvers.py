"""Maneuvers in a report: curves, goodness of fit, residuals; and air data of whole flights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.assessment.coloring import autocorrelation
from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import FloatArray, runs
from stoop.base.numbers import NOTHING, count, factor_and_unit, number, share, window
from stoop.base.variables import VARIABLES
from stoop.report import sheet
from stoop.report.charts import autocorrelation_panels
from stoop.report.estimates import label, quantity_table
from stoop.report.model import Model
from stoop.report.series import Range, Series, Shade, Strip, spanning
from stoop.report.time_history import RESPONSE_HEIGHT, HistoryPanel, TimeHistory, holes, with_residual
from stoop.results.result import (
    AirDataTrace,
    GoodnessOfFit,
    ManeuverResult,
    ManeuverTrace,
    Role,
    TheilShares,
    Whiteness,
)

MAX_VALUE: Final = 1e15  #: a simulation that has left for infinity is not drawn beyond
COLORED: Final = 4.0  #: standard errors of an autocorrelation that are no matter of chance in any channel
MAX_LAGS: Final = 100  #: samples over which autocorrelations are drawn
PREDICTS, PREDICTS_SOME = 0.75, 0.4  #: share of the comparisons with the lag that a predicting model wins
MAX_RATIO: Final = 100.0  #: of motion to noise; larger ones are shown alike
NOT_JUDGED: Final = "not judged"  #: of a channel of which no figure judges a model
AIR_HEIGHT: Final = 150.0  #: px
INPUT_HEIGHT: Final = 70.0  #: px
OVERVIEW_HEIGHT: Final = 64.0  #: px
MAX_REACH: Final = 3.0  #: a simulated curve may widen the axis to so many times the measured range
MIN_PAUSE: Final = 0.3  #: s without a sample break a curve
AIR_ROLES: Final = ("fit", "measured", "lag", "validation")
LEADS: Final = {
    "fit": (
        "The model was fitted to these maneuvers. Theil’s inequality coefficient U is 0 for a perfect match and 1 at worst; "
        "it is computed below 10 Hz. The lag is a trivial model, one time constant and one dead time from the command of the "
        "channel’s own axis, fitted to this very maneuver: a model that does not beat it proves nothing. Offset, amplitude "
        "and rest share out the squared error. S/N is the motion over the noise, both below 10 Hz: a grey channel moves less "
        "than its noise, and no figure of it judges the model."
    ),
    "validation": (
        "The initial state is estimated with the model from the second before the window (with rotors, anew each second), "
        "biases and wind are from outside the window. The band holds 95 % of readings: uncertain initial state and "
        "parameters, noise, and gusts where the fit is by a filter. "
        "The lag is given all commands; it was fitted to the maneuvers above and, unlike the model, is "
        "granted a bias of its own here."
    ),
}
#: how the model compares
AGAINST_LAG: Final = {"better": "✓ better", "worse": "▲ not better", "noise": "only noise", "": NOTHING}
TITLES: Final = {
    "fit": ("Fit: measured against simulated", "Fit"),
    "validation": ("Prediction: no parameter was fitted here", "Prediction"),
}
MORE_LEAD: Final = (
    "Left out: the RMS error had each second of the record been left out of the fit in turn (PRESS); far above the plain "
    "one, the model has too many unknowns for the record. Offset / amplitude / rest share out the squared error (Theil). Q: "
    "the statistic of Ljung and Box over 20 lags; above 31 the residuals are colored, and hold what the model lacks."
)
INNOVATIONS_LEAD: Final = (
    "Gusts move an aircraft away from any simulation, so that the model is judged by predictions from sample to sample (the "
    "innovations of the fitted filter; initial state and biases are estimated in the window, nothing else). With a right "
    "model their RMS over the expected standard deviation is 1, 95 % are within 1.96 of that, and they are white (Q as below)."
)
AIR_LEAD: Final = (
    "Estimated for each flight from attitude, ground velocity and accelerations (flight-path reconstruction). Wind is the "
    "velocity of the air over ground; true airspeed = pitot_scale × (reading − pitot_offset)."
)
HISTORY_LEAD: Final = (
    "Time in s of the log’s own clock; grey: no data. Below each response measured minus simulated."
)
AIRSPEEDS: Final = {
    "speed_inertial": "ground velocity minus wind",
    "pitot": "pitot as logged",
    "airspeed_pitot": "pitot as logged",
    "pitot_corrected": "pitot, corrected",
    "V": "V",
}
AIR_GROUPS: Final = (
    ("Airspeed", "m/s", AIRSPEEDS),
    ("Wind as logged", "m/s", {"wind_n_log": "north", "wind_e_log": "east"}),
    ("Angle of attack", "rad", {"alpha": "alpha"}),
    ("Sideslip", "rad", {"beta": "reconstructed", "beta_from_force": "from lateral force"}),
)  #: curves that share a drawing: title, unit, name in the trace -> legend


def segments_text(maneuver: ManeuverResult) -> str:
    """Return the stretches of a maneuver that were used."""
    return ", ".join(window(*segment) for segment in maneuver.segments)


def role_section(identification: Model, role: Role) -> sheet.Section | None:
    """Return the maneuvers of one role; None without any."""
    parts: list[sheet.Part] = [sheet.Prose(LEADS[role], muted=True)]
    for maneuver, trace in zip(identification.result.maneuvers, identification.traces, strict=True):
        if maneuver.role == role:
            parts.append(sheet.Heading(maneuver.title, role))
            parts += maneuver_parts(identification, maneuver, trace)
    title, short = TITLES[role]
    return sheet.Section(title, parts, short) if len(parts) > 1 else None


def maneuver_parts(identification: Model, maneuver: ManeuverResult, trace: ManeuverTrace) -> list[sheet.Part]:
    """Return what a maneuver shows: segments, goodness of fit, curves and inputs."""
    segments = segments_text(maneuver)
    each = " Each piece has its own initial state." if ", " in segments else ""
    names = [name for name in trace.channels if name in maneuver.channels]
    parts: list[sheet.Part] = [sheet.Prose(f"Data used: {segments}.{each}", muted=True)] if segments else []
    parts += [_goodness(identification, maneuver, names)]
    if any(one.innovations.known for one in maneuver.channels.values()):
        parts += [sheet.Prose(INNOVATIONS_LEAD, muted=True), _innovations(identification, maneuver)]
    parts.append(_more_goodness(identification, maneuver))
    history = _history(identification, maneuver, trace)
    return [*parts, sheet.Prose(HISTORY_LEAD, muted=True), history] if history.panels else parts


def _goodness(identification: Model, maneuver: ManeuverResult, names: Sequence[str]) -> sheet.Table:
    """Return the goodness of fit of every channel, Theil's coefficient drawn beside the lag's."""
    found = [v for one in maneuver.channels.values() for v in (one.theil, one.baseline_theil)]
    greatest = max((v for v in found if math.isfinite(v)), default=1.0)
    reach = max(0.1, math.ceil(10.0 * greatest - 1e-9) / 10.0)
    bar = Markup('<span class="{}" style="width:{}%"></span>')

    def length(theil: float) -> float:
        """Return the length of a bar in percent."""
        return round(100.0 * min(max(theil / reach, 0.0), 1.0), 1) if math.isfinite(theil) else 0.0

    rows, predicted = [], maneuver.role == "validation"
    for name in names:
        one = maneuver.channels[name]
        factor, unit = _shown_unit(identification, name)
        against = _against_lag(one)
        bars = bar.format(maneuver.role, length(one.theil))
        bars += bar.format("lag", length(one.baseline_theil)) if against else ""
        title = Markup('<span title="{}">{}</span>').format(_meaning(name), label(identification, name))
        theil = _decimals(one.theil), _decimals(one.baseline_theil)
        drawn = Markup('<span class="bars" aria-hidden="true">{}</span>').format(bars)
        match = AGAINST_LAG[against], _decimals(one.r2), number(one.fit_percent, 3)
        far = one.signal_to_noise >= MAX_RATIO
        noise = number(factor * one.noise, 2), f"> {MAX_RATIO:g}" if far else number(one.signal_to_noise, 2)
        inside = [share(one.inside)] if predicted else []
        error = number(factor * one.rmse, 3), unit
        rows.append((title, *error, *theil, drawn, *match, *noise, *inside, *_shares(one.theil_shares)))
    head = (
        "Channel", "RMS error", "Unit", "Theil U", "of the lag", f"0 … {number(reach, 1)}", "Against the lag", "R²", "Fit %",
        "Noise", "S/N", *(["In 95 % band"] if predicted else []), "Offset", "Amplitude", "Rest",
    )  # fmt: skip
    kinds = ("", "n", "", "n", "n", "", "", *["n"] * (len(head) - 7))
    calm = tuple("unsure" if maneuver.channels[name].below_noise else "" for name in names)
    return sheet.Table("", head, tuple(rows), kinds, calm, f"Goodness of fit, {maneuver.title}")


def _innovations(identification: Model, maneuver: ManeuverResult) -> sheet.Table:
    """Return the figures of predictions from sample to sample."""
    rows = []
    for name, one in ((name, own.innovations) for name, own in maneuver.channels.items()):
        if one.known:
            figures = number(one.rms, 3), share(one.inside), _decimals(one.whiteness.autocorrelation)
            rows.append((label(identification, name), *figures, *_whiteness(one.whiteness)))
    head = ("Channel", "RMS / expected", "Within 95 %", "Correlation of neighbors", "Q", "Innovations")
    title = f"Predicted from sample to sample, {maneuver.title}"
    return sheet.Table("", head, tuple(rows), ("", "n", "n", "n", "n", ""), label=title)


def _more_goodness(identification: Model, maneuver: ManeuverResult) -> sheet.Details:
    rows = []
    for name, one in maneuver.channels.items():
        factor, unit = _shown_unit(identification, name)
        for of, found in (("model", one), ("lag", one.baseline)):
            title = label(identification, name) if of == "model" else ""
            errors = number(factor * found.rmse, 3), number(factor * found.press, 3), unit
            match = _decimals(found.r2), " / ".join(_shares(found.theil_shares))
            rows.append((title, of, *errors, *match, *_whiteness(found.whiteness)))
    figures = ("RMS error", "Left out", "Unit", "R²", "Offset / amplitude / rest", "Q", "Residuals")
    head = ("Channel", "Of", *figures)
    kinds = ("", "", "n", "n", "", "n", "n", "n", "")
    table = sheet.Table("", head, tuple(rows), kinds, label=f"More figures, {maneuver.title}")
    return sheet.Details("More figures, each beside the lag’s", (sheet.Prose(MORE_LEAD, muted=True), table))


def _history(identification: Model, maneuver: ManeuverResult, trace: ManeuverTrace) -> TimeHistory:
    """Return inputs above responses, each response with its residual below."""
    panels = []
    for name, values in trace.inputs.items():
        factor, unit = _shown_unit(identification, name)
        series = Series("input", trace.time, finite_part(factor * values), role="input", width=1.3)
        strip = Strip("", (series,), height=INPUT_HEIGHT)
        title, meaning = label(identification, name), _meaning(name)
        panels.append(HistoryPanel(title, (strip,), unit, meaning, name=name, description=f"Input {name}."))
    panels += [_channel(identification, name, maneuver, trace) for name in trace.channels]
    return TimeHistory(panels, _window_option(identification, maneuver), _holes(trace))


def _window_option(identification: Model, maneuver: ManeuverResult) -> str:
    """Return what stands before a window on the command line."""
    flights = {one.flight for one in identification.result.maneuvers}
    return f"--maneuver {maneuver.flight}@" if len(flights) > 1 else "--maneuver "


def _holes(trace: ManeuverTrace) -> list[Shade]:
    return [Shade(*gap, "", "hole") for gap in holes(trace.time)]


def _channel(
    identification: Model, name: str, maneuver: ManeuverResult, trace: ManeuverTrace
) -> HistoryPanel:
    """Return measured against simulated, over the 95 % band, and their difference below."""
    unit, one = _shown_unit(identification, name)[1], maneuver.channels.get(name)
    curves = _responses(identification, name, maneuver.role, trace)
    strips = with_residual(curves, "residual", curves[0].y - curves[-1].y, response_range(curves))
    description, note = f"{name}, {_meaning(name)}: measured, simulated and their difference", ""
    description += f", {maneuver.title}"
    if one is not None:
        description += f"; Theil's coefficient {_decimals(one.theil)}"
        note = f"{_theil_note(one)} · R² {_decimals(one.r2)} · fit {number(one.fit_percent, 3)} %"
        note += f" · {NOT_JUDGED}: motion within noise and band" if one.below_noise else ""
    title, meaning = label(identification, name), _meaning(name)
    return HistoryPanel(title, strips, unit, meaning, note, name, f"{description}.")


def _responses(identification: Model, name: str, role: Role, trace: ManeuverTrace) -> list[Series]:
    """Return a channel as it was measured, by a first-order lag if there is one, and simulated over its 95 % band."""
    factor, channel = _shown_unit(identification, name)[0], trace.channels[name]
    measured, simulated = (finite_part(factor * v) for v in (channel.measured, channel.simulated))
    half = None if channel.deviation is None else finite_part(NORMAL_95 * factor * channel.deviation)
    curves = [Series("measured", trace.time, measured, role="measured", width=2.8)]
    if name in trace.baseline:
        lag = finite_part(factor * trace.baseline[name])
        curves.append(Series("first-order lag", trace.time, lag, role="lag", width=1.2))
    return [*curves, Series("simulated", trace.time, simulated, role=role, half_width=half)]


def _theil_note(one: GoodnessOfFit) -> str:
    """Return Theil's coefficient beside that of the lag, and which is better."""
    mark = {"better": " ✓", "worse": " ▲"}.get(_against_lag(one), "")
    return f"U {_decimals(one.theil)}" + (f" · lag {_decimals(one.baseline_theil)}{mark}" if mark else "")


def overview_parts(identification: Model, role: Role) -> list[sheet.Part]:
    """Return the responses of the maneuvers of a role in small panels: the first shown, the others folded."""
    parts: list[sheet.Part] = []
    for maneuver, trace in zip(identification.result.maneuvers, identification.traces, strict=True):
        if maneuver.role == role and trace.channels:
            title, history = maneuver.title, _overview(identification, maneuver, trace)
            parts += [sheet.Details(title, (history,))] if parts else [sheet.Heading(title, role), history]
    return parts


def _overview(identification: Model, maneuver: ManeuverResult, trace: ManeuverTrace) -> TimeHistory:
    panels = []
    for name in trace.channels:
        curves = _responses(identification, name, maneuver.role, trace)
        strip = response_strip(curves, OVERVIEW_HEIGHT)
        one, unit = maneuver.channels.get(name), _shown_unit(identification, name)[1]
        note = "" if one is None else NOT_JUDGED if one.below_noise else _theil_note(one)
        text = f"{name}, {_meaning(name)}: measured and simulated, {maneuver.title}."
        title = label(identification, name)
        panels.append(HistoryPanel(title, (strip,), unit, "", note, name, text))
    return TimeHistory(panels, _window_option(identification, maneuver), _holes(trace), compact=True)


def response_strip(curves: Sequence[Series], height: float = RESPONSE_HEIGHT) -> Strip:
    """Return a strip of responses, in the range of the first of them."""
    return Strip("", tuple(curves), height=height, y_range=response_range(curves))


def response_range(curves: Sequence[Series]) -> Range:
    """Return the range of a response: a diverged simulation may not flatten the measurements to a line."""
    known = curves[0].y if np.isfinite(curves[0].y).any() else curves[-1].y
    low, high = spanning([known])
    room = MAX_REACH * (high - low)
    limited = (np.clip(one.y, low - room, high + room) for one in curves)
    return spanning([np.array([low, high]), *limited], 0.02)


def residuals_section(identification: Model) -> sheet.Section | None:
    """Return the autocorrelation of the residuals of every channel over the fitted maneuvers."""
    found: dict[str, tuple[list[FloatArray], float]] = {}  # channel -> residuals by segment, sample period
    for maneuver, trace in zip(identification.result.maneuvers, identification.traces, strict=True):
        steps = np.diff(trace.time)
        steps = steps[np.isfinite(steps)]
        period, segments = float(np.median(steps)) if steps.size else 1.0, runs(np.isfinite(trace.time))
        for name, channel in trace.channels.items() if maneuver.role == "fit" and len(segments) else ():
            residual = finite_part(channel.measured - channel.simulated)
            found.setdefault(name, ([], period))[0].extend(residual[a:b] for a, b in segments)
    shown, colored = dict[str, tuple[FloatArray, float, int]](), list[str]()
    for name, (residuals, period) in found.items():
        lags = min(MAX_LAGS, max(len(piece) for piece in residuals) - 1)
        samples = sum(int(np.isfinite(piece).sum()) for piece in residuals)
        values = autocorrelation([piece[:, None] for piece in residuals], lags)[0]
        if samples < 3 or not np.isfinite(values).all():
            continue
        shown[name] = values, period, samples
        if lags and abs(values[1]) > COLORED / math.sqrt(samples):
            colored.append(name)
    if not shown:
        return None
    drawings = autocorrelation_panels(shown).items()
    panels = [sheet.Panel(label(identification, n), drawn, meaning=_meaning(n)) for n, drawn in drawings]
    lead = (
        "Autocorrelation of the residuals in the fitted maneuvers against lag in s. Of white residuals all but the first "
        "point lie in the band. "
    )
    lead += (
        f"It is clearly left by {len(colored)} of {len(panels)} channels: there the residuals hold physics or turbulence "
        "that the model lacks, and a plain Cramér–Rao bound is too small."
        if colored
        else "No channel clearly leaves it."
    )
    parts = (sheet.Prose(lead, muted=True), sheet.Panels(panels, "small"))
    return sheet.Section("Residuals: what the model leaves over", parts, "Residuals")


def comparison_table(maneuvers: Sequence[ManeuverResult]) -> sheet.Table:
    """Return Theil's coefficients of all maneuvers and channels, the lag's beneath the model's."""
    channels = tuple(dict.fromkeys(name for m in maneuvers for name in m.channels))
    rows: list[tuple[str, ...]] = []
    for m in maneuvers:
        found = [m.channels.get(name) for name in channels]
        mark = Markup('<span class="{}">{}</span>')
        model = (mark.format(_against_lag(one), _decimals(one.theil)) if one else NOTHING for one in found)
        lag = (_decimals(one.baseline_theil) if one else NOTHING for one in found)
        rows += [(m.title, "model", *model), ("", "lag", *lag)]
    kinds = ("", "", *("n" for _ in channels))
    return sheet.Table("", ("Maneuver", "Of", *channels), tuple(rows), kinds, label="Theil's coefficients")


def prediction_verdict(maneuvers: Sequence[ManeuverResult], refused: bool) -> sheet.Verdict:
    """Return how well a model predicts, by the share of channels in which it beats the lag, or its innovations are white.

    A model that the verdict of its identification refused is no good one for that.
    """
    figures = [one for m in maneuvers for one in m.channels.values()]
    compared = [one.better for one in figures if one.compared]
    better = sum(compared) / len(compared) if compared else 0.0
    filtered = [one for one in figures if one.innovations.known]
    level: sheet.Level
    if filtered:
        white = sum(one.innovations.whiteness.verdict == "white" for one in filtered)
        level = "good" if white > PREDICTS * len(filtered) else "caution"
        of = f"{white} of {count(len(filtered), 'channel')}"
        headline = f"Predicted from sample to sample, innovations are white in {of}."
    elif not compared:
        level, headline = "caution", "There is no trivial model to compare with."
    elif better > PREDICTS:
        level = "good"
        headline = "The model predicts what it was not fitted to, better than a first-order lag."
    elif better > PREDICTS_SOME:
        level, headline = "caution", "The model predicts some of what it was not fitted to."
    else:
        level, headline = "bad", "A first-order lag predicts as well."
    if refused:
        level, headline = "bad", f"{headline.removesuffix('.')}, but its identification says: do not use it."
    return sheet.Verdict(level, headline)


def air_section(identification: Model) -> sheet.Section | None:
    """Return wind, pitot calibration and air data of all flights; None without any."""
    result = identification.result
    parts: list[sheet.Part] = [sheet.Prose(AIR_LEAD, muted=True)]
    parts += [sheet.Bullets(one.notes) for one in result.wind if one.notes]
    winds = [(one.flight, one.values) for one in result.wind]
    if winds:
        parts.append(quantity_table(identification, "Wind and pitot calibration", "Flight", winds))
    for air in identification.air_data:
        history = air_history(identification, air)
        parts += [sheet.Heading(air.flight), history] if history.panels else []
    return sheet.Section("Wind and pitot", parts) if len(parts) > 1 else None


def air_history(identification: Model, air: AirDataTrace) -> TimeHistory:
    """Return the air data of a flight; curves of no known kind get a panel each."""
    known = {name for _, _, curves in AIR_GROUPS for name in curves}
    others = [(n, identification.units.get(n, ""), {n: n}) for n in air.curves if n not in known]
    steps, panels = np.diff(air.time), []
    pause = max(MIN_PAUSE, 5.0 * float(np.median(steps)) if steps.size else MIN_PAUSE)
    pauses = np.flatnonzero(steps > pause) + 1
    time = np.insert(air.time, pauses, np.nan)
    for title, unit, curves in (*AIR_GROUPS, *others):
        factor, shown_unit = factor_and_unit(unit)
        series = [
            Series(text, time, np.insert(finite_part(factor * air.curves[name]), pauses, np.nan), role=role)
            for (name, text), role in zip(curves.items(), cycle(AIR_ROLES), strict=False)
            if name in air.curves
        ]
        # Later curves are drawn over earlier ones: the reconstructed one comes first and is drawn last.
        strip = Strip("", tuple(series[::-1]), height=AIR_HEIGHT)
        description = f"{title} over the flight."
        panels += [HistoryPanel(title, (strip,), shown_unit, description=description)] if series else []
    return TimeHistory(panels)


def finite_part(values: FloatArray) -> FloatArray:
    """Return `values` (n,) with NaN where they have left for infinity."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < MAX_VALUE, values, np.nan)


def _against_lag(one: GoodnessOfFit) -> str:
    """Return "better" or "worse" than the lag, "noise" where only that is left to compare; empty without a lag."""
    if one.below_noise or (one.compared and not one.better and not one.lost):
        return "noise"
    return ("better" if one.better else "worse") if one.compared else ""


def _shares(shares: TheilShares) -> list[str]:
    return [share(part) for part in (shares.bias, shares.variance, shares.covariance)]


def _whiteness(one: Whiteness) -> tuple[str, str]:
    return number(one.statistic, 3), one.verdict or NOTHING


def _meaning(name: str) -> str:
    meaning = VARIABLES[name].meaning if name in VARIABLES else ""
    return meaning if meaning != name else ""


def _shown_unit(identification: Model, name: str) -> tuple[float, str]:
    """Return by what a channel is multiplied to be drawn, and its unit then."""
    known = VARIABLES[name].unit if name in VARIABLES else ""
    return factor_and_unit(identification.units.get(name, known))


def _decimals(value: float) -> str:
    return number(value, 3) if not math.isfinite(value) else f"{value:.3f}".replace("-", "−")

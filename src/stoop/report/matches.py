"""What one maneuver shows: its curves, its figures of merit, and what its residuals look like."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.assess.colored_residuals import autocorrelation
from stoop.base.arrays import FloatArray, runs
from stoop.base.numbers import NOTHING, factor_and_unit, number, share, window
from stoop.base.variables import VARIABLES
from stoop.report.charts import Curves, autocorrelation_panel, channel_panel, plain_panel
from stoop.report.estimates import label
from stoop.results.result import GoodnessOfFit, Identification, ManeuverResult, ManeuverTrace, TheilShares

ABSURD: Final = 1e15  #: a simulation that has left for infinity is not drawn on
EVIDENT: Final = 4.0  #: standard errors of an autocorrelation: no matter of chance in any channel
MOSTLY, HARDLY = (
    0.75,
    0.4,
)  #: of the comparisons with the lag: won by a model that predicts, by one that hardly does
LAGS: Final = 100  #: samples over which autocorrelations are drawn


@dataclass(frozen=True)
class FigureRow:
    """Figures of merit of one channel; texts as shown."""

    name: Markup
    meaning: str
    unit: str
    rmse: str
    theil: str
    lag: str
    better: str  #: "better", "worse", or "" without a baseline
    r2: str
    shares: tuple[str, str, str]
    bars: tuple[float, float]  #: Theil's coefficient of model and lag, in parts of the table's `reach`


@dataclass(frozen=True)
class SkillRow:
    """Further figures of one channel, of the model and of the lag; texts as shown."""

    name: Markup
    unit: str
    rmse: tuple[str, str]
    press: tuple[str, str]
    r2: tuple[str, str]
    shares: tuple[str, str]
    ljung_box: tuple[str, str]
    verdict: tuple[str, str]


@dataclass(frozen=True)
class Panel:
    """One drawing with its heading."""

    name: Markup
    meaning: str  #: or the key of its curves
    unit: str
    figures: FigureRow | None
    drawing: Markup


@dataclass(frozen=True)
class ManeuverView:
    """One maneuver as the page shows it."""

    title: str
    role: str
    segments: str
    rows: tuple[FigureRow, ...]
    skills: tuple[SkillRow, ...]
    reach: float  #: to which Theil's coefficient the bars of the rows run
    panels: tuple[Panel, ...]
    inputs: tuple[Panel, ...]


def maneuver_views(identification: Identification) -> list[ManeuverView]:
    """Return all maneuvers in the order of the result."""
    pairs = zip(identification.result.maneuvers, identification.traces, strict=True)
    return [_view(identification, maneuver, trace) for maneuver, trace in pairs]


@dataclass(frozen=True)
class SummaryCell:
    """Theil's coefficient of the model and of the lag; texts as shown."""

    model: str
    lag: str
    better: str


@dataclass(frozen=True)
class SummaryRow:
    """One maneuver of the overview."""

    title: str
    cells: tuple[SummaryCell, ...]


@dataclass(frozen=True)
class Summary:
    """All maneuvers and channels at a glance."""

    level: str
    headline: str
    channels: tuple[str, ...]
    rows: tuple[SummaryRow, ...]


def summary(maneuvers: Sequence[ManeuverResult]) -> Summary:
    """Return Theil's coefficients of all maneuvers in one table, and what they say together."""
    channels = tuple(dict.fromkeys(name for m in maneuvers for name in m.channels))
    rows = tuple(SummaryRow(maneuver_title(m), tuple(_cell(m, name) for name in channels)) for m in maneuvers)
    told = [cell.better for row in rows for cell in row.cells if cell.better]
    share = told.count("better") / len(told) if told else 0.0
    level = "good" if share > MOSTLY else "caution" if share > HARDLY or not told else "bad"
    return Summary(level, _headline(share, bool(told)), channels, rows)


def _headline(share: float, compared: bool) -> str:
    if not compared:
        return "There is no trivial model to compare with."
    if share > MOSTLY:
        return "The model predicts what it was not fitted to, better than a first-order lag."
    return (
        "The model predicts some of what it was not fitted to."
        if share > HARDLY
        else "A first-order lag predicts as well."
    )


def _cell(maneuver: ManeuverResult, name: str) -> SummaryCell:
    one = maneuver.channels.get(name)
    if one is None:
        return SummaryCell(NOTHING, NOTHING, "")
    return SummaryCell(_decimals(one.theil), _decimals(one.baseline_theil), _against_lag(one))


def _against_lag(one: GoodnessOfFit) -> str:
    compared = math.isfinite(one.baseline_theil) and math.isfinite(one.theil)
    return ("better" if one.theil < one.baseline_theil else "worse") if compared else ""


def maneuver_title(maneuver: ManeuverResult) -> str:
    """Return e.g. ``flight2, 140–145 s``."""
    return f"{maneuver.flight}, {window(maneuver.start, maneuver.stop)}"


def _view(identification: Identification, maneuver: ManeuverResult, trace: ManeuverTrace) -> ManeuverView:
    reach = _reach(maneuver)
    rows = {
        name: _figures(identification, name, maneuver.channels[name], reach)
        for name in trace.channels
        if name in maneuver.channels
    }
    panels = tuple(_panel(identification, name, maneuver, trace, rows.get(name)) for name in trace.channels)
    return ManeuverView(
        title=maneuver_title(maneuver),
        role=maneuver.role,
        segments=", ".join(window(*segment) for segment in maneuver.segments),
        rows=tuple(rows.values()),
        skills=tuple(_skill(identification, name, one) for name, one in maneuver.channels.items()),
        reach=reach,
        panels=panels,
        inputs=tuple(_input(identification, name, trace) for name in trace.inputs),
    )


def _reach(maneuver: ManeuverResult) -> float:
    """Return the greatest of Theil's coefficients, rounded up to a tenth."""
    found = [value for one in maneuver.channels.values() for value in (one.theil, one.baseline_theil)]
    return max(0.1, math.ceil(10.0 * max((v for v in found if math.isfinite(v)), default=1.0) - 1e-9) / 10.0)


def _figures(identification: Identification, name: str, one: GoodnessOfFit, reach: float) -> FigureRow:
    factor, unit = factor_and_unit(_unit(identification, name))
    parts = one.theil_shares
    return FigureRow(
        name=label(identification, name),
        meaning=_meaning(name),
        unit=unit,
        rmse=number(factor * one.rmse, 3),
        theil=_decimals(one.theil),
        lag=_decimals(one.baseline_theil),
        better=_against_lag(one),
        r2=_decimals(one.r2),
        shares=(share(parts.bias), share(parts.variance), share(parts.covariance)),
        bars=(_unit_interval(one.theil / reach), _unit_interval(one.baseline_theil / reach)),
    )


def _skill(identification: Identification, name: str, one: GoodnessOfFit) -> SkillRow:
    factor, unit = factor_and_unit(_unit(identification, name))
    lag = one.baseline
    return SkillRow(
        name=label(identification, name),
        unit=unit,
        rmse=(number(factor * one.rmse, 3), number(factor * lag.rmse, 3)),
        press=(number(factor * one.press, 3), number(factor * lag.press, 3)),
        r2=(_decimals(one.r2), _decimals(lag.r2)),
        shares=(_shares(one.theil_shares), _shares(lag.theil_shares)),
        ljung_box=(number(one.whiteness.statistic, 3), number(lag.whiteness.statistic, 3)),
        verdict=(one.whiteness.verdict or NOTHING, lag.whiteness.verdict or NOTHING),
    )


def _shares(parts: TheilShares) -> str:
    return " / ".join(share(part) for part in (parts.bias, parts.variance, parts.covariance))


def _panel(
    identification: Identification,
    name: str,
    maneuver: ManeuverResult,
    trace: ManeuverTrace,
    figures: FigureRow | None,
) -> Panel:
    factor, unit = factor_and_unit(_unit(identification, name))
    channel = trace.channels[name]
    baseline = trace.baseline.get(name)
    curves = Curves(
        trace.time,
        sane(factor * channel.measured),
        sane(factor * channel.simulated),
        None if baseline is None else sane(factor * baseline),
    )
    words = f"{name}, {_meaning(name)}: measured, simulated and their difference, {maneuver_title(maneuver)}"
    said = f"{words}; Theil's coefficient {figures.theil}." if figures else f"{words}."
    drawing = channel_panel(curves, maneuver.role, said)
    return Panel(label(identification, name), _meaning(name), unit, figures, drawing)


def _input(identification: Identification, name: str, trace: ManeuverTrace) -> Panel:
    factor, unit = factor_and_unit(_unit(identification, name))
    drawing = plain_panel(trace.time, [("input", sane(factor * trace.inputs[name]))], f"Input {name}.")
    return Panel(label(identification, name), _meaning(name), unit, None, drawing)


def autocorrelation_panels(identification: Identification) -> tuple[list[Panel], list[str]]:
    """Return the autocorrelation of the residuals of every channel over the fit maneuvers, and which are colored."""
    pieces = _residual_pieces(identification)
    panels, colored = [], []
    for name, (residuals, period) in pieces.items():
        lags = min(LAGS, max(len(piece) for piece in residuals) - 1)
        samples = sum(int(np.isfinite(piece).sum()) for piece in residuals)
        values = autocorrelation([piece[:, None] for piece in residuals], lags)[0]
        if samples < 3 or not np.isfinite(values).all():
            continue
        panels.append(
            Panel(
                label(identification, name),
                _meaning(name),
                "",
                None,
                autocorrelation_panel(values, period, samples, name),
            )
        )
        if lags and abs(values[1]) > EVIDENT / math.sqrt(samples):
            colored.append(name)
    return panels, colored


def _residual_pieces(identification: Identification) -> Mapping[str, tuple[list[FloatArray], float]]:
    """Return the residuals of every channel by segment, and the sample period."""
    found: dict[str, tuple[list[FloatArray], float]] = {}
    for maneuver, trace in zip(identification.result.maneuvers, identification.traces, strict=True):
        if maneuver.role != "fit":
            continue
        for name, channel in trace.channels.items():
            residual = sane(channel.measured - channel.simulated)
            pieces = [residual[a:b] for a, b in runs(np.isfinite(trace.time))]
            if pieces:
                found.setdefault(name, ([], _period(trace.time)))[0].extend(pieces)
    return found


def _meaning(name: str) -> str:
    meaning = VARIABLES[name].meaning if name in VARIABLES else ""
    return meaning if meaning != name else ""


def _unit(identification: Identification, name: str) -> str:
    known = VARIABLES[name].unit if name in VARIABLES else ""
    return identification.units.get(name, known)


def _period(time: FloatArray) -> float:
    steps = np.diff(time)
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if steps.size else 1.0


def sane(values: FloatArray) -> FloatArray:
    """Return `values` (n,) with NaN where they have left for infinity."""
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values) < ABSURD, values, np.nan)


def _decimals(value: float) -> str:
    return number(value, 3) if not math.isfinite(value) else f"{value:.3f}".replace("-", "−")


def _unit_interval(value: float) -> float:
    return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0

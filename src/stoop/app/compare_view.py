"""Two runs side by side: estimates, intervals, predictions."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.plotting import figure

from stoop.app import parts
from stoop.app.fit_view import finished, result
from stoop.app.plots import COLORS, SOFT, calm
from stoop.app.view import View
from stoop.assessment.covariance import NORMAL_95
from stoop.base.numbers import rounded_to_error
from stoop.results.result import ParameterEstimate, Result

THEIL: Final = "Theil's inequality coefficient: 0 is perfect, 1 useless."
ROW: Final = 22  #: pixels of a parameter


class CompareView(View):
    """Choose two runs, see what differs."""

    title = "Compare"

    def __init__(self, project: Any, go: Any) -> None:
        super().__init__(project, go)
        self._picks = [
            pn.widgets.Select(label=name, margin=(0, 12, 8, 0), sizing_mode="stretch_width", max_width=440)
            for name in ("run A (blue)", "run B (orange)")
        ]
        self._shown = pn.Column(margin=0, sizing_mode="stretch_width")
        for pick in self._picks:
            pick.param.watch(lambda e: self._compare(), "value")

    def refresh(self) -> None:
        """Offer the runs that are done; the last two are compared."""
        runs = finished(self.project)
        if len(runs) < 2:
            self.body[:] = [
                parts.html(
                    "<p class='soft'>Two runs with a result are needed; change a number or a window and run again.</p>"
                )
            ]
            return
        names = list(runs)
        for pick, last in zip(self._picks, names[-2:], strict=True):
            kept = pick.value if pick.value in names else last
            pick.param.update(options=names, value=kept)
        self.body[:] = [pn.FlexBox(*self._picks), self._shown]
        self._compare()

    def _compare(self) -> None:
        runs = finished(self.project)
        both = [runs[p.value] for p in self._picks if p.value in runs]
        if len(both) < 2:
            return
        a, b = map(result, both)
        verdicts = "".join(
            f"<p><b>{s.name}</b>: {parts.escaped(r.verdict.headline)}</p>"
            for s, r in zip(both, (a, b), strict=True)
        )
        self._shown[:] = [
            parts.html(verdicts + "<h3>Estimates</h3>"),
            pn.FlexBox(
                parts.html(estimates(a, b), sizing_mode=None, styles={"max-width": "100%"}),
                pn.pane.Bokeh(intervals(a, b), margin=(0, 0, 0, 8)),
            ),
            parts.html(f"<h3>Fit and prediction</h3>{parts.soft(THEIL)}{predictions(a, b)}"),
        ]


def estimates(a: Result, b: Result) -> str:
    """Return the table of estimates; the difference is in standard errors of both."""

    def shown(p: ParameterEstimate | None) -> str:
        if p is None:
            return "fixed"
        value, error = rounded_to_error(p.estimate, p.std_error)
        return f"{value} ± {error}" if p.identifiable else f"{value} (not identifiable)"

    rows = []
    for name in dict.fromkeys([*a.parameters, *b.parameters]):
        p, q = a.parameters.get(name), b.parameters.get(name)
        unit = next(one.unit for one in (p, q) if one is not None)
        apart = math.nan
        if p is not None and q is not None:
            apart = abs(p.estimate - q.estimate) / max(math.hypot(p.std_error, q.std_error), 1e-300)
        rows.append(
            (
                name,
                shown(p),
                shown(q),
                f"{apart:.1f}" if math.isfinite(apart) else "-",
                unit if unit != "1" else "",
            )
        )
    return parts.table(("", "A", "B", "apart, σ", "unit"), rows)


def intervals(a: Result, b: Result) -> Any:
    """Return both 95 % intervals of each parameter, on a scale of its own: the middle and half width of the wider one."""
    names = [*dict.fromkeys([*a.parameters, *b.parameters])][::-1]
    plot = figure(
        y_range=names, x_range=(-2.6, 2.6), height=80 + ROW * len(names), width=430, tools="save", toolbar_location=None,
        x_axis_label="95 % intervals, each on its own scale",
    )  # fmt: skip
    scales: dict[str, tuple[float, float]] = {}
    for name in names:
        known = [
            p
            for r in (a, b)
            if (p := r.parameters.get(name)) is not None and p.identifiable and math.isfinite(p.std_error)
        ]
        widest = max(known, key=lambda p: p.std_error, default=None)
        if widest is not None and widest.std_error > 0.0:
            scales[name] = (float(np.mean([p.estimate for p in known])), NORMAL_95 * widest.std_error)
    for found, color, shift in ((a, COLORS[0], 0.16), (b, COLORS[1], -0.16)):
        rows: dict[str, list[Any]] = {"name": [], "y": [], "x": [], "low": [], "high": [], "text": []}
        for name, (middle, scale) in scales.items():
            p = found.parameters.get(name)
            if p is None or not p.identifiable or not math.isfinite(p.std_error):
                continue
            half = NORMAL_95 * p.std_error / scale
            x = (p.estimate - middle) / scale
            ends = {"x": x, "low": x - half, "high": x + half, "y": (name, shift), "name": name,
                    "text": " ± ".join(rounded_to_error(p.estimate, p.std_error))}  # fmt: skip
            for key, value in ends.items():
                rows[key].append(value)
        source = ColumnDataSource(rows)
        plot.segment("low", "y", "high", "y", source=source, color=color, line_width=2.5)
        dots = plot.scatter("x", "y", source=source, color=color, size=6)
        plot.add_tools(HoverTool(renderers=[dots], tooltips=[("@name", "@text")]))
    calm(plot)
    plot.xaxis.major_label_text_font_size = "0px"
    plot.yaxis.major_label_text_font_size = "11px"
    plot.ygrid.grid_line_color = SOFT
    plot.min_border_left = 130
    return plot


def predictions(a: Result, b: Result) -> str:
    """Return Theil's coefficient of each channel of each window, of both runs."""
    windows: dict[tuple[str, str], dict[str, list[float]]] = {}
    for i, found in enumerate((a, b)):
        for m in found.maneuvers:
            key = (f"{m.start:g}:{m.stop:g}", "fitted" if m.role == "fit" else "predicted")
            for channel, figures in m.channels.items():
                windows.setdefault(key, {}).setdefault(channel, [math.nan, math.nan])[i] = figures.theil
    channels = list(dict.fromkeys(c for rows in windows.values() for c in rows))
    out = []
    for (span, role), rows in windows.items():
        for i, letter in enumerate("AB"):
            values = [rows[c][i] if c in rows else math.nan for c in channels]
            if any(map(math.isfinite, values)):
                out.append(
                    (f"{span} s", role, letter, *(f"{v:.2f}" if math.isfinite(v) else "-" for v in values))
                )
    return parts.table(("window", "", "run", *channels), out)

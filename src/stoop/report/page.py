"""An identification -> one HTML page that needs nothing else: no network, no scripts, no other files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from stoop.base.files import write_text_atomic
from stoop.report import estimates, matches
from stoop.report.air import air_panels
from stoop.report.charts import convergence_panel, correlation_map
from stoop.report.formula import mathml
from stoop.report.modes import mode_views
from stoop.report.repeatability import repeat_view
from stoop.report.templating import environment
from stoop.report.uncertainty import uncertainty_view
from stoop.report.verdict import prediction, verdict
from stoop.results.result import Identification


def write_report(identification: Identification, path: Path) -> None:
    """Write the report whole or not at all.

    Parameters
    ----------
    identification : Identification
        The result and its traces. Whatever text it holds is shown as text: nothing in it becomes markup.
    path : Path
        The HTML file; its folder must exist.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    write_text_atomic(path, render(identification))


def render(identification: Identification) -> str:
    """Return the report as HTML."""
    return environment().get_template("report.html").render(**_context(identification))


def write_validation(identification: Identification, path: Path) -> None:
    """Write the page of a validation: the result that was validated, with the maneuvers that were predicted.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    text = (
        environment()
        .get_template("validation.html")
        .render(
            it=identification,
            result=identification.result,
            sentence=prediction(identification.result),
            summary=matches.summary(identification.result.maneuvers),
            maneuvers=matches.maneuver_views(identification),
        )
    )
    write_text_atomic(path, text)


def _context(identification: Identification) -> dict[str, Any]:
    views = matches.maneuver_views(identification)
    autocorrelations, colored = matches.autocorrelation_panels(identification)
    return {
        "it": identification,
        "result": identification.result,
        "verdict": verdict(identification.result),
        "equations": [mathml(latex, "block") for latex in identification.equations],
        "maneuvers": views,
        "fitted": [view for view in views if view.role == "fit"],
        "predicted": [view for view in views if view.role == "validation"],
        "autocorrelations": autocorrelations,
        "colored": colored,
        "convergence": _convergence(identification),
        "modes": mode_views(identification),
        "repeated": repeat_view(identification),
        **_estimated(identification),
    }


def _estimated(identification: Identification) -> dict[str, Any]:
    names, matrix = estimates.correlations(identification)
    return {
        "parameters": estimates.parameter_rows(identification),
        "uncertainty": uncertainty_view(identification),
        "correlation": correlation_map(names, matrix) if len(names) > 1 else None,
        "pairs": estimates.strong_pairs(names, matrix),
        "states": estimates.state_rows(identification),
        "biases": estimates.bias_rows(identification),
        "wind": estimates.wind_rows(identification),
        "noise": estimates.noise_rows(identification),
        "air": air_panels(identification),
    }


def _convergence(identification: Identification) -> Any:
    history = np.asarray(identification.convergence, dtype=np.float64).reshape(-1, 2)
    return convergence_panel(history) if np.all(np.isfinite(history), axis=1).any() else None

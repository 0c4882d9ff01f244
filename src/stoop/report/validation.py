"""A validation -> one HTML page: measured against predicted, the lag beside it."""

from __future__ import annotations

from stoop.report import matches
from stoop.report.templating import environment
from stoop.report.words import prediction
from stoop.results.result import Identification


def render_validation(identification: Identification) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    identification : Identification
        The result that was validated, its maneuvers and traces those that were predicted. Whatever text it holds
        is shown as text.
    """
    views = matches.maneuver_views(identification)
    return (
        environment()
        .get_template("validation.html")
        .render(
            it=identification,
            result=identification.result,
            sentence=prediction(identification.result),
            summary=matches.summary(identification.result.maneuvers),
            maneuvers=views,
        )
    )

"""What a fit found, printed: the answer first, then the evidence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from stoop.base.numbers import count
from stoop.cli.page import Page, page
from stoop.results import text
from stoop.results.decisions import decision_lines
from stoop.results.verdict import REASONS, grouped, shortened

if TYPE_CHECKING:
    from stoop.prediction.predict import ForceFigures
    from stoop.results.result import ManeuverResult, Result

#: determined parameters that get a line each, with their interval
ROWS: Final = 12


def show_fit(result: Result, forces: Sequence[ForceFigures], folder: Path, verbose: bool) -> None:
    """Print verdict, estimates, windows held back and where the report is; all that the result holds with `verbose`."""
    out = page()
    _verdict(out, result, verbose)
    if verbose:
        _everything(out, result, forces)
    else:
        _estimates(out, result)
        _windows(out, result.maneuvers)
    out.bullets(decision_lines(result.decisions), "decisions")
    out.line()
    ended = f"{result.status}: {result.advice}" if result.advice else result.status
    out.line(f"{ended} ({result.trajectories:.0f} trajectories, {result.seconds:.1f} s)")
    out.line(f"report: {folder / 'report.html'}")


def _verdict(out: Page, result: Result, verbose: bool) -> None:
    reasons = grouped(result.verdict.reasons)
    out.line(f"verdict: {result.verdict.headline}")
    if verbose:
        out.bullets([*reasons, *result.verdict.advice])
        return
    out.bullets(map(shortened, reasons[:REASONS]))
    left = ((len(reasons) - REASONS, "more reason"), (len(result.warnings), "warning"))
    if known := [count(number, what) for number, what in left if number > 0]:
        out.line(f"  {', '.join(known)} and what would settle them: in the report, or by --verbose")


def _estimates(out: Page, result: Result) -> None:
    from stoop.workflow.summary import estimates_table

    known = text.determined(result.parameters)
    if len(known) > ROWS:
        out.heading("estimates +- standard errors (SI units, radians)")
        estimates = {name: (p.estimate, p.std_error) for name, p in known.items()}
        out.text("\n".join(text.estimate_blocks(estimates)))
    elif known:
        out.heading("estimates")
        out.text(estimates_table(known))
    for line in text.undetermined_lines(result.parameters):
        out.line(line)


def _windows(out: Page, maneuvers: Sequence[ManeuverResult]) -> None:
    held_back = [m for m in maneuvers if m.role == "validation"]
    out.heading("prediction of windows that were not fitted")
    out.bullets(map(text.window_line, held_back))
    if not held_back:
        out.bullets(["none was held back: --validate START:STOP holds one back"])
    out.line(f"fitted {text.matched_line([m for m in maneuvers if m.role == 'fit'])}")


def _everything(out: Page, result: Result, forces: Sequence[ForceFigures]) -> None:
    from stoop.workflow import summary

    out.heading("estimates")
    out.text(summary.estimates_table(result.parameters))
    if result.components.variances:
        out.heading("shares of the variance by component")
        out.text(str(result.components))
    if len(result.uncertainty) > len(summary.BASIC_METHODS):
        out.heading("standard errors by method")
        out.text(summary.methods_table(result))
        out.bullets(f"{name}: {note}" for name, m in result.uncertainty.items() for note in m.notes)
    out.bullets(result.trust, "which error bars to trust")
    advice = summary.advice_by_doubt(result.identifiability.parameters)
    if advice:
        out.heading("what would make the doubtful parameters identifiable")
    for doubt, advised in advice.items():
        out.line(f"{doubt}:")
        out.bullets(advised)
    out.heading("fit and prediction")
    out.text(summary.figures_table(result.maneuvers))
    if forces:
        out.heading("specific force below 5 Hz, from the measured motion: rms residual, m/s2")
        out.text(summary.forces_table(forces))
    repeated = summary.repeatability_lines(result.repeatability)
    out.bullets(repeated, "repeatability: each maneuver fitted alone")
    out.bullets((note for wind in result.wind for note in wind.notes), "wind and pitot")
    out.bullets(result.warnings, "warnings")
    out.bullets(result.basis, "what the figures rest on")

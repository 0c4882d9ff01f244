"""What `import stoop` offers: one function for each verb of the command line, with Python's own objects as arguments."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.flight import Flight
from stoop.problem.windows import Window, Windows
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.flights import OneFlight, as_flight
from stoop.workflow.load import fitted_model

if TYPE_CHECKING:
    from stoop.assessment.assessment import Assessment
    from stoop.reconstruction.compatibility import Compatibility
    from stoop.report.sheet import Page


def look(flight: OneFlight) -> Page:
    """Return a page of a flight: its channels, path, spectra, frequency responses, and the windows worth fitting.

    Parameters
    ----------
    flight : Flight, or path of a log

    Returns
    -------
    Page
        With a method ``save(path)``; a notebook shows it.
    """
    from stoop.flight.windows import overview
    from stoop.report.flight import flight_sheet
    from stoop.report.sheet import Page

    return Page(flight_sheet(overview(as_flight(flight))))


def assess(
    model: FittedModel | str | Path, *assessments: Assessment, watch: Callable[[str], None] | None = None
) -> FittedModel:
    """Return a fitted model with the uncertainty by further methods, such as ``stoop.Bootstrap()`` or ``stoop.Profile()``.

    Parameters
    ----------
    model : FittedModel, or the folder of one
    *assessments : Bootstrap, Profile, Posterior, or one of your own
    watch : callable, optional
        Gets a line of progress now and then.
    """
    return fitted_model(model).assess(*assessments, watch=watch)


def reconstruct(flight: OneFlight, windows: Windows = ()) -> tuple[Compatibility, Flight]:
    """Reconstruct the flight path: return the errors of the instruments, and the flight without them.

    Parameters
    ----------
    flight : Flight, path of a log, or xarray.Dataset
    windows : windows, optional
        The airborne part when absent.

    Raises
    ------
    FlightError
        The flight holds nothing that could be compared.
    """
    from stoop.workflow.reconstruction import check_compatibility

    one = as_flight(flight)
    spans = [(w.start, w.stop) for w in Window.several(windows, {one.name: one})]
    return check_compatibility(one, spans)

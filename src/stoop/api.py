"""What `import stoop` offers: one function for each verb of the command line, with Python's own objects as arguments."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stoop.flight import Flight
from stoop.problem.windows import Windows, spans
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.flights import OneFlight, as_flight
from stoop.workflow.load import takes_model

if TYPE_CHECKING:
    from stoop.reconstruction.compatibility import Compatibility
    from stoop.report.sheet import Page

assess = takes_model(FittedModel.assess)


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
    from stoop.reconstruction.compatibility import Compatibility, corrected_flight

    one = as_flight(flight)
    result, found = Compatibility.of(one, spans(windows, one))
    return result, corrected_flight(found)

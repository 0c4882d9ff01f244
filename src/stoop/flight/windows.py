"""Windows of a flight that are worth fitting, as a package proposes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from stoop.base.notices import Notice, attempt
from stoop.base.packages import hook
from stoop.errors import StoopError
from stoop.flight import Flight, FlightSummary, FlownManeuver, describe

Use = Literal["fit", "validate"]


@dataclass(frozen=True)
class Proposed:
    """A window of a flight, s on the log's own clock, proposed or declined.

    Attributes
    ----------
    axis : which was excited, or "motion"
    information : mean logarithm by which it alone shrinks the error bars
    gain : likewise, beside the windows that were selected before it; 0 for those that are predicted or declined
    accept : whether it is proposed
    maneuver : what was commanded in it, where one maneuver was
    """

    flight: str
    start: float
    stop: float
    axis: str
    why: str
    information: float
    gain: float
    accept: bool
    use: Use
    maneuver: FlownManeuver | None = None

    @property
    def span(self) -> str:
        """START:STOP, as the command line takes it."""
        return f"{self.start:.1f}:{self.stop:.1f}"

    @property
    def purpose(self) -> Literal["fit", "predict", "not used"]:
        """What it is proposed for."""
        return "not used" if not self.accept else "fit" if self.use == "fit" else "predict"


@dataclass(frozen=True)
class Found:
    """Windows in order of flight and time."""

    windows: tuple[Proposed, ...]
    notices: tuple[Notice, ...] = ()

    def texts(self, use: Use) -> list[str]:
        """Return the accepted windows of a kind, as the command line takes them."""
        return [f"{w.flight}@{w.start:g}:{w.stop:g}" for w in self.windows if w.accept and w.use == use]


@dataclass(frozen=True, eq=False)
class Overview:
    """A flight with its candidate windows."""

    summary: FlightSummary
    found: Found
    why: str = ""  #: why no windows were found


def overview(flight: Flight) -> Overview:
    """Describe a flight and find the windows that are worth fitting."""
    summary, failed = describe(flight), list[Notice]()
    try:
        find_windows = hook("find_windows", "the selection of windows", Found)
        used = summary.flight.without_faults()
        found, why = attempt(failed, Found(()), find_windows, {used.name: used}), ""
    except StoopError as error:
        found, why = Found(()), str(error)
    return Overview(replace(summary, notices=(*summary.notices, *failed)), found, why)

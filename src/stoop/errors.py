"""One tree of exceptions; every message is one line: where, what is wrong, what to do.

::

    StoopError                 anything a user can mend; the command line exits with code 2
    ├── LogError               a log that cannot be read (missing, empty, truncated, unknown format)
    ├── FlightError            a flight that lacks what is asked of it (channel, window, time, units)
    ├── VehicleError           a vehicle file that says something impossible or unknown
    │   └── TermError          an aerodynamic term that cannot be parsed
    ├── KernelError            equations that cannot be compiled here (compiler switched off, no disk space)
    ├── ManeuverError          a maneuver file that cannot be flown
    ├── SimulationError        a start point from which the model cannot be simulated or trimmed
    ├── IdentificationError    a fit that cannot begin (nothing free, no data, unknown optimizer)
    ├── CampaignError          a campaign that cannot go on (a run fails, workers die, a cluster is out of reach)
    └── OutputError            an output folder or file that cannot be written
"""

from __future__ import annotations

from collections.abc import Iterable

MAX_LENGTH = 4000  #: of a message


def one_line(text: str) -> str:
    """Return a text on one line that steers no terminal, ends no comment and fits into any file: names in logs hold anything."""
    return "".join(c if c.isprintable() else " " for c in text)


def listed(names: Iterable[str], most: int = 40) -> str:
    """Return names with commas, those beyond the most that one line takes counted."""
    known = list(names)
    return ", ".join(known[:most]) + (f" and {len(known) - most} more" if len(known) > most else "")


class StoopError(Exception):
    """Base of all errors that the user can mend; the message is one line with the fix."""

    def __str__(self) -> str:
        """Return the message on one line, whatever keys and file names are quoted in it; of a very long one both ends."""
        text = one_line(super().__str__())
        half = MAX_LENGTH // 2
        return text if len(text) <= MAX_LENGTH else f"{text[:half]} ... {text[-half:]}"


class LogError(StoopError):
    """A log cannot be read."""


class FlightError(StoopError):
    """A flight lacks what is asked of it."""


class VehicleError(StoopError):
    """A vehicle file says something impossible or unknown."""


class TermError(VehicleError):
    """An aerodynamic term cannot be parsed."""


class KernelError(StoopError):
    """Equations cannot be compiled here."""


class ManeuverError(StoopError):
    """A maneuver file cannot be flown."""


class SimulationError(StoopError):
    """A start point cannot be simulated or trimmed."""


class IdentificationError(StoopError):
    """A fit cannot begin."""


class CampaignError(StoopError):
    """A campaign cannot go on: a run fails, workers die, a cluster is out of reach; what is done is safe."""


class OutputError(StoopError):
    """An output cannot be written."""


class StoopWarning(UserWarning):
    """Base of the warnings of stoop."""


class CacheWarning(StoopWarning):
    """Compiled equations cannot be kept for the next process."""


class PackageWarning(StoopWarning):
    """A package that extends stoop, or a part of it, is left out."""

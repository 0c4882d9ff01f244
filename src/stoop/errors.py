"""One tree of exceptions; every message is one line: where, what is wrong, what to do."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

MAX_LENGTH = 4000  #: of a message


def one_line(text: str) -> str:
    """Return a text on one line that steers no terminal, ends no comment and fits into any file: names in logs hold anything."""
    return "".join(c if c.isprintable() else " " for c in text)


def raised_at(error: BaseException) -> str:
    """Return file and line of an error."""
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    return "" if place is None else f"{Path(place.tb_frame.f_code.co_filename).name}:{place.tb_lineno}"


def listed(names: Iterable[str], most: int = 40) -> str:
    """Return names with commas, those beyond the most that one line takes counted."""
    known = list(names)
    return ", ".join(known[:most]) + (f" and {len(known) - most} more" if len(known) > most else "")


class StoopError(Exception):
    """Base of all errors that the user can mend, with which the command line exits with code 2."""

    def __str__(self) -> str:
        """Return the message on one line, whatever keys and file names are quoted in it; of a very long one both ends."""
        text = one_line(super().__str__())
        half = MAX_LENGTH // 2
        return text if len(text) <= MAX_LENGTH else f"{text[:half]} ... {text[-half:]}"


class LogError(StoopError):
    """A log cannot be read: missing, empty, truncated, of an unknown format."""


class FlightError(StoopError):
    """A flight lacks what is asked of it: a channel, a window, time, units."""


class VehicleError(StoopError):
    """A vehicle file says something impossible or unknown."""


class TermError(VehicleError):
    """An aerodynamic term cannot be parsed."""


class KernelError(StoopError):
    """Equations cannot be compiled here: the compiler is switched off, or the disk is full."""


class ManeuverError(StoopError):
    """A maneuver file cannot be flown."""


class SimulationError(StoopError):
    """A start point cannot be simulated or trimmed."""


class IdentificationError(StoopError):
    """A fit cannot begin: nothing is free, there are no data, the optimizer is unknown."""


class CampaignError(StoopError):
    """A campaign cannot go on: a run fails, workers die, a cluster is out of reach; what is done is safe."""


class OutputError(StoopError):
    """An output cannot be written."""


class PackageError(StoopError, AttributeError):
    """A package of somebody else cannot be used; help() passes over what is missing."""


class StoopWarning(UserWarning):
    """Base of the warnings of stoop."""


class CacheWarning(StoopWarning):
    """Compiled equations cannot be kept for the next process."""


class PackageWarning(StoopWarning):
    """A package that extends stoop, or a part of it, is left out."""

"""A priori knowledge of a number of a vehicle: value, standard deviation, and where it is from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Apriori:
    """A number that is known before the flight.

    Attributes
    ----------
    value : SI units and radians
    std : standard deviation of what is known about it, in the same unit
    source : a method or a record, in a few words; a comment of the vehicle file
    """

    value: float
    std: float
    source: str

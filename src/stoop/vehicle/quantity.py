"""A number of the vehicle file that can be freed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Quantity(BaseModel):
    """One number: ``0.3``, a tie ``"=other.number"``, or a table with bounds, freedom and prior.

    Attributes
    ----------
    value : float
        In SI units and radians.
    bounds : pair of float, optional
        Where the search may look.
    free : bool, optional
        True to estimate, False to hold; None leaves it to the kind of number (aerodynamic terms are free).
    prior : float, optional
        Standard deviation of what is believed before the flight, around ``value``.
    tie : str, optional
        Name of the number that this one equals.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: float = 0.0
    bounds: tuple[float, float] | None = None
    free: bool | None = None
    prior: float | None = Field(default=None, gt=0.0)
    tie: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, data: Any) -> Any:
        if isinstance(data, bool):
            raise ValueError("write a number here, not true or false")
        if isinstance(data, int | float):
            return {"value": float(data)}
        if isinstance(data, str):
            if not data.startswith("="):
                raise ValueError('write a number, or "=name" to tie it to another number')
            return {"tie": data[1:].strip()}
        return data

    @model_validator(mode="after")
    def _sound(self) -> Quantity:
        if not math.isfinite(self.value):
            raise ValueError("write a finite number")
        if self.bounds is not None:
            low, high = self.bounds
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError("bounds must be two finite numbers, the lower first")
            if not low <= self.value <= high:
                raise ValueError(f"value {self.value:g} lies outside its bounds [{low:g}, {high:g}]")
        return self


@dataclass(frozen=True)
class Parameter:
    """One number of the vehicle as the estimation sees it.

    Attributes
    ----------
    name : str
        Aerodynamic terms by their own name (``CLalpha``), all others by their place (``mass.inertia.xx``).
    value, lower, upper : float, SI
    free : bool
    prior : float or None
        Standard deviation before the flight.
    unit : str
    """

    name: str
    value: float
    lower: float
    upper: float
    free: bool
    prior: float | None
    unit: str

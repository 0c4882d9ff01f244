"""A number of the vehicle file that can be freed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

Switch = Annotated[bool, Field(strict=True)]  #: true or false, not "no" or 0
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]  #: no text, no true or false, no nan


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

    value: Number = 0.0
    bounds: tuple[Number, Number] | None = None
    free: Switch | None = None
    prior: Annotated[Number, Field(gt=0.0)] | None = None
    tie: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _short_forms(cls, data: Any) -> Any:
        if isinstance(data, bool):
            raise ValueError("write a number here, not true or false")
        if isinstance(data, int | float):
            return {"value": data}
        if isinstance(data, str):
            return {"tie": tied(data)}
        if not isinstance(data, dict | Quantity):
            raise ValueError(
                'write a number, "=name", or a table such as { value = 0.3, bounds = [0.1, 0.5] }'
            )
        return data

    @model_validator(mode="after")
    def _sound(self) -> Quantity:
        stray = self.model_fields_set & {"value", "bounds", "free", "prior"}
        if self.tie is not None and stray:
            raise ValueError(f"a tied number takes all from '{self.tie}'; remove {min(stray)}")
        if self.bounds is not None:
            low, high = self.bounds
            if not low < high:
                raise ValueError(
                    f"bounds [{low:g}, {high:g}] are reversed or empty; write the lower one first"
                )
            if not low <= self.value <= high:
                raise ValueError(
                    f"value {self.value:g} lies outside its bounds [{low:g}, {high:g}]; widen them"
                )
        return self


def tied(text: str) -> str:
    """Return the name in a tie ``"=name"``."""
    if not text.startswith("=") or not text[1:].strip():
        raise ValueError('write a number, or "=name" to tie it to another number')
    return text[1:].strip()


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

"""Numbers of a law, from the parameters of an autopilot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from stoop.errors import StoopError


@dataclass(frozen=True)
class Parameters:
    """Parameters by name; one that is missing has the firmware's own default, which is given where it is read."""

    values: Mapping[str, float]
    autopilot: str

    def number(self, name: str, default: float | None = None, least: float = 0.0) -> float:
        """Return a parameter.

        Raises
        ------
        StoopError
            It is missing and has no default, it is no number, or it is less than `least`.
        """
        value = float(self.values.get(name, math.nan if default is None else default))
        if name not in self.values and default is None:
            raise StoopError(
                f"{self.autopilot}: the parameter {name} is missing; take them from a log of this autopilot, or from its file "
                "of parameters"
            )
        if not (math.isfinite(value) and value >= least):
            raise StoopError(
                f"{self.autopilot}: {name} = {value:g}: it must be a number of at least {least:g}"
            )
        return value

    def named(self, pattern: str, **defaults: float) -> dict[str, float]:
        """Return parameters of one pattern with a ``{}`` in it, by what stands there."""
        return {name: self.number(pattern.format(name), value) for name, value in defaults.items()}

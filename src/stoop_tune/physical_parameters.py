"""Parameters of an autopilot that are physics, of an identified vehicle: at its estimates, with standard errors over draws."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from stoop import Notice, Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.notices import notice
from stoop_analysis.draws import Draws
from stoop_analysis.propagation.propagation import figures_of
from stoop_analysis.propagation.quantities import ROUNDING, Figure, Samples
from stoop_analysis.propagation.wing_figures import FEW, Domain
from stoop_tune.control_laws.table import rounded
from stoop_tune.physical_formulas import TABLE, Candidates

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class PhysicalParameter:
    """A parameter that the identified vehicle determines, beside the value that flew."""

    name: str
    flown: float
    value: float  #: as it is written
    written: bool  #: into the files of gains
    figure: Figure  #: estimate and uncertainty


@dataclass(frozen=True, eq=False)
class PhysicalParameters:
    """What the identified vehicle says about the parameters of its autopilot that are physics."""

    found: tuple[PhysicalParameter, ...] = ()
    absent: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  #: reason -> parameters

    @property
    def written(self) -> tuple[PhysicalParameter, ...]:
        """Those of the files of gains."""
        return tuple(one for one in self.found if one.written)

    @property
    def notices(self) -> list[Notice]:
        """What is left out, and why."""
        alone = tuple(one.name for one in self.found if not one.written)
        return [
            *([notice("tune-thrust-curve", parameters=alone)] if alone else []),
            *(
                notice("tune-physics-unknown", parameters=names, reason=why)
                for why, names in self.absent.items()
            ),
        ]

    def rows(self) -> list[dict[str, float | str | bool]]:
        """Return name, values, standard error, 95 % interval and unit of each."""
        return [
            {
                "parameter": one.name, "flown": one.flown, "new": one.value, "std_error": one.figure.std_error,
                "ci95_lower": one.figure.ci95_lower, "ci95_upper": one.figure.ci95_upper, "unit": one.figure.unit,
                "written": one.written,
            }
            for one in self.found
        ]  # fmt: skip

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each parameter."""
        import pandas as pd

        return pd.DataFrame(self.rows())


def physical_parameters(
    vehicle: Vehicle,
    firmware: str,
    parameters: Mapping[str, float],
    domain: Domain,
    draws: Draws,
    streams: frozenset[str] = frozenset(),
    reading: float = 1.0,
) -> PhysicalParameters:
    """Return the parameters of a firmware that a vehicle at its estimates, and at draws of its numbers, determines.

    Parameters
    ----------
    firmware : title of its law
    parameters : those that flew; a parameter that they do not have is none of this version
    streams : of the log, from which the airspeed is
    reading : of the pitot over the airspeed of the model
    """
    kept = [i for i, name in enumerate(draws.names) if name in vehicle.rows]
    own = replace(draws, names=tuple(draws.names[i] for i in kept), values=draws.values[:, kept])
    table = {
        row.name: row for row in TABLE.get(firmware, ()) if math.isfinite(parameters.get(row.name, math.nan))
    }
    absent: dict[str, tuple[str, ...]] = {}

    def leave_out(name: str, reason: str) -> None:
        absent[reason] = (*absent.get(reason, ()), name)

    def samples(values: FloatArray, missing: Callable[[str, str], None]) -> list[tuple[str, Samples]]:
        numbers = {
            n: np.concatenate([[vehicle.value(n)], x]) for n, x in zip(own.names, values.T, strict=True)
        }
        candidates = Candidates(vehicle, parameters, domain, streams, numbers, 1 + len(values), reading)
        out = []
        for name, row in table.items():
            try:
                out.append((firmware, Samples.of(name, row.unit, row.formula(candidates))))
            except StoopError as error:
                missing(name, str(error))
        return out

    grouped = samples(own.values, leave_out)
    found = []
    for one in figures_of(vehicle, own, grouped, lambda values: samples(values, lambda *_: None)):
        row = table[one.name]
        if reason := _undetermined(one, row.range):
            leave_out(one.name, reason)
            continue
        value = float(round(one.estimate)) if row.whole else rounded(one.estimate)
        found.append(PhysicalParameter(one.name, parameters[one.name], value, row.written, one))
    return PhysicalParameters(tuple(found), absent)


def _undetermined(one: Figure, allowed: tuple[float, float]) -> str:
    """Return why a value is not to be written; empty where it is."""
    if not math.isfinite(one.estimate) or one.failed > FEW:
        return "it does not exist at the estimates, or at too many draws of the model"
    if not one.std_error > ROUNDING:
        return "no number that was estimated moves it"
    if one.rests_on_prior:
        return "the data do not determine it: most of its uncertainty is that of priors and bounds"
    if not allowed[0] <= one.estimate <= allowed[1]:
        found = f"{one.estimate:.3g} with a standard error of {one.std_error:.2g}"
        return f"it would be {found}, and the firmware takes {allowed[0]:g} to {allowed[1]:g}"
    return ""

"""Derivatives of a vehicle or an identification, as a table, CSV and JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop import FittedModel, Vehicle
from stoop.extend.errors import OutputError
from stoop.extend.files import csv_text, write_file
from stoop.extend.fits import takes_model_or_vehicle
from stoop.extend.text import finite_or_none, printable
from stoop_analysis.derivatives import LOADS, Derivatives, Table
from stoop_analysis.derivatives import derivatives as about
from stoop_analysis.known_model import Condition, KnownModel, known_model

if TYPE_CHECKING:
    import pandas as pd

FORMAT: Final = "stoop-derivatives/1"
ENDINGS: Final = (".csv", ".json")
SHOWN: Final = 10  #: motions and controls that a short text has room for
COLUMNS: Final = ("axes", "form", "name", "value", "unit", "std_error", "identified")


@dataclass(frozen=True, eq=False, repr=False)
class DerivativeTables:
    """Derivatives along one set of axes in the forms that were asked for, with the steady flight."""

    model: KnownModel
    found: Derivatives
    tables: tuple[Table, ...]
    flight: dict[str, float]  #: airspeed, m/s; altitude, m; alpha, rad

    def __repr__(self) -> str:
        """Return the steady flight, and a matrix of the first form: loads in rows, motions and controls in columns."""
        table, flight = self.tables[0], self.flight
        forms, place = " and ".join(t.form for t in self.tables), f"{flight['airspeed']:.1f} m/s"
        place += f", alpha {math.degrees(flight['alpha']):.1f} deg"
        lines = [f"<DerivativeTables of {self.model.vehicle.name}: {forms}, {table.axes} axes, {place}>"]
        names = [name.split("_", 1) for name in table.names]
        motions = [by for _, by in names[: len(names) // len(LOADS)]][:SHOWN]
        matrix = table.values.reshape(len(LOADS), -1)[:, :SHOWN]
        widths = [max(10, len(by) + 1) for by in motions]
        lines.append("  " + "".join(f"{by:>{w}}" for by, w in zip(motions, widths, strict=True)))
        for (load, _), row in zip(names[:: len(names) // len(LOADS)], matrix.tolist(), strict=True):
            lines.append(f"{load:<2}" + "".join(f"{x:>{w}.3g}" for x, w in zip(row, widths, strict=True)))
        return "\n".join(map(printable, [*lines, "units and standard errors: to_dataframe()"]))

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each derivative; the standard error is infinite where the flight does not determine it."""
        import pandas as pd

        return pd.DataFrame(self.rows(), columns=list(COLUMNS))

    def rows(self) -> list[tuple[str, str, str, float, str, float, bool]]:
        """Return axes, form, name, value, unit, standard error, and whether the flight determines it, of each derivative."""
        out = []
        for t in self.tables:
            columns = (t.values.tolist(), t.units, t.std_errors.tolist(), t.identified.tolist())
            out += [(t.axes, t.form, *row) for row in zip(t.names, *columns, strict=True)]
        return out


@takes_model_or_vehicle
def derivatives(
    model: FittedModel | Vehicle,
    airspeed: float | None = None,
    altitude: float | None = None,
    climb_angle: float = 0.0,
    axes: str = "stability",
    dimensional: bool = False,
) -> DerivativeTables:
    """Return the stability and control derivatives of a model about a steady flight.

    Parameters
    ----------
    model : FittedModel, the folder of one, Vehicle, built-in vehicle or vehicle file
    airspeed, altitude : float, m/s and m, optional
        Of the steady flight.
    climb_angle : float, rad
        Likewise.
    axes : {"stability", "body"}
    dimensional : bool
        Of forces and moments, and these over mass and moments of inertia.

    Raises
    ------
    StoopError
        No steady flight, a reduced vehicle, or nondimensional derivatives of a hover.
    """
    data = known_model(model)
    point = data.trim(Condition(airspeed, altitude, climb_angle))
    found = about(data.vehicle, point, data.covariance).along(axes)
    forms = ("dimensional", "specific") if dimensional else ("nondimensional",)
    speed = float(np.linalg.norm(found.velocity))
    flight = {"airspeed": speed, "altitude": point.start["h"], "alpha": found.alpha}
    if isinstance(model, FittedModel) and point.on_wings:
        data = replace(data, notes=(*data.notes, *map(str, model.extrapolation(speed))))
    return DerivativeTables(data, found, tuple(map(found.table, forms)), flight)


def check_ending(target: Path) -> None:
    """Refuse a name that tells no format: OutputError."""
    if target.suffix.lower() not in ENDINGS:
        raise OutputError(f"{target}: no format of derivatives; end its name in {' or '.join(ENDINGS)}")


def save_derivatives(reported: DerivativeTables, target: Path) -> None:
    """Write derivatives as CSV, one a row, or as JSON, with their covariance."""
    check_ending(target)
    text = as_csv(reported) if target.suffix.lower() == ".csv" else as_json(reported)
    write_file(target, text)


def as_csv(reported: DerivativeTables) -> str:
    """Return one row for each derivative; the standard error is empty where the flight does not determine it."""
    return csv_text(COLUMNS, [(*row[:5], finite_or_none(row[5]), row[6]) for row in reported.rows()])


def as_json(reported: DerivativeTables) -> str:
    """Return everything, SI and rad; what is not known is null."""
    tables = []
    for t in reported.tables:
        table = {
            "form": t.form, "names": t.names, "units": t.units, "values": t.values.tolist(),
            "identified": t.identified.tolist(),
        }  # fmt: skip
        if t.known.names:
            table["std_errors"] = [finite_or_none(x) for x in t.std_errors.tolist()]
            table["covariance"] = [[finite_or_none(x) for x in row] for row in t.covariance.tolist()]
        tables.append(table)
    content = {
        "format": FORMAT,
        "vehicle": reported.model.vehicle.name,
        "axes": reported.found.axes,
        "flight": reported.flight,
        "reference": reported.found.reference,
        "controls": reported.found.controls,
        "steady_loads": dict(zip("XYZLMN", reported.found.loads.tolist(), strict=True)),
        "tables": tables,
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"

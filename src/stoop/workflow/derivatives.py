"""Derivatives of a vehicle or an identification, as a table, CSV and JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.base.csv_text import csv_text
from stoop.base.files import write_text_atomic
from stoop.base.text import Summarized
from stoop.errors import OutputError
from stoop.exporters.exporter import Condition, ModelData
from stoop.simulation.derivatives import Derivatives, Table
from stoop.simulation.derivatives import derivatives as about
from stoop.vehicle import Vehicle
from stoop.workflow.export import model_data
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.load import takes_model_or_vehicle

FORMAT: Final = "stoop-derivatives/1"
ENDINGS: Final = (".csv", ".json")


@dataclass(frozen=True, eq=False, repr=False)
class Reported(Summarized):
    """Derivatives along one set of axes in the forms that were asked for, with the steady flight."""

    model: ModelData
    found: Derivatives
    tables: tuple[Table, ...]
    flight: dict[str, float]  #: airspeed, m/s; altitude, m; alpha, rad


@takes_model_or_vehicle
def derivatives(
    model: FittedModel | Vehicle,
    airspeed: float | None = None,
    altitude: float | None = None,
    climb_angle: float = 0.0,
    axes: str = "stability",
    dimensional: bool = False,
) -> Reported:
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
    data = model_data(model)
    point = data.trim(Condition(airspeed, altitude, climb_angle))
    found = about(data.vehicle, point, data.covariance).along(axes)
    forms = ("dimensional", "specific") if dimensional else ("nondimensional",)
    speed = float(np.linalg.norm(found.velocity))
    flight = {"airspeed": speed, "altitude": point.start["h"], "alpha": found.alpha}
    return Reported(data, found, tuple(map(found.table, forms)), flight)


def check_ending(target: Path) -> None:
    """Refuse a name that tells no format: OutputError."""
    if target.suffix.lower() not in ENDINGS:
        raise OutputError(f"{target}: no format of derivatives; end its name in {' or '.join(ENDINGS)}")


def save_derivatives(reported: Reported, target: Path) -> None:
    """Write derivatives as CSV, one a row, or as JSON, with their covariance."""
    check_ending(target)
    text = as_csv(reported) if target.suffix.lower() == ".csv" else as_json(reported)
    write_text_atomic(target, text)


def as_csv(reported: Reported) -> str:
    """Return rows of form, name, value, unit, standard error and whether the flight determines it."""
    rows = []
    for table in reported.tables:
        values, errors, identified = (x.tolist() for x in (table.values, table.std_errors, table.identified))
        rows += [
            (table.axes, table.form, name, values[i], table.units[i], _finite(errors[i]), identified[i])
            for i, name in enumerate(table.names)
        ]
    return csv_text(("axes", "form", "name", "value", "unit", "std_error", "identified"), rows)


def as_json(reported: Reported) -> str:
    """Return everything, SI and rad; what is not known is null."""
    vehicle, reference = reported.model.vehicle, reported.found.reference
    content = {
        "format": FORMAT,
        "vehicle": vehicle.name,
        "axes": reported.found.axes,
        "flight": reported.flight,
        "reference": reference,
        "controls": reported.found.controls,
        "steady_loads": dict(zip("XYZLMN", reported.found.loads.tolist(), strict=True)),
        "tables": [_table(t) for t in reported.tables],
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _table(table: Table) -> dict[str, Any]:
    out: dict[str, Any] = {
        "form": table.form,
        "names": table.names,
        "units": table.units,
        "values": table.values.tolist(),
        "identified": table.identified.tolist(),
    }
    if table.known.names:
        out["std_errors"] = [_finite(x) for x in table.std_errors.tolist()]
        out["covariance"] = [[_finite(x) for x in row] for row in table.covariance.tolist()]
    return out


def _finite(x: float) -> float | None:
    return x if math.isfinite(x) else None

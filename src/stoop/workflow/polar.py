"""The drag polar of a flight: blocks, fit, notices, result and page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.base.files import make_folder, write_text_atomic
from stoop.base.notices import Notice, notice
from stoop.base.numbers import finite_or_none
from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.flight.air_data import RECONSTRUCTED
from stoop.reconstruction.performance import Blocks, blocks
from stoop.reconstruction.polar import DISC, DISC_SPREAD, Polar, Propulsion, fit_polar
from stoop.workflow.notices import data_notices
from stoop.workflow.provenance import file_hashes, flight_files, versions

FORMAT: Final = "stoop-polar/1"
PAGE: Final = "polar.html"
RESULT: Final = "polar.json"
NAMES: Final = (PAGE, RESULT)
USUAL: Final = Propulsion()
AIRSPEED_STD: Final = 0.02  #: relative, of a measured airspeed: position error and calibration
MIN_AIRSPEED_STD: Final = 0.01  #: relative, of one reconstructed with a well-known wind
LIFT_RANGE: Final = (0.02, 5.0)  #: lift coefficients between which the median of any wing in flight lies
MIN_WEIGHT: Final = 0.5  #: of a block; below it the robust fit takes it for a gust
UNINFORMATIVE: Final = 0.9  #: of the assumed standard error of the efficiency, left after the fit


def drag_polar(
    flight: Flight,
    mass: float,
    area: float,
    windows: Sequence[tuple[float, float]] = (),
    propulsion: Propulsion = USUAL,
) -> tuple[Polar, tuple[Notice, ...]]:
    """Return the polar of a flight, and what it rests on.

    Parameters
    ----------
    flight : Flight
    mass, area : float, kg, m2
    windows : sequence of (start, stop)
        s on the log's own clock; the airborne part without any.
    propulsion : Propulsion

    Raises
    ------
    FlightError
        The flight lacks a channel, a power, or time; or mass, area or efficiency cannot be.
    """
    if propulsion.efficiency > 1.0:
        raise FlightError(
            f"an efficiency of {propulsion.efficiency:g} is more than all; write a share, such as 0.7"
        )
    cut = blocks(flight, mass, windows)
    _check_lift(flight, cut, mass, area)
    polar = fit_polar(cut, mass, area, _airspeed_std(flight), propulsion)
    return polar, (*_propulsion_notices(polar, propulsion), *_notices(polar), *data_notices(flight.notices))


def _check_lift(flight: Flight, cut: Blocks, mass: float, area: float) -> None:
    """Refuse a mass or an area with which no wing would fly as this one did."""
    lift = float(np.median(cut.lift / (0.5 * cut.density * cut.speed**2))) / area
    if not LIFT_RANGE[0] < lift < LIFT_RANGE[1]:
        raise FlightError(
            f"{flight.name}: with {mass:g} kg and {area:g} m2 its median lift coefficient were {lift:.2g}, as no wing has; "
            "check the units of both, and the sign and unit of az"
        )


def _airspeed_std(flight: Flight) -> float:
    """Return the relative standard error of the airspeed."""
    if flight.sources["V"].source != RECONSTRUCTED or flight.air is None:
        return AIRSPEED_STD
    wind = np.nan_to_num(max(flight.air.wind_n_std, flight.air.wind_e_std), nan=2.0)
    return max(MIN_AIRSPEED_STD, float(wind / np.nanquantile(flight.column("V"), 0.9)))


def _propulsion_notices(polar: Polar, propulsion: Propulsion) -> list[Notice]:
    if not polar.blocks.powered:
        return [notice("polar-of-gliding-blocks")]
    assumed: dict[str, Any] = {"efficiency": propulsion.efficiency, "std": propulsion.efficiency_std}
    if propulsion.diameter is None:
        diameter, factor = DISC * float(np.sqrt(polar.area)), float(np.exp(DISC_SPREAD))
        thrust = notice("thrust-from-power-unknown-disc", **assumed, diameter=diameter, factor=factor)
    else:
        thrust = notice("thrust-from-power", **assumed, diameter=propulsion.diameter)
    value, error = polar.summary["efficiency"]
    informative = error <= UNINFORMATIVE * propulsion.efficiency_std
    code = "efficiency-estimated" if informative else "efficiency-assumed"
    return [thrust, notice(code, efficiency=value, std=error), notice("drag-error-of-efficiency")]


def _notices(polar: Polar) -> list[Notice]:
    low, high = polar.valid
    found = [
        notice("polar-range", count=len(polar.CL), low=low, high=high),
        notice("polar-outliers", count=int(np.sum(polar.weights < MIN_WEIGHT))),
    ]
    curvature, error = polar.summary["K"]
    if not np.isfinite(curvature) or curvature < 2.0 * error:
        found.append(notice("curvature-not-identifiable"))
    value, std = polar.drag(np.linspace(low, high, 5))
    if np.all(value < NORMAL_95 * std):
        found.append(notice("drag-not-identifiable"))
    return found


def polar_document(
    polar: Polar, notices: Sequence[Notice], flight: Flight, others: Sequence[Path] = ()
) -> str:
    """Return the JSON of the result; what is not a finite number is null."""
    CL = np.linspace(*polar.valid, 25)
    value, std = polar.drag(CL)
    content: dict[str, Any] = {
        "format": FORMAT,
        "flight": flight.name,
        "mass": polar.mass,
        "area": polar.area,
        "summary": {
            n: {"estimate": finite_or_none(v), "std_error": finite_or_none(s)}
            for n, (v, s) in polar.summary.items()
        },
        "unknowns": list(polar.names),
        "values": polar.values.tolist(),
        "covariance": polar.covariance.tolist(),
        "curve": {"CL": CL.tolist(), "CD": value.tolist(), "std_error": std.tolist()},
        "blocks": {
            "time": polar.blocks.time.tolist(),
            "CL": polar.CL.tolist(),
            "CD": polar.CD.tolist(),
            "alpha": polar.blocks.alpha.tolist(),
            "weight": polar.weights.tolist(),
        },
        "notes": [str(one) for one in notices],
        "versions": versions(),
        "inputs": file_hashes([*flight_files([flight]), *others]),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def write_polar(
    polar: Polar,
    notices: Sequence[Notice],
    flight: Flight,
    folder: Path,
    command: str,
    others: Sequence[Path] = (),
) -> None:
    """Write page and result into a folder, the result last."""
    from stoop.report.polar import polar_sheet
    from stoop.report.sheet import write_sheet

    make_folder(folder)
    write_sheet(polar_sheet(flight.name, polar, notices, command), folder / PAGE)
    write_text_atomic(folder / RESULT, polar_document(polar, notices, flight, others))

"""The drag polar of a flight, with what it rests on, as a page and a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop import Flight, Notice
from stoop.extend.errors import FlightError
from stoop.extend.files import file_hashes, to_json, versions, write_files
from stoop.extend.fits import NORMAL_95
from stoop.extend.flights import RECONSTRUCTED
from stoop.extend.notices import notice
from stoop_analysis.performance.polar import DISC, DISC_SPREAD, Polar, Propulsion, blocks, fit_polar

POLAR: Final = ("polar.html", "polar.json")
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

    Mass in kg, area in m2; `windows` are (start, stop) in s on the log's own clock, the airborne part without any.

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
    lift = float(np.median(cut.lift / (0.5 * cut.density * cut.speed**2))) / area
    if not LIFT_RANGE[0] < lift < LIFT_RANGE[1]:
        raise FlightError(
            f"{flight.name}: with {mass:g} kg and {area:g} m2 its median lift coefficient were {lift:.2g}, as no wing has; "
            "check the units of both, and the sign and unit of az"
        )
    airspeed_std = AIRSPEED_STD
    if flight.sources["V"].source == RECONSTRUCTED and flight.air is not None:
        wind = np.nan_to_num(max(flight.air.wind_n_std, flight.air.wind_e_std), nan=2.0)
        airspeed_std = max(MIN_AIRSPEED_STD, float(wind / np.nanquantile(flight.column("V"), 0.9)))
    polar = fit_polar(cut, mass, area, airspeed_std, propulsion)
    if polar.blocks.powered:
        assumed: dict[str, Any] = {"efficiency": propulsion.efficiency, "std": propulsion.efficiency_std}
        if propulsion.diameter is None:
            diameter, factor = DISC * float(np.sqrt(polar.area)), float(np.exp(DISC_SPREAD))
            thrust = notice("thrust-from-power-unknown-disc", **assumed, diameter=diameter, factor=factor)
        else:
            thrust = notice("thrust-from-power", **assumed, diameter=propulsion.diameter)
        value, error = polar.summary["efficiency"]
        informative = error <= UNINFORMATIVE * propulsion.efficiency_std
        code = "efficiency-estimated" if informative else "efficiency-assumed"
        found = [thrust, notice(code, efficiency=value, std=error), notice("drag-error-of-efficiency")]
    else:
        found = [notice("polar-of-gliding-blocks")]
    low, high = polar.valid
    found.append(notice("polar-range", count=len(polar.CL), low=low, high=high))
    found.append(notice("polar-outliers", count=int(np.sum(polar.weights < MIN_WEIGHT))))
    curvature, error = polar.summary["K"]
    if not np.isfinite(curvature) or curvature < 2.0 * error:
        found.append(notice("curvature-not-identifiable"))
    drag, std = polar.drag(np.linspace(low, high, 5))
    if np.all(drag < NORMAL_95 * std):
        found.append(notice("drag-not-identifiable"))
    return polar, (*found, *(replace(one, severity="info") for one in dict.fromkeys(flight.notices)))


def write_polar(
    polar: Polar,
    notices: Sequence[Notice],
    flight: Flight,
    folder: Path,
    command: str,
    others: Sequence[Path] = (),
) -> None:
    """Write page and result into a folder, both or none; what is not a finite number is null."""
    from stoop.extend.reports import sheet
    from stoop_analysis.report.polar import polar_sheet

    CL = np.linspace(*polar.valid, 25)
    value, std = polar.drag(CL)
    columns = {"time": polar.blocks.time, "CL": polar.CL, "CD": polar.CD, "alpha": polar.blocks.alpha}
    columns |= {"weight": polar.weights}
    content: dict[str, Any] = {
        "format": "stoop-polar/1",
        "flight": flight.name,
        "mass": polar.mass,
        "area": polar.area,
        "summary": {n: {"estimate": v, "std_error": s} for n, (v, s) in polar.summary.items()},
        "unknowns": list(polar.names),
        "values": polar.values.tolist(),
        "covariance": polar.covariance.tolist(),
        "curve": {"CL": CL.tolist(), "CD": value.tolist(), "std_error": std.tolist()},
        "blocks": {name: values.tolist() for name, values in columns.items()},
        "notes": [str(one) for one in notices],
        "versions": versions(),
        "inputs": file_hashes([flight, *others]),
    }
    page = sheet.render_sheet(polar_sheet(flight.name, polar, notices, command))
    texts = page, to_json(content, 1) + "\n"
    write_files(folder, dict(zip(POLAR, texts, strict=True)))

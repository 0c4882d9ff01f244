"""The drag polar of a flight: blocks, fit, notes, result and page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.assess.covariance import NORMAL_95
from stoop.base.files import write_text_atomic
from stoop.base.numbers import finite_or_none, number
from stoop.errors import FlightError
from stoop.flight import Flight
from stoop.flight.air_data_reconstruction import RECONSTRUCTED
from stoop.reconstruct.performance import Blocks, blocks
from stoop.reconstruct.polar import DISC, DISC_SPREAD, Polar, Propulsion, fit_polar
from stoop.workflow.provenance import file_hashes, flight_files, versions

FORMAT: Final = "stoop-polar/1"
PAGE: Final = "polar.html"
RESULT: Final = "polar.json"
NAMES: Final = (PAGE, RESULT)
USUAL: Final = Propulsion()
MEASURED_AIRSPEED: Final = 0.02  #: relative, of a measured airspeed: position error and calibration
LIFTS: Final = (0.02, 5.0)  #: lift coefficients between which the median of any wing in flight lies
LEAST_AIRSPEED: Final = 0.01  #: relative, of one reconstructed with a well-known wind


def drag_polar(
    flight: Flight,
    mass: float,
    area: float,
    windows: Sequence[tuple[float, float]] = (),
    propulsion: Propulsion = USUAL,
) -> tuple[Polar, tuple[str, ...]]:
    """Return the polar of a flight, and what it rests on in plain words.

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
    return polar, (*_propulsion_notes(polar, propulsion), *_notes(polar), *map(str, flight.notices))


def _check_lift(flight: Flight, cut: Blocks, mass: float, area: float) -> None:
    """Refuse a mass or an area with which no wing would fly as this one did."""
    lift = float(np.median(cut.lift / (0.5 * cut.density * cut.speed**2))) / area
    if not LIFTS[0] < lift < LIFTS[1]:
        raise FlightError(
            f"{flight.name}: with {mass:g} kg and {area:g} m2 its median lift coefficient were {lift:.2g}, as no wing has; "
            "check the units of both, and the sign and unit of az"
        )


def _airspeed_std(flight: Flight) -> float:
    """Return the relative standard error of the airspeed."""
    if flight.sources["V"].source != RECONSTRUCTED or flight.air is None:
        return MEASURED_AIRSPEED
    wind = np.nan_to_num(max(flight.air.wind_n_std, flight.air.wind_e_std), nan=2.0)
    return max(LEAST_AIRSPEED, float(wind / np.nanquantile(flight.column("V"), 0.9)))


def _propulsion_notes(polar: Polar, propulsion: Propulsion) -> list[str]:
    if not polar.blocks.powered:
        return [
            "only blocks with the throttle closed are used: drag includes that of the standing or windmilling propeller"
        ]
    guessed, factor = number(DISC * float(np.sqrt(polar.area)), 2), float(np.exp(DISC_SPREAD))
    unknown = f"an unknown disc of about {guessed} m, within a factor of {factor:.2g}"
    disc = unknown if propulsion.diameter is None else f"a disc of {propulsion.diameter:g} m"
    value, error = polar.summary["efficiency"]
    return [
        f"thrust was not measured: electric power becomes thrust by momentum theory, with an assumed efficiency of "
        f"{propulsion.efficiency:g} ± {propulsion.efficiency_std:g} (motor, controller, blades) and {disc}",
        f"the flight itself leaves the efficiency at {value:.2f} ± {error:.2f}"
        + ("; it adds next to nothing to the assumption" if error > 0.9 * propulsion.efficiency_std else ""),
        "a drag coefficient is as wrong as the efficiency is, in percent, and its interval says so",
    ]


def _notes(polar: Polar) -> list[str]:
    low, high = polar.valid
    away = int(np.sum(polar.weights < 0.5))
    lines = [
        f"{len(polar.CL)} blocks; 90 % of them between CL {low:.2f} and {high:.2f}: outside, the parabola is a guess",
        f"{away} blocks count less than half, as gusts or changes of configuration",
    ]
    if not np.isfinite(polar.summary["K"][0]) or polar.summary["K"][0] < 2.0 * polar.summary["K"][1]:
        lines.append("the curvature cannot be told from this flight: fly more slowly and faster than this")
    value, std = polar.drag(np.linspace(low, high, 5))
    if np.all(value < NORMAL_95 * std):
        lines.append(
            "NOTHING IS KNOWN of the drag: zero lies in every interval; is the battery's current that of the motor, "
            "and is this steady flight?"
        )
    return lines


def polar_document(polar: Polar, notes: Sequence[str], flight: Flight, others: Sequence[Path] = ()) -> str:
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
        "notes": list(notes),
        "versions": versions(),
        "inputs": file_hashes([*flight_files([flight]), *others]),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def write_polar(
    polar: Polar,
    notes: Sequence[str],
    flight: Flight,
    folder: Path,
    command: str,
    others: Sequence[Path] = (),
) -> None:
    """Write page and result into a folder that is there, the result last."""
    from stoop.report.polar import polar_sheet
    from stoop.report.sheet import write_sheet

    write_sheet(polar_sheet(flight.name, polar, notes, command), folder / PAGE)
    write_text_atomic(folder / RESULT, polar_document(polar, notes, flight, others))

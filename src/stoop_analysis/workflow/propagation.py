"""Propagation of the uncertainty of a fitted model in one call: find where it was flown, draw, and propagate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop import FittedModel
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.fits import at_center_of_gravity, takes_model, true_values
from stoop.extend.reports import sheet
from stoop.extend.text import within_limits
from stoop.extend.units import standard_density
from stoop.extend.variables import FAMILIES
from stoop_analysis.draws import POSTERIOR_FILE, Source, draws_of
from stoop_analysis.propagation.propagation import Propagation, propagate_draws
from stoop_analysis.propagation.wing_figures import Domain
from stoop_analysis.report.propagation import propagation_page

DRAWS: Final = 2000
RANGE: Final = (1.0, 99.0)  #: percentiles of the samples between which a model was flown
ALTITUDE: Final = 200.0  #: m, where the flight has none
MIN_SPEEDS: Final = 0.1  #: of the airspeed flown; a narrower range is widened to this share about it
READ: Final = frozenset(
    {"V", "alpha", "beta", *FAMILIES["euler"], *FAMILIES["rates"]}
)  #: by what a model's airspeed follows from the one measured
HOVER_SPEEDS: Final = 2.0  #: m/s, least range over ground of a vehicle with rotors


class Propagated(Propagation):
    """Quantities with their uncertainty, and the page of them."""

    def page(self, command: str = "") -> sheet.Page:
        """Return the page, which a notebook shows; ``save(path)`` writes it."""
        return propagation_page(self, command)


@takes_model
def propagate(
    model: FittedModel,
    expressions: Mapping[str, str] | None = None,
    airspeed: tuple[float, float] | None = None,
    altitude: float | None = None,
    draws: int = DRAWS,
    seed: int = 0,
    source: Source | None = None,
) -> Propagated:
    """Carry the uncertainty of a fit into trims over the airspeed, limits, stability, modes, control, glide and expressions.

    Parameters
    ----------
    model : FittedModel, or the folder of one
    expressions : mapping, optional
        Expressions of the vehicle's numbers, such as ``"CLalpha / CD0"``, by the names that they get.
    airspeed : (low, high), m/s, optional
        Of the curves; what was flown in the fitted maneuvers when absent.
    altitude : float, m, optional
        The flight's when absent.
    draws : int
    seed : int
    source : {"posterior", "covariance"}, optional
        The posterior where it was sampled when absent.

    Returns
    -------
    Propagated
        Figures by name, ``to_dataframe()``, ``to_xarray()`` and ``page()``; SI and rad.

    Raises
    ------
    StoopError
        The posterior did not converge, there is no covariance, an expression has an unknown name, or nothing trims.
    """
    domain = flown_domain(model, airspeed, altitude)
    posterior = model.attachments.get(POSTERIOR_FILE)
    drawn = draws_of(model.result, posterior, draws, seed, source, model.source)
    made = propagate_draws(model.vehicle, drawn, domain, expressions, model.source, seed)
    notices = (*model.refusal, *made.notices)
    return Propagated(**{**vars(made), "notices": notices})


def flown_domain(
    model: FittedModel, airspeed: tuple[float, float] | None = None, altitude: float | None = None
) -> Domain:
    """Return the airspeeds, angles of attack and altitude of the fitted maneuvers, or those asked for in their place."""
    vehicle = model.vehicle
    if airspeed is not None:
        slowest, fastest = within_limits("airspeed", airspeed, 2)
        airspeed = slowest, fastest
    try:
        pieces = [piece for maneuver in model.pieces() for piece in maneuver]
    except StoopError:  # the copy of the flight has gone: modes and vehicle remain
        pieces = []
    measured = [np.empty((0, len(vehicle.outputs))), *(piece.measured for piece in pieces)]
    read = dict(zip(vehicle.outputs, np.concatenate(measured).T, strict=True))
    if read.keys() >= READ:
        read = at_center_of_gravity(vehicle, true_values(vehicle, read))
    speed, alpha = (x[np.isfinite(x)] for x in (read.get(n, np.empty(0)) for n in ("V", "alpha")))
    if vehicle.rotors:
        over_ground = [v[np.isfinite(v)] for v in (read.get(n, np.empty(0)) for n in FAMILIES["velocity"])]
        speed = np.sqrt(sum((v**2 for v in over_ground if v.size == over_ground[0].size), np.zeros(1)))
    height = [piece.start["h"] for piece in pieces if "h" in piece.start]
    usual = float(np.mean(height)) if height else ALTITUDE
    (at,) = within_limits("altitude", usual if altitude is None else altitude)
    density = float(standard_density(np.array(at)))
    if "density" in vehicle.inputs and pieces and altitude is None:
        column = vehicle.inputs.index("density")
        density = float(np.mean(np.concatenate([piece.inputs[:, column] for piece in pieces])))
    flown = _range(speed)
    if vehicle.rotors:
        high = max(HOVER_SPEEDS, flown[1] if flown else 0.0)
        return Domain(airspeed or (0.0, round(high, 1)), 0.0, at, density, speeds=flown)
    if flown is None:
        known = [m.airspeed for m in model.result.modes if np.isfinite(m.airspeed)]
        middle = known[0] if known else vehicle.value("reference.airspeed")
    else:
        middle = float(np.mean(speed))
    half = 0.5 * MIN_SPEEDS * middle
    low, high = flown or (middle, middle)
    span = airspeed or (round(min(low, middle - half), 1), round(max(high, middle + half), 1))
    reference = min(max(middle, span[0]), span[1])
    return Domain(span, round(reference, 2), at, density, _range(alpha), flown)


def _range(values: FloatArray) -> tuple[float, float] | None:
    if not values.size:
        return None
    low, high = np.percentile(values, RANGE).tolist()
    return low, high

"""Gusts that a flight met, from air data and inertial sensors alone, and the table of turbulence that they call for.

The velocity through the air is that over ground less the wind. Its rate of change that accelerometers and gyros give is that of
the velocity over ground, so with measured V, alpha and beta, in body axes,

    d(t) = v_air(t) - integral of (f + g - omega x v_air) dt

is the change of the wind, whatever the aircraft's coefficients are, and whoever moves the surfaces. Biases of the sensors and
an error of the attitude make d linear in time, scale factors and misalignment of the vanes make it proportional to the
integral, positions of sensors to the rates, scale factors of gyros and air data to the integral of omega x v_air by each
rate: these are removed by least squares. The covariance of readings that share nothing separates the remainder from white
noise: the samples of a grid between readings were interpolated, and neighbors went through one low-pass.

By how much gusts bias estimates of a method that knows of none, a few steps of Fisher's scoring of filter error tell, from those
estimates on and with gusts in the model: they go most of the way to its maximum. The way of each parameter is its bias with the
sign changed, and the inverse of the information its standard error.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification*, 2nd ed., AIAA, 2016, chapter 10 (data compatibility).
MIL-F-8785C, *Flying Qualities of Piloted Airplanes*, 1980, section 3.7 (Dryden spectra and their lengths).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import tomlkit

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.base.units import STANDARD_GRAVITY
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate
from stoop.estimate.filter_gains import Noise, Steady, first_guess
from stoop.estimate.filter_likelihood import SCORING, Likelihood
from stoop.estimate.fit import DEFAULTS, estimation_problem
from stoop.estimate.fitted_filter import with_gusts
from stoop.estimate.linearization import undelayed
from stoop.estimate.scoring import ScoringModel
from stoop.flight import Flight
from stoop.flight.air_data import RECONSTRUCTED
from stoop.optimize.levenberg_marquardt import Stages, TenfoldDamping
from stoop.problem import Nuisance
from stoop.problem.evidence import invert
from stoop.problem.observation import along_body, at_center_of_gravity, state_channels
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.document import write_entry
from stoop.vehicle.schema import Turbulence

AIR: Final = ("V", "alpha", "beta")
NEEDED: Final = frozenset({*AIR, "p", "q", "r", "phi", "theta", "ax", "ay", "az"})
AXES: Final = ("u", "v", "w")
#: flow angle -> the force that comes with it
ACROSS: Final = {"alpha": "az", "beta": "ay"}
ANGLE_OF_FORCE: Final = -0.05  #: rad per m/s2, to begin with
STEPS: Final = 3  #: of scoring; in a flight where they go wrong, eight do no better
MIN_BIAS: Final = 2.0  #: standard errors of filter error, from which a parameter is named
SHOWN: Final = 6  #: parameters that are named


class Limits:
    """When gusts are taken for more than errors of sensors, and the table that describes them."""

    #: size of gusts, in standard deviations of an air data sensor by the vehicle file; of simulated flights of
    #: `stoop verify feedback` at most 0.3 in calm air, with scale errors of 8 % too, 1 to 2 in light turbulence
    sigmas: Final = 0.5
    #: of the grid between readings that share nothing: 2 % of the weight of a cubic spline, and of the low-pass before a grid,
    #: lies beyond the third to either side
    samples: Final = 4.0
    seconds: Final = 4.0  #: of a window; of a shorter one the least squares would leave nothing
    #: s, to which shorter windows are widened: in 5 s the least squares take most of light turbulence with them. Of 16 flights of
    #: seven aircraft of JSBSim, air data at 10 to 50 Hz, levels in calm air are at most 0.01 m/s, in light turbulence 0.13 to 0.6
    widened: Final = 10.0
    #: m, of the table; estimates hardly depend on it: of 128 intervals in severe turbulence with lengths of 200 and 525 m,
    #: 94 %, 98 % and 99 % held the truth with 60, 200 and 600 m
    length: Final = 200.0
    bounds: Final = (0.02, 20.0)  #: m/s, of an intensity
    first: Final = 1.0  #: m/s, likewise, to begin with: between light and moderate near the ground
    correlation: Final = 0.2  #: of neighboring innovations, from which on gusts do not explain the residuals


class UnexplainedError(IdentificationError):
    """Gusts do not explain the innovations of a filter, which correlate from reading to reading."""

    def __init__(self, correlation: float) -> None:
        super().__init__(f"innovations correlate by {correlation:.2f}")
        self.correlation = correlation


def gust_levels(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> FloatArray:
    """Return the rms (3,) of gusts u, v, w in the windows, m/s; NaN where air data or inertial sensors are not measured.

    Without a vane the axis across which it looks has none. NaN also for axes on which a reduced model has no gusts.
    """
    needed = (NEEDED - ACROSS.keys()) & {*vehicle.outputs, *state_channels(vehicle)}
    parts = [np.zeros((1, 3))]
    for name in dict.fromkeys(w.flight for w in windows):
        flight = flights[name]
        read = [flight.sources[c] for c in AIR if c in flight.sources]
        if not flight.names >= needed or any(one.source == RECONSTRUCTED for one in read):
            continue
        counted = np.logical_and.reduce([one.counted(len(flight.time)) for one in read])
        up = flight.in_flight()
        for w in (w for w in windows if w.flight == name):
            more = max(0.0, 0.5 * (Limits.widened - (w.stop - w.start)))
            inside = flight.between(w.start - more, w.stop + more)
            wind = changes_of_wind(vehicle, flight, inside, up[inside])
            rows = np.flatnonzero(counted[inside])
            apart = float(np.median(np.diff(rows))) if len(rows) > 1 else Limits.samples
            lag = math.ceil(Limits.samples / max(1.0, apart))  # readings of the air data that share nothing
            parts.append(wind[rows[lag:]] * wind[rows[:-lag]])
    products = np.concatenate(parts)
    count = np.isfinite(products[1:]).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        levels = np.sqrt(np.maximum(np.nansum(products, axis=0) / count, 0.0))
    return np.where(np.isin(AXES, with_turbulence(vehicle).gusts), levels, np.nan)


def changes_of_wind(vehicle: Vehicle, flight: Flight, inside: slice, up: BoolArray) -> FloatArray:
    """Return the change of the wind (n, 3) along the body axes in samples of a flight, m/s, NaN where something was not measured.

    Only where it flies, `up` (n,). A flow angle without a vane is taken in proportion to the force across it, a share that the
    least squares find.
    """
    columns = {c: flight.column(c)[inside] for c in NEEDED & flight.names}
    seen = [c not in ACROSS or c in columns for c in ("V", "beta", "alpha")]  # of u, v, w
    without = [(c, f) for c, f in ACROSS.items() if c not in columns and f in columns]
    columns |= {c: ANGLE_OF_FORCE * columns[f] for c, f in without}
    present = np.logical_and.reduce([up, *(np.isfinite(y) for y in columns.values())])
    dt = 1.0 / flight.rate
    at = np.flatnonzero(present)
    if len(at) * dt < Limits.seconds or len(at) < 0.5 * len(present):
        return np.full((len(present), 3), np.nan)
    y = dict.fromkeys(NEEDED, np.zeros(len(present)))  # a reduced model does without the others
    y |= along_body(vehicle, {c: np.interp(np.arange(len(present)), at, columns[c][at]) for c in columns})
    body = rigid_states(at_center_of_gravity(vehicle, y))
    air, rates = (np.column_stack([body[c] for c in names]) for names in ("uvw", "pqr"))
    force = np.column_stack([y[c] for c in ("ax", "ay", "az")])
    phi, theta = y["phi"], y["theta"]
    down = np.column_stack([-np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])

    def integral(slope: FloatArray) -> FloatArray:
        return np.vstack([np.zeros(slope.shape[1]), np.cumsum(0.5 * dt * (slope[1:] + slope[:-1]), axis=0)])

    turned = [np.cross(np.eye(3)[i] * rates[:, [i]], air) for i in range(3)]  # by each rate alone
    inertial = integral(force + STANDARD_GRAVITY * down - sum(turned))
    common = [np.ones(len(air)), np.linspace(-1.0, 1.0, len(air)), *inertial.T, *rates.T]
    wind = air - inertial
    for i in range(3):
        own = integral(np.column_stack([turned[j][:, i] for j in range(3) if j != i]))
        calibration = np.column_stack([*common, own])
        wind[:, i] -= calibration @ np.linalg.lstsq(calibration[at], wind[at, i], rcond=None)[0]
    return np.where(present[:, None] & np.array(seen), wind, np.nan)


def exceed_sensors(vehicle: Vehicle, levels: FloatArray) -> bool:
    """Whether gusts (3,), m/s, are more than errors of the sensors can be."""
    sensors, airspeed = vehicle.file.sensors, vehicle.value("reference.airspeed")
    noise = np.array([sensors.V.sigma, airspeed * sensors.beta.sigma, airspeed * sensors.alpha.sigma])
    return bool(np.any(levels > Limits.sigmas * noise))


def with_turbulence(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with gusts on all axes, their intensities free, unless its file has a table of them."""
    if vehicle.gusts:
        return vehicle
    intensity = {"value": Limits.first, "free": True, "bounds": list(Limits.bounds)}
    gust = {"intensity": intensity, "length": Limits.length}
    table, document = Turbulence.model_validate(dict.fromkeys(AXES, gust)), tomlkit.parse(vehicle.text)
    for axis in AXES:  # also in the text, of which the estimates make the file of the identified vehicle
        write_entry(document, ("turbulence", axis), gust)
    file = vehicle.file.model_copy(update={"turbulence": table})
    return replace(vehicle, file=file, text=tomlkit.dumps(document))


def unexplained(fit: Estimate, method: str, instead: str) -> tuple[Notice, ...]:
    """Return why gusts do not explain the residuals of a filter-error fit, if they do not; an interrupted fit may be resumed."""
    if fit.outcome.status == "interrupted":
        return ()
    if fit.outcome.status != "converged":
        return (notice("gusts-no-optimum", method=instead, other=method),)
    if abs(correlation := fit.innovation_correlation) < Limits.correlation:
        return ()
    return (doubt(UnexplainedError(correlation), method, instead),)


def doubt(error: IdentificationError, method: str, instead: str) -> Notice:
    """Return why another method is taken instead of a filter that ended with an error."""
    if isinstance(error, UnexplainedError):
        return notice("gusts-not-explained", correlation=error.correlation, method=instead, other=method)
    return notice("filter-diverges", text=str(error), method=instead)


def gust_bias(fit: Estimate, flights: Mapping[str, Flight]) -> tuple[Notice, ...]:
    """Return which parameters gusts bias in a fit that ignores them, and by how much."""
    biases = gust_biases(fit, flights)
    large = [n for n, (_, size) in biases.items() if abs(size) > MIN_BIAS]
    named = sorted(large, key=lambda n: -abs(biases[n][1]))
    shown = tuple(f"{n} {biases[n][0]:+.3g} ({biases[n][1]:+.1f})" for n in named[:SHOWN])
    return (notice("gusts-bias", parameters=shown, count=len(named)),) if named else ()


@on_one_blas_thread
def gust_biases(fit: Estimate, flights: Mapping[str, Flight]) -> dict[str, tuple[float, float]]:
    """Return the bias of each parameter, SI and in standard errors of filter error; none where no filter applies."""
    own, vehicle = fit.problem.layout, with_turbulence(fit.problem.layout.vehicle)
    try:
        problem = with_gusts(estimation_problem(vehicle, flights, fit.prepared.windows, DEFAULTS)[0])
        shifted = undelayed(problem)
    except IdentificationError:  # a free delay of a sensor
        return {}
    layout, names = problem.layout, [p.name for p in own.parameters]
    # slow motion is nearer the truth by the weights of white noise
    begun = dict(zip([*names, *map(_key, own.nuisances)], fit.white.tolist(), strict=True))
    start = [begun.get(p.name, float(x)) for p, x in zip(layout.parameters, layout.start, strict=True)]
    noise = Noise(vehicle, first_guess(vehicle, problem.pieces))
    z = np.array([*start, *(begun.get(_key(n), 0.0) for n in layout.nuisances), *noise.start])
    model = ScoringModel(Likelihood.of(shifted, noise, Steady(), z), z, 0.0)
    if not np.isfinite(model.cost):
        return {}
    Stages(SCORING, 1.0).search(model, TenfoldDamping(1e-6, growth=4.0, smallest=1e-9), STEPS)
    model.linearize()
    errors = np.full(len(z), np.nan)
    errors[model.free] = np.sqrt(np.diag(invert(model.information).matrix))
    found = dict(zip(names, fit.z.tolist(), strict=False))
    rows = [(p.name, i) for i, p in enumerate(layout.parameters) if p.name in found]
    away = [(n, i, found[n] - model.z[i]) for n, i in rows]
    return {n: (float(x * layout.scales[i]), float(x / errors[i])) for n, i, x in away}


def _key(n: Nuisance) -> tuple[str, int, int | None]:
    return n.name, n.maneuver, n.piece

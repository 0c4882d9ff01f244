"""Margins of the gains that flew, and better gains, in one call each: parameters from the log, loops at the airspeeds flown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop import FittedModel, Flight, Notice, Vehicle, trim
from stoop.extend.arrays import FloatArray
from stoop.extend.fits import takes_model
from stoop.extend.flights import RECONSTRUCTED, power_spectra
from stoop.extend.notices import notice
from stoop.extend.reports import sheet
from stoop.extend.text import within_limits
from stoop.extend.units import SEA_LEVEL_DENSITY, standard_density
from stoop_analysis.draws import POSTERIOR_FILE, Draws, Source, draws_of
from stoop_analysis.frequency import FrequencyAnalysis
from stoop_analysis.workflow.propagation import flown_domain
from stoop_tune.control_laws.parameters import is_log, read_parameters
from stoop_tune.control_laws.rate_law import AXES
from stoop_tune.control_laws.table import Firmware, firmware_of
from stoop_tune.flown_loops import closed_loops
from stoop_tune.gain_search import Design, Specification
from stoop_tune.judgment import AxisMargins, Condition, LoopMargins, commands_of, plants_of, require_stable
from stoop_tune.loops import MOTION
from stoop_tune.physical_parameters import PhysicalParameters, physical_parameters
from stoop_tune.proposal import Proposal, proposal
from stoop_tune.report import tuning_page

PITOT: Final = "airspeed_pitot"
DRAWS: Final = 2000
SPEEDS: Final = 3  #: airspeeds of a range
#: of the rate of the grid, where a gyro shows noise, hardly motion, and not yet the low-pass before the grid
NOISE_BAND: Final = (0.15, 0.25)


@dataclass(frozen=True, eq=False, repr=False)
class JudgedGains(LoopMargins):
    """Margins of the gains that flew; better ones by :meth:`propose`."""

    design: Design
    against: tuple[Notice, ...]  #: why gains should not rest on this model
    band: Mapping[
        str, float
    ]  #: axis -> highest frequency, rad/s, at which the flight shows the vehicle's answer
    physics: PhysicalParameters  #: that the model determines
    #: from setpoints to rates by the log, beside the model; None of a log without setpoints, or of parameters alone
    closed_loops: FrequencyAnalysis | None = None

    def page(self, better: Proposal | None = None, command: str = "") -> sheet.Page:
        """Return the page, with a proposal if there is one; a notebook shows it, ``save(path)`` writes it."""
        design = better.design if better else self.design
        return tuning_page(self, design, better, command, self.closed_loops, self.physics)

    def document(self) -> dict[str, Any]:
        """Return all but the draws for JSON; infinite and unknown figures are null."""
        closed = self.closed_loops and self.closed_loops.to_dict()
        return {**super().document(), "physics": self.physics.rows(), "closed_loops": closed}

    def propose(self, specification: Specification | None = None) -> Proposal:
        """Search the gains of the highest rejection for which margins keep a specification over the draws.

        Raises
        ------
        StoopError
            No gains near those that flew keep it.
        """
        found = proposal(replace(self.design, specification=specification or Specification()), self.axes)
        against = (*self.against, *found.against, *beyond_band(self.band, found.after))
        return replace(found, against=against, physics=self.physics.written)


@takes_model
def tune(
    model: FittedModel,
    parameters: str | Path | Mapping[str, float],
    airspeed: tuple[float, float] | None = None,
    draws: int = DRAWS,
    seed: int = 0,
    source: Source | None = None,
) -> JudgedGains:
    """Judge the gains that flew: margins of the rate and attitude loops of an autopilot around a fitted model.

    Each loop is opened at its actuator with the others closed. The law is that of the firmware whose parameters the log
    holds, with its filters, at its own rate; the model brings lags and delays of actuators.

    Parameters
    ----------
    model : FittedModel, or the folder of one
    parameters : str, Path or mapping
        A log that holds the autopilot's parameters, a file of parameters (``.params``, ``.parm``, ``.param``, ``.config``), or
        parameters by name.
    airspeed : (low, high), m/s, optional
        True airspeeds as the pitot of the autopilot reads them; what was flown in the fitted maneuvers when absent.
    draws : int
    seed : int
    source : {"posterior", "covariance"}, optional
        The posterior where it was sampled when absent.

    Returns
    -------
    JudgedGains
        ``to_dataframe()`` has estimates and percentiles 5, 50 and 95 of the draws; ``propose()`` better gains;
        ``closed_loops`` the responses from setpoints to rates that the log shows, beside the model's.

    Raises
    ------
    StoopError
        The parameters are missing, or of another kind of vehicle, the model is not driven by commands about the axes,
        or the loops are unstable around it.
    """
    asked = None
    if airspeed is not None:
        low, high = within_limits("airspeed", airspeed, 2)
        asked = low, high
    values = read_parameters(parameters)
    log = Path(parameters) if not isinstance(parameters, Mapping) and is_log(Path(parameters)) else None
    vehicle = model.vehicle.coupled_to(())
    vehicle = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle
    firmware = firmware_of(values, bool(vehicle.rotors))
    laws = {a: firmware.law(values, a) for a in firmware.axes}
    axes = commands_of(vehicle, firmware, values).axes
    drawn = draws_of(model.result, model.attachments.get(POSTERIOR_FILE), draws, seed, source, model.source)
    pitot = pitot_readings(model.flights, vehicle, drawn)
    domain = flown_domain(model, asked and (asked[0] / pitot[0], asked[1] / pitot[0]))
    low, high = asked or np.round(np.multiply(pitot[0], domain.airspeed), 1).tolist()
    speeds = [0.0] if firmware.rotors else np.linspace(low, high, SPEEDS).tolist()
    conditions = conditions_of(vehicle, firmware, values, speeds, domain.altitude, drawn, pitot)
    design = Design(firmware, values, axes, conditions, Specification(), gyro_noise(model.flights))
    judged = design.judged(values)
    for condition, own in zip(conditions, judged, strict=True):
        require_stable(condition, own)
    found = tuple(one for at in judged for one in at)
    lacks = tuple(dict.fromkeys(text for a in axes for text in laws[a].lacks))
    lacking = [notice("tune-law-lacks", firmware=firmware.title, features=lacks)] if lacks else []
    misfits = model.result.response_misfits
    band = {a: max((m.high for m in misfits if m.output == MOTION[a][0]), default=np.inf) for a in AXES}
    closed, doubts = None, [notice("tune-no-closed-loop", "parameters alone", reason="take them from a log")]
    if log:
        closed, doubts = closed_loops(log, firmware.rotors, conditions, design.loops(values))
    slow_or_fast = [] if firmware.rotors else model.extrapolation(low, high)
    taken = [
        *slow_or_fast,
        *assumptions(design, vehicle, drawn, complete=log is not None),
        *beyond_band(band, found),
    ]
    unfit = _not_for_control(model)
    against = (*unfit, *lacking, *(one for one in doubts if one.code == "tune-loop-contradicted"))
    notices = (*unfit, *drawn.notices, *lacking, *taken, *doubts)
    streams = frozenset(s.source for f in model.flights for n, s in f.sources.items() if n in ("V", PITOT))
    physics = physical_parameters(vehicle, firmware.title, values, domain, drawn, streams, float(pitot[0]))
    known = (firmware.title, found, len(drawn.values), drawn.source, notices)
    return JudgedGains(*known, design, against, band, physics, closed)


def assumptions(design: Design, vehicle: Vehicle, drawn: Draws, complete: bool) -> list[Notice]:
    """Return what margins take for granted: noise, lags and delays, gains that are missing where parameters are not complete."""
    gains = [name for axis in design.axes for name in design.firmware.gains(axis, design.flown).values()]
    missing = () if complete else tuple(name for name in gains if name not in design.flown)
    unknown = tuple(a for a in design.axes if a not in design.noise)
    exact = tuple(
        n
        for n in vehicle.rows
        if n.startswith(("controls.", "rotors.")) and n.endswith((".lag", ".delay")) and n not in drawn.names
    )
    return [
        *(
            [notice("tune-gains-missing", parameters=missing, firmware=design.firmware.title)]
            if missing
            else []
        ),
        *([notice("tune-noise-unknown", axes=unknown)] if unknown else []),
        *([notice("tune-lags-exact", numbers=exact)] if exact else []),
    ]


def conditions_of(
    vehicle: Vehicle,
    firmware: Firmware,
    parameters: Mapping[str, float],
    speeds: Sequence[float],
    altitude: float,
    drawn: Draws,
    pitot: FloatArray | float = 1.0,
) -> list[Condition]:
    """Return linear models of a vehicle about airspeeds, zero in a hover, moved by the commands of a firmware.

    Laws are scaled by what the pitot reads, so that the airspeeds are its readings (true, m/s): `pitot` times those of the
    model, alike for all models or (1 + d,).
    """
    readings = np.atleast_1d(pitot)
    spread = math.sqrt(standard_density(np.array(altitude)) / SEA_LEVEL_DENSITY) * readings / readings[0]
    commands = commands_of(vehicle, firmware, parameters, altitude)
    points = (trim(vehicle, None if firmware.rotors else x / readings[0], altitude) for x in speeds)
    return [
        Condition(
            speed,
            np.array([[firmware.airspeed_ratio(parameters, x)] for x in speed * spread]),
            plants_of(vehicle, point, drawn, commands),
        )
        for speed, point in zip(speeds, points, strict=True)
    ]


def pitot_readings(flights: Sequence[Flight], vehicle: Vehicle, drawn: Draws) -> FloatArray:
    """Return what the pitot reads over the airspeed of the model, at the estimates and at the draws (1 + d,).

    Both are means over the airborne part of the flights that recorded a pitot; one where none did. The airspeed of the model is
    V over its scale or, where it was reconstructed, less the error of the wind, as they were estimated.
    """
    numbers = {n: np.append(vehicle.value(n), x) for n, x in drawn.numbers_of(vehicle).items()}

    def number(name: str, default: float) -> FloatArray | float:
        return numbers.get(f"sensors.{name}", vehicle.value(f"sensors.{name}", default))

    found = []
    for flight in (one for one in flights if {"V", "psi"} <= one.names):
        pitot = PITOT if PITOT in flight.names else "V"
        read, speed, heading = (flight.column(n) for n in (pitot, "V", "psi"))
        flown = flight.airborne() & np.isfinite(read + speed + heading)
        if flight.sources[pitot].source == RECONSTRUCTED or not flown.any():
            continue
        north, east = (float(np.mean(f(heading[flown]))) for f in (np.cos, np.sin))
        through = float(np.mean(speed[flown])) / number("V.scale", 1.0)
        if "sensors.V.scale" not in vehicle.rows:
            through = through - number("wind_error.x", 0.0) * north - number("wind_error.y", 0.0) * east
        found.append(np.mean(read[flown]) / through)
    return np.atleast_1d(np.mean(found, axis=0)) if found else np.ones(1)


def gyro_noise(flights: Sequence[Flight]) -> dict[str, float]:
    """Return by axis the power spectral density of a gyro's noise, (rad/s)^2/Hz, the median of flights that show it."""
    found: dict[str, list[float]] = {}
    for flight in flights:
        recorded = {MOTION[a][0]: a for a in AXES if MOTION[a][0] in flight.sources}
        fast = {n: a for n, a in recorded.items() if flight.sources[n].rate > 0.9 * flight.rate}
        low, high = (share * flight.rate for share in NOISE_BAND)
        for one in power_spectra(flight, list(fast)):
            level = one.density[(one.frequency > low) & (one.frequency < high)]
            found.setdefault(fast[one.name], []).append(float(np.median(level)))
    return {axis: float(np.median(levels)) for axis, levels in found.items()}


def _not_for_control(model: FittedModel) -> list[Notice]:
    """Return the doubt of a verdict that does not trust the model for control design."""
    justified = "control design" in model.result.verdict.justified
    return [] if justified else [notice("tune-model-not-for-control", model.source)]


def beyond_band(band: Mapping[str, float], found: Sequence[AxisMargins]) -> list[Notice]:
    """Return the axes whose loops cross where the flight no longer shows how the vehicle answers."""
    out = []
    for axis, highest in band.items():
        crossings = [float(np.nan_to_num(m.margins.crossover[0])) for m in found if m.axis == axis]
        if max(crossings, default=0.0) > highest:
            out.append(notice("tune-beyond-band", axis=axis, crossover=max(crossings), band=highest))
    return out

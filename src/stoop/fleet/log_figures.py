"""Figures of one flight from its log, each with its standard error: a registry of groups, with what each needs.

What a flight cannot tell is absent, with the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.units import STANDARD_GRAVITY
from stoop.base.variables import VARIABLES
from stoop.errors import FlightError, StoopError
from stoop.estimate.regression.least_squares import TimeDomain
from stoop.fleet.vibration import NO_VIBRATION, Vibration, Windows
from stoop.flight import Flight, without_faults
from stoop.flight.airborne import airborne, in_flight
from stoop.input_design.windows import find_windows
from stoop.performance.effectiveness import Balance, block_means, hover_commands
from stoop.performance.polar import DISC, Propulsion, blocks, fit_polar
from stoop.reconstruction.compatibility import Finding, check
from stoop.results.result import ParameterEstimate
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.workflow.identification import identify

INSTRUMENTS: Final = {
    **dict.fromkeys(("ax", "ay", "az", "p", "q", "r", "accelerometer", "rates"), "imu"),
    **dict.fromkeys(("V", "airspeed_pitot"), "pitot"), **dict.fromkeys(("alpha", "beta", "vane"), "vanes"),
    **dict.fromkeys(("velocity", "position"), "gps"),
}  # fmt: skip
"""First part of the name of an instrument error -> place of the instrument."""
FEWEST: Final = 30  #: blocks for a mean or a slope
STEADY: Final = 2.0  #: s, of blocks of airplanes
SAME: Final = 1e-6  #: standard deviation of what is the same in all flights
MOVED: Final = 0.02  #: A, rms of its changes that tells it


@dataclass(frozen=True)
class FlightFigure:
    """A figure of a flight; `parts` are the places of the parts on which it depends, separated by blanks."""

    name: str
    value: float
    std_error: float
    unit: str
    parts: str = ""


@dataclass(frozen=True)
class Group:
    """Figures that come from one evaluation; it raises `StoopError` where the flight cannot tell them."""

    needs: str
    evaluate: Callable[[Flight, Vehicle | None], Iterator[FlightFigure]]


def instruments(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield biases, scales, delays and places of the sensors against each other that the flight determines."""
    found, _ = check(flight)
    for name, one in found.findings.items():
        which = name.partition(".")[0]
        if one.identifiable and which != "wind":
            yield from without_prior(name, one, INSTRUMENTS.get(which, ""))


def without_prior(name: str, one: Finding | ParameterEstimate, parts: str) -> Iterator[FlightFigure]:
    """Yield an estimate with its prior taken off, which would draw every flight towards one value, and changes towards zero.

    Where the flight itself tells less than the prior, the difference of the two is mostly the error of the standard error.
    """
    own, prior = one.std_error**-2.0, 0.0 if np.isnan(one.prior_std) else one.prior_std**-2.0
    if own > 2.0 * prior:
        mean = one.prior_mean if prior else 0.0
        yield FlightFigure(
            name, (own * one.estimate - prior * mean) / (own - prior), (own - prior) ** -0.5, one.unit, parts
        )


def rotors(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the commanded lift near hover, and the thrust of each rotor over the mean of all."""
    if vehicle is None or not vehicle.rotors:
        raise FlightError("no vehicle with rotors was given")
    balance = Balance(vehicle)
    thrust, torque, _ = hover_commands(flight, balance)
    lift = (balance.of_thrust @ thrust + balance.of_torque @ torque)[:1]
    blocks = block_means(np.vstack([lift, thrust / thrust.mean(axis=0)]), flight.rate)
    errors = blocks.std(axis=1, ddof=1) / np.sqrt(blocks.shape[1])
    yield FlightFigure("hover.lift", float(lift.mean()), float(errors[0]), "N", " ".join(vehicle.rotors))
    for name, share, error in zip(vehicle.rotors, blocks[1:].mean(axis=1), errors[1:], strict=True):
        others = (one for one in vehicle.rotors if one != name)
        yield FlightFigure(f"share.{name}", float(share), float(error), "1", " ".join((name, *others)))


def battery(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the resistance of the battery: changes of the voltage over changes of the current from second to second.

    What the charge does to the voltage is slow, and hardly counts so.
    """
    voltage, current = _means(flight, ("voltage", "current"), np.ones(flight.time.size, np.bool_), 1.0)
    voltage, current = (np.diff(one) - np.diff(one).mean() for one in (voltage, current))
    if np.sqrt(np.mean(current**2)) < MOVED:
        raise FlightError("the current hardly changed")
    (slope,), (error,) = _regression(current[:, None], voltage, 1.0)
    yield FlightFigure("battery.resistance", -float(slope), float(error), "ohm", "battery")


def trims(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield what controls and angle of attack are at the lift coefficient of level flight at the airspeed of reference.

    They are linear in the lift coefficient, that is in load factor over dynamic pressure.
    """
    level = _level_flight(vehicle)
    controls = [] if vehicle is None else [n for n in vehicle.recorded if VARIABLES[n].kind == "command"]
    recorded = [name for name in (*controls, "alpha") if name in flight.names]
    if not recorded:
        raise FlightError("neither a control nor the angle of attack was recorded")
    needed = ("V", "az", *(("ax",) if "alpha" in recorded and "ax" in flight.names else ()))
    means = _means(flight, (*needed, *recorded), airborne(flight), STEADY)
    read = means[len(needed) :]
    normal = -means[1]
    if "ax" in needed:  # along the lift
        normal = means[2] * np.sin(read[-1]) + normal * np.cos(read[-1])
    ratio = normal / STANDARD_GRAVITY * (level.airspeed / means[0]) ** 2 - 1.0
    X = np.column_stack([np.ones_like(ratio), ratio])
    for name, values in zip(recorded, read, strict=True):
        value, error = _regression(X, values, STEADY)
        unit, own = VARIABLES[name].unit, INSTRUMENTS.get(name, name)
        yield FlightFigure(
            f"trim.{name}", float(value[0]), float(error[0]), unit, f"{own} {INSTRUMENTS['V']}"
        )


def drag(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the drag coefficient at the lift coefficient of level flight at the airspeed of reference, see `polar`.

    Efficiency and disc of the propulsion and the scale of the airspeed count as known: they are the same in all flights.
    """
    level = _level_flight(vehicle)
    cut = blocks(flight, level.mass)
    known = Propulsion(efficiency_std=SAME, diameter=DISC * level.area**0.5)
    value, error = fit_polar(cut, level.mass, level.area, SAME, known).drag(np.array([level.coefficient]))
    read = " ".join(INSTRUMENTS[name] for name in ("V", "alpha"))
    yield FlightFigure("drag.CD", float(value[0]), float(error[0]), "1", read)


def roughness(shaken: Vibration, flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the logarithm of the root mean square of what each accelerometer reads above a quarter of its rate."""
    if shaken.rough is None:
        raise FlightError(shaken.absent)
    for name, value, error in _levels(flight, shaken.rough):
        yield FlightFigure(f"vibration.{name}", value, error, "ln(m/s2)")


def imbalance(shaken: Vibration, flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the logarithm of the root mean square of the acceleration that turns with each rotor."""
    if shaken.turning is None:
        raise FlightError(shaken.absent)
    rotors = {} if vehicle is None else vehicle.file.rotor
    places = {"rotor_" + rotor.channel.rpartition("_")[2]: name for name, rotor in rotors.items()}
    for name, value, error in _levels(flight, shaken.turning):
        place = places.get(name, name)
        yield FlightFigure(f"vibration.{place}", value, error, "ln(m/s2)", place)


def _levels(flight: Flight, windows: Windows) -> Iterator[tuple[str, float, float]]:
    """Yield the mean logarithm of the root of each mean square in flight, with its error."""
    up = np.interp(windows.time, flight.time, in_flight(flight)) == 1.0
    for name, squares in windows.squares.items():
        own = squares[up]
        if own.size >= FEWEST and own.min() > 0.0:
            value, error = _regression(np.ones((own.size, 1)), 0.5 * np.log(own), windows.length)
            yield name, float(value[0]), float(error[0])


def parameters(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the free numbers of the vehicle by equation error over the flight's maneuvers, their priors taken off."""
    if vehicle is None:
        raise FlightError("no vehicle was given")
    windows = find_windows({flight.name: without_faults(flight)}, vehicle).texts("fit")
    found = identify(vehicle, [flight], windows, method="equation-error", strategy="textbook")
    for name, one in found.parameters.items():
        if one.identifiable and not one.at_bound:
            yield from without_prior(name, one, "")


@dataclass(frozen=True)
class LevelFlight:
    """An airplane in level flight at the lift coefficient that its vehicle file has at the airspeed of reference, SI."""

    mass: float
    area: float
    airspeed: float
    coefficient: float  #: of lift


def _level_flight(vehicle: Vehicle | None) -> LevelFlight:
    if vehicle is None or vehicle.rotors or vehicle.file.reference is None:
        raise FlightError("no airplane was given")
    mass, area, speed = (vehicle.value(n) for n in ("mass.mass", "reference.area", "reference.airspeed"))
    pressure = 0.5 * vehicle.value("environment.density", SEA_LEVEL_DENSITY) * speed**2
    usual = parse_vehicle(vehicle.text, vehicle.where).value(
        "mass.mass"
    )  # one lift coefficient for all flights
    coefficient = usual * STANDARD_GRAVITY / (pressure * area)
    return LevelFlight(mass, area, speed * (mass / usual) ** 0.5, coefficient)


def _means(flight: Flight, names: Sequence[str], where: BoolArray, block: float) -> FloatArray:
    """Return the means (k, m) of channels over blocks, s, where all of them are known; `FlightError` if there are few."""
    if lost := [name for name in names if name not in flight.names]:
        raise FlightError(f"{' and '.join(lost)} not recorded")
    read = np.array([flight.column(name) for name in names])
    found = block_means(read[:, where & np.isfinite(read).all(axis=0)], flight.rate, block)
    if found.shape[1] <= FEWEST:
        raise FlightError(f"{' and '.join(names)} of more than {FEWEST * block:g} s are needed")
    return found


def _regression(X: FloatArray, y: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients (k,) of y (m,) on X (m, k), rows `dt` s apart, and errors by the color of what is left."""
    inverse = np.linalg.pinv(X.T @ X)
    found = inverse @ X.T @ y
    scatter = TimeDomain().scatter(X, y - X @ found, dt)
    return found, np.sqrt(np.diag(inverse @ scatter @ inverse))


def groups(shaken: Vibration) -> Mapping[str, Group]:
    """Return the registry, for a flight that is shaken so."""
    return {
        "instruments": Group("attitude, rates and a velocity", instruments),
        "rotors": Group("commands of all motors, and a vehicle with rotors", rotors),
        "battery": Group("voltage and current", battery),
        "trims": Group("airspeed, az, controls, and an airplane", trims),
        "drag": Group("airspeed, angle of attack, accelerations, altitude, power, and an airplane", drag),
        "vibration": Group("accelerations of a flight", partial(roughness, shaken)),
        "vibration of rotors": Group("accelerations of a flight", partial(imbalance, shaken)),
        "parameters": Group("maneuvers, and a vehicle", parameters),
    }


def conditions(flight: Flight) -> Mapping[str, float]:
    """Return what differs from flight to flight by nature: density, kg/m3, and wind, m/s, where they are known."""
    names = ("density", "wind_n", "wind_e")
    columns: dict[str, FloatArray] = {name: flight.column(name) for name in names if name in flight.names}
    means: dict[str, float] = {n: float(np.nanmean(x)) for n, x in columns.items() if np.isfinite(x).any()}
    if {"wind_n", "wind_e"} <= means.keys():
        means["wind"] = float(np.hypot(means["wind_n"], means["wind_e"]))
    return {name: means[name] for name in ("density", "wind") if name in means}


def figures_of(
    flight: Flight, vehicle: Vehicle | None = None, shaken: Vibration = NO_VIBRATION
) -> tuple[list[FlightFigure], dict[str, str]]:
    """Return the figures of a flight, and for each group that it cannot tell the reason."""
    found: list[FlightFigure] = []
    absent: dict[str, str] = {}
    for name, group in groups(shaken).items():
        try:
            own = list(group.evaluate(flight, vehicle))
        except (StoopError, np.linalg.LinAlgError) as error:
            absent[name] = str(error).splitlines()[0]
            continue
        known = [one for one in own if np.isfinite(one.value) and one.std_error > 0.0]
        found += known
        if not known:
            absent[name] = f"needs {group.needs}"
    return found, absent

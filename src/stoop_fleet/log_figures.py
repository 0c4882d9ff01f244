"""Figures of one flight from its log, each with its standard error: a registry of groups, with what each needs.

What a flight cannot tell is absent, with the reason.

References
----------
.. [1] R. Frisch, *Statistical Confluence Analysis by Means of Complete Regression Systems*, Oslo, 1934.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from stoop import Flight, Vehicle, fit
from stoop.extend.arrays import BoolArray, FloatArray
from stoop.extend.errors import FlightError, StoopError
from stoop.extend.fits import ParameterEstimate, Prepared, TimeDomain, decoupled, scan_delays
from stoop.extend.flights import (
    Compatibility,
    InstrumentError,
    Window,
    density_of,
)
from stoop.extend.units import SEA_LEVEL_DENSITY, STANDARD_GRAVITY
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop.extend.vehicles import parse_vehicle
from stoop_analysis.performance.effectiveness import LIMITS, Balance, block_means, hover_commands
from stoop_analysis.performance.polar import DISC, Propulsion, blocks, fit_polar
from stoop_fleet.table import REST
from stoop_fleet.vibration import NO_VIBRATION, Vibration, Windows
from stoop_plan.input_design.windows import find_windows

INSTRUMENTS: Final = {
    **{n: "imu" for family in ("specific force", "rates", "euler") for n in FAMILIES[family]},
    **dict.fromkeys(("accelerometer", "rates", "attitude"), "imu"),
    **dict.fromkeys(("V", "airspeed_pitot"), "pitot"), **dict.fromkeys(("alpha", "beta", "vane"), "vanes"),
    **dict.fromkeys(("velocity", "position"), "gps"),
}  # fmt: skip
"""First part of the name of an instrument error -> place of the instrument."""
FEWEST: Final = 30  #: blocks for a mean or a slope
STEADY: Final = 2.0  #: s, of blocks of airplanes
SAME: Final = 1e-6  #: standard deviation of what is the same in all flights
MOVED: Final = 0.02  #: A, rms of its changes that tells it
EXACT: Final = 1e-9  #: of a value; less is round-off of readings that stood still
POINTS: Final = {"CD_slow": 0.8, "CD": 1.0, "CD_fast": 1.3}  #: of the polar: airspeeds over that of reference
#: steps of a scan from its last but one delay, up to which a parabola tells the likeliest
BEYOND: Final = 2.0


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
    found, _ = Compatibility.of(flight)
    unknown = []
    for name, one in found.findings.items():
        which = name.partition(".")[0]
        if which == "wind":
            continue
        widened = with_attenuation(found, name)
        own = list(without_prior(name, widened, INSTRUMENTS[which])) if one.identifiable else []
        yield from own
        unknown += [] if own else [name]
    if unknown:
        raise FlightError(f"not determined: {', '.join(unknown)}")


def with_attenuation(found: Compatibility, name: str) -> InstrumentError:
    """Return a finding, the error of scale, bias and delay of air data with what attenuates the scale.

    The reconstruction knows no gusts, and a regression on what has errors finds too small a scale; the true one lies between it
    and that of the reverse regression [1]_.
    """
    one, (which, _, kind) = found.findings[name], name.partition(".")
    if which not in found.channels or f"{which}.scale" not in found.findings:
        return one
    compared = [(np.isfinite(t.measured[which]), t.reconstructed[which], t.time) for t in found.traces]
    read = np.concatenate([x[known] for known, x, _ in compared])
    moving = np.concatenate([np.gradient(x, time)[known] for known, x, time in compared])
    sizes = {"scale": one.estimate, "bias": read.mean() - one.estimate, "delay": read.std() / moving.std()}
    attenuated = abs(sizes[kind]) * found.channels[which].rms ** 2 / read.var()
    return replace(one, std_error=float(np.hypot(one.std_error, attenuated)))


def without_prior(name: str, one: InstrumentError | ParameterEstimate, parts: str) -> Iterator[FlightFigure]:
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
    """Yield the commanded lift near hover, also over the voltage, and the thrust of each rotor over the mean of all."""
    if vehicle is None or not vehicle.rotors:
        raise FlightError("no vehicle with rotors was given")
    balance = Balance(vehicle)
    thrust, torque, inside = hover_commands(flight, balance)
    lift = (balance.of_thrust @ thrust + balance.of_torque @ torque)[:1]
    blocks = block_means(np.vstack([lift, thrust / thrust.mean(axis=0)]), flight.rate)
    errors = blocks.std(axis=1, ddof=1) / np.sqrt(blocks.shape[1])
    for name, share, error in zip(vehicle.rotors, blocks[1:].mean(axis=1), errors[1:], strict=True):
        others = (one for one in vehicle.rotors if one != name)
        yield FlightFigure(f"share.{name}", float(share), float(error), "1", " ".join((name, *others)))
    parts = " ".join(vehicle.rotors)
    yield FlightFigure("hover.lift", float(lift.mean()), float(errors[0]), "N", parts)
    slope, error = _over_voltage(flight, inside, blocks[0])
    yield FlightFigure("hover.voltage_slope", slope, error, "N/V", f"{parts} battery")


def _over_voltage(flight: Flight, where: BoolArray, lift: FloatArray) -> tuple[float, float]:
    """Return how the lift (m,) of blocks goes with the voltage, N/V, with its error.

    The voltage is that of the charge, a parabola in time: thrust makes it sag, too.
    """
    volts = flight.column("voltage") if "voltage" in flight.names else np.full(flight.time.size, np.nan)
    time, read = block_means(np.vstack([flight.time, volts])[:, where], flight.rate)
    if not np.isfinite(read).all():
        raise FlightError("the voltage was not recorded throughout")
    charge = np.polynomial.Polynomial.fit(time, read, 2)(time)
    X = np.column_stack([np.ones_like(charge), charge - charge.mean()])
    (level, slope), (_, error) = _regression(X, lift, LIMITS.block)
    if not 0.0 < error * read.mean() < LIMITS.slope_std * level:  # it tells no more than its prior
        raise FlightError("the voltage hardly changed")
    return float(slope), float(error)


def throttle(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the mean command of the motors that carry a vehicle, 0 to 1, in slow flight."""
    command = flight.lift_command() if flight.carried_by_rotors() else None
    if command is None:
        raise FlightError("no commands of motors that carry the vehicle")
    slow = flight.flying() & np.isfinite(command)
    if {"vn", "ve"} <= flight.names:
        slow &= np.hypot(flight.column("vn"), flight.column("ve")) < LIMITS.max_speed
    (read,) = block_means(command[None, slow], flight.rate)
    if read.size < LIMITS.min_duration:
        raise FlightError(f"{read.size} s near hover; {LIMITS.min_duration:g} s are needed at least")
    parts = "" if vehicle is None else " ".join((*vehicle.rotors, "battery"))
    error = read.std(ddof=1) / np.sqrt(read.size)
    yield FlightFigure("hover.throttle", float(read.mean()), float(error), "1", parts)


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

    They are linear in the lift coefficient, that is in load factor over dynamic pressure; slopes are over its ratio to that.
    """
    level = _level_flight(vehicle)
    controls = [] if vehicle is None else [n for n in vehicle.recorded if VARIABLES[n].kind == "command"]
    recorded = [name for name in (*controls, "alpha") if name in flight.names]
    if not recorded:
        raise FlightError("neither a control nor the angle of attack was recorded")
    needed = ("V", "az", *(("ax",) if "alpha" in recorded and "ax" in flight.names else ()))
    means = _means(flight, (*needed, *recorded), flight.airborne(), STEADY)
    read = means[len(needed) :]
    normal = -means[1]
    if "ax" in needed:  # along the lift
        normal = means[2] * np.sin(read[-1]) + normal * np.cos(read[-1])
    ratio = normal / STANDARD_GRAVITY * (level.airspeed / means[0]) ** 2 - 1.0
    X = np.column_stack([np.ones_like(ratio), ratio])
    unknown = []
    for name, values in zip(recorded, read, strict=True):
        (value, slope), (error, slope_error) = _regression(X, values, STEADY)
        unit, parts = VARIABLES[name].unit, f"{INSTRUMENTS.get(name, name)} {INSTRUMENTS['V']}"
        left, explained = np.var(values - slope * ratio), np.var(slope * ratio)
        if np.ptp(values) <= EXACT * np.abs(values).max():
            unknown.append(f"trim.{name}")
            continue
        yield FlightFigure(f"trim.{name}", float(value), float(error), unit, parts)
        if explained <= left:
            unknown.append(f"trim_slope.{name}")
            continue
        # gusts are in the lift, too: see `with_attenuation`
        slope_error = np.hypot(slope_error, slope * left / explained)
        yield FlightFigure(f"trim_slope.{name}", float(slope), float(slope_error), unit, parts)
    if unknown:
        raise FlightError(f"not determined: {', '.join(unknown)}")


def drag(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the drag coefficient at lift coefficients of level flight about the airspeed of reference, see `polar`.

    Efficiency and disc of the propulsion and the scale of the airspeed count as known: they are the same in all flights.
    """
    level = _level_flight(vehicle)
    cut = blocks(flight, level.mass)
    known = Propulsion(efficiency_std=SAME, diameter=DISC * level.area**0.5)
    polar = fit_polar(cut, level.mass, level.area, SAME, known)
    read, (low, high) = " ".join(INSTRUMENTS[name] for name in ("V", "alpha")), polar.valid
    flown = {n: CL for n, over in POINTS.items() if low <= (CL := level.coefficient / over**2) <= high}
    values, errors = polar.drag(np.array([*flown.values()]))
    for name, value, error in zip(flown, values, errors, strict=True):
        yield FlightFigure(f"drag.{name}", float(value), float(error), "1", read)
    if len(flown) < len(POINTS):
        raise FlightError(f"flown at lift coefficients from {low:.2f} to {high:.2f} only")


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
    up = np.interp(windows.time, flight.time, flight.in_flight()) == 1.0
    for name, squares in windows.squares.items():
        own = squares[up]
        if own.size >= FEWEST and own.min() > 0.0:
            value, error = _regression(np.ones((own.size, 1)), 0.5 * np.log(own), windows.length)
            yield name, float(value[0]), float(error[0])


def parameters(flight: Flight, vehicle: Vehicle | None) -> Iterator[FlightFigure]:
    """Yield the free numbers of the vehicle by equation error over the flight's maneuvers, their priors taken off."""
    if vehicle is None:
        raise FlightError("no vehicle was given")
    flights = {flight.name: flight.without_faults()}
    windows = find_windows(flights, vehicle).texts("fit")
    found = fit(vehicle, [flight], windows, method="equation-error", strategy="textbook")
    for name, one in found.parameters.items():
        if one.identifiable and not one.at_bound:
            yield from without_prior(name, one, "")
    yield command_delay(vehicle, flights, windows)


def command_delay(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[str]) -> FlightFigure:
    """Return by how much all commands are late beyond the lags of the vehicle: the peak of the likelihood of `scan_delays`."""
    fitted = Window.several(windows, flights)
    own = decoupled(vehicle, flights, fitted)
    columns = [i for i, name in enumerate(own.recorded) if VARIABLES[name].kind == "command"]
    scan = scan_delays(own, Prepared.of(own, flights, fitted).pieces, columns) if columns else None
    if scan is None:
        raise FlightError("neither commands nor rates tell the delay of commands")
    likelihood = scan.log_likelihood
    best = int(np.clip(np.argmax(likelihood), 1, len(likelihood) - 2))
    before, at, after = likelihood[best - 1 : best + 2]
    curvature, slope = 2.0 * at - before - after, 0.5 * (after - before)
    if not abs(slope) < BEYOND * curvature:
        raise FlightError("the delay of commands is not determined")
    step = float(scan.delays[1])
    value, error = scan.delays[best] + step * slope / curvature, step * curvature**-0.5
    moved = vehicle.rotors or [own.recorded[i] for i in columns]
    return FlightFigure("delay.commands", float(value), float(error), "s", " ".join((*moved, "software")))


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
    # one lift coefficient for all flights, whatever their mass
    usual = parse_vehicle(vehicle.text, vehicle.where).value("mass.mass")
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
        "hover": Group("commands of motors that carry a vehicle", throttle),
        "rotors": Group("commands of all motors, and a vehicle with rotors", rotors),
        "battery": Group("voltage and current", battery),
        "trims": Group("airspeed, az, controls, and an airplane", trims),
        "drag": Group("airspeed, angle of attack, accelerations, altitude, power, and an airplane", drag),
        "vibration": Group("accelerations of a flight", partial(roughness, shaken)),
        "vibration of rotors": Group("accelerations of a flight", partial(imbalance, shaken)),
        "parameters": Group("maneuvers, and a vehicle", parameters),
    }


def conditions(flight: Flight) -> Mapping[str, float]:
    """Return what differs from flight to flight by nature, if known: density, kg/m3, temperature, K, and wind, m/s."""
    names = ("density", "pressure", "temperature", "wind_n", "wind_e")
    read: dict[str, FloatArray] = {name: flight.column(name) for name in names if name in flight.names}
    if (density := density_of(read)) is not None:
        read["density"] = density[0]
    means: dict[str, float] = {n: float(np.nanmean(x)) for n, x in read.items() if np.isfinite(x).any()}
    air = flight.air
    if air is not None and air.wind_known and air.method != "still air":
        means = {"wind_n": air.wind_n, "wind_e": air.wind_e} | means
    if {"wind_n", "wind_e"} <= means.keys():
        means["wind"] = float(np.hypot(means["wind_n"], means["wind_e"]))
    return {name: means[name] for name in ("density", "temperature", "wind") if name in means}


def figures_of(
    flight: Flight, vehicle: Vehicle | None = None, shaken: Vibration = NO_VIBRATION
) -> tuple[list[FlightFigure], dict[str, str]]:
    """Return the figures of a flight, and for each group, or the rest of it, that it cannot tell the reason."""
    found: list[FlightFigure] = []
    absent: dict[str, str] = {}
    for name, group in groups(shaken).items():
        own, reason = list[FlightFigure](), ""
        try:
            for one in group.evaluate(flight, vehicle):
                if np.isfinite(one.value) and one.std_error > EXACT * abs(one.value):
                    own.append(one)
        except (StoopError, np.linalg.LinAlgError) as error:
            reason = str(error).splitlines()[0]
        found += own
        if not own:
            absent[name] = reason or f"needs {group.needs}"
        elif reason:
            absent[f"{REST}{name}"] = reason
    return found, absent

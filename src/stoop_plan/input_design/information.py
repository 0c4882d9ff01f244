"""Fisher information of a maneuver before it is flown.

It is that of the readings of a flight from trim with the sensors' noise, the initial state and the biases unknown, added
to the information that there is already.

References
----------
V. Klein, E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 9
(experiment design). V. V. Fedorov, *Theory of Optimal Experiments*, Academic Press, 1972 (D-optimality).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from stoop import Flight, Vehicle
from stoop.extend import fits
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import IdentificationError, SimulationError
from stoop.extend.flights import Window
from stoop.extend.motion import Maneuver, Trim, fly_together, recorded
from stoop_plan.input_design.sensitivity import (
    BOX_INFORMATION,
    CandidateProblem,
    VehicleInformation,
    pieces_of,
)

Span = tuple[float, float]
AMPLITUDE: Final = math.radians(3.0)  #: of every control that is not given one
SLEW: Final = math.radians(60.0)  #: rad/s; a slow servo
STANDARD_GRAVITY: Final = 9.80665  #: m/s2
DEFAULT_WIDTH: Final = {
    "V": 0.2, "az": STANDARD_GRAVITY, **dict.fromkeys(("p", "q", "r"), math.radians(60.0)),
    "alpha": math.radians(6.0), "beta": math.radians(8.0), "phi": math.radians(35.0), "theta": math.radians(20.0),
}  #: about the trim, where a linear aerodynamic model usually holds: share of the airspeed, m/s2, rad/s, rad  # fmt: skip
#: rad, of a surface; smaller steps are lost in backlash and friction of a servo (our choice)
MIN_AMPLITUDE: Final = math.radians(0.5)
DEAD_ZONES: Final = 4.0  #: of a servo, that a step must be larger than
ON_ROTORS: Final = {"roll": 10.0, "pitch": 10.0, "yaw": 1.0, "heave": 1.5}  #: amplitudes, rad/s2 and m/s2
ROTOR_WIDTH: Final = {
    **dict.fromkeys(("vn", "ve", "vd"), 4.0), **dict.fromkeys(("p", "q", "r"), math.radians(150.0)),
    **dict.fromkeys(("phi", "theta"), math.radians(25.0)),
}  #: about hover, m/s, rad/s, rad  # fmt: skip


def amplitude_text(control: str, value: float) -> str:
    """Return an amplitude of an input, SI, with its unit."""
    unit = Maneuver.unit_of(control)
    return f"{math.degrees(value):.3g} deg" if unit == "rad" else f"{value:.3g} {unit}"


@dataclass(frozen=True)
class Limits:
    """Limits of a maneuver.

    Attributes
    ----------
    amplitude : mapping of control to the largest deflection from the trim, rad; on rotors in the unit of the command
    slew : mapping of control to its largest rate, rad/s, of those that have one
    envelope : mapping of channel to (low, high), SI
    min_amplitude : mapping of control to the smallest amplitude that can be flown
    """

    amplitude: Mapping[str, float]
    slew: Mapping[str, float]
    envelope: Mapping[str, Span]
    min_amplitude: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def about(
        cls,
        vehicle: Vehicle,
        trim: Trim,
        amplitude: Mapping[str, float] | None = None,
        slew: float = SLEW,
        envelope: Mapping[str, Span] | None = None,
        min_amplitude: Mapping[str, float] | None = None,
    ) -> Limits:
        """Return limits about a steady flight: those that are given, defaults for other controls and channels.

        The rate limit and the dead zone of a servo in the vehicle file bound slew and smallest amplitude of its control.

        Raises
        ------
        SimulationError
            A control or a channel that the vehicle does not have, a trim outside its own envelope, or an amplitude below
            the smallest that can be flown.
        """
        own, wanted, least, where = (
            dict(amplitude or {}),
            dict(envelope or {}),
            dict(min_amplitude or {}),
            vehicle.where,
        )
        controls = usual_amplitudes(vehicle, trim)
        for given, names, kind in (
            (own, controls, "control"), (least, controls, "control"), (wanted, vehicle.outputs, "channel"),
        ):  # fmt: skip
            for name in given:
                if name not in names:
                    choices = ", ".join(names) or "none"
                    raise SimulationError(f"{where}: there is no {kind} '{name}'; choose from {choices}")
        for channel, (low, high) in wanted.items():
            value = trim.start.get(channel, 0.5 * (low + high))
            if not low < value < high:
                raise SimulationError(
                    f"{where}: the steady flight has {channel} = {value:.4g}, which is not between {low:.4g} and {high:.4g}; "
                    "widen that limit or choose another airspeed"
                )
        amplitudes = {c: own.get(c, usual) for c, usual in controls.items()}
        moved = {c: a for c, a in amplitudes.items() if a > 0.0}
        if not moved:
            raise SimulationError(
                f"{where}: no control is moved ({', '.join(amplitudes) or 'it has none'}); "
                "give one an amplitude above zero"
            )
        surfaces = [c for c in moved if c in vehicle.controls]
        rates = {c: min(slew, vehicle.value(f"controls.{c}.rate_limit", math.inf)) for c in surfaces}
        zones = {c: DEAD_ZONES * vehicle.value(f"controls.{c}.dead_zone", 0.0) for c in surfaces}
        floors = {
            c: max(least.get(c, MIN_AMPLITUDE if c in zones else 0.0), zones.get(c, 0.0)) for c in moved
        }
        for c, a in moved.items():
            if a < floors[c]:
                raise SimulationError(
                    f"{where}: the amplitude of {c}, {amplitude_text(c, a)}, is below the smallest that can be flown, "
                    f"{amplitude_text(c, floors[c])}; raise --amplitude, lower --min-amplitude, "
                    f"or exclude the control with --amplitude {c}=0"
                )
        widths: dict[str, float] = ROTOR_WIDTH
        steady: dict[str, float] = {**trim.start, **dict(zip(("vn", "ve", "vd"), trim.velocity, strict=True))}
        if trim.on_wings:
            steady = {**trim.start, "az": -STANDARD_GRAVITY * math.cos(trim.start["theta"])}
            widths = {**DEFAULT_WIDTH, "V": DEFAULT_WIDTH["V"] * steady["V"]}
        middles = {c: (steady.get(c, 0.0), width) for c, width in widths.items() if c in vehicle.outputs}
        inside = {c: (x - w, x + w) for c, (x, w) in middles.items()}
        return cls(moved, rates, inside | wanted, floors)

    def check_flyable(self, maneuver: Maneuver) -> None:
        """Refuse a maneuver whose inputs are smaller than what can be flown.

        Raises
        ------
        SimulationError
            With what limits it.
        """
        for control, moves in maneuver.deflections().items():
            reached, least = float(np.abs(moves).max()), self.min_amplitude.get(control, 0.0)
            if reached < 0.98 * least:  # samples do not meet the peaks of a multisine
                at = f" at {math.degrees(self.slew[control]):.3g} deg/s" if control in self.slew else ""
                raise SimulationError(
                    f"{control} reaches only {amplitude_text(control, reached)}{at}, less than the smallest step, "
                    f"{amplitude_text(control, least)}; raise --slew, take longer steps (--duration), "
                    "lower --band or --min-amplitude"
                )

    def excess(self, readings: FloatArray, outputs: Sequence[str]) -> float:
        """Return by how much readings (n, n_y) leave the envelope, in its widths; zero inside."""
        out = 0.0
        for channel, values in zip(outputs, readings.T, strict=True):
            if channel in self.envelope:
                low, high = self.envelope[channel]
                over = max(low - float(values.min()), float(values.max()) - high)
                out = max(out, over / (high - low))
        return out


def usual_amplitudes(vehicle: Vehicle, trim: Trim) -> dict[str, float]:
    """Return the controls of a steady flight with usual amplitudes: surfaces, or on rotors commands of the autopilot."""
    return dict.fromkeys(vehicle.controls, AMPLITUDE) if trim.on_wings else dict(ON_ROTORS)


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Fisher information (k, k) about some parameters before the next flight, in inverse products of their units."""

    names: tuple[str, ...]
    information: FloatArray

    @classmethod
    def none(cls) -> Knowledge:
        """Return no information."""
        return cls((), np.zeros((0, 0)))

    @classmethod
    def of_result(cls, result: fits.Result) -> Knowledge:
        """Return the information of an identification about its identifiable parameters."""
        covariance, names, parameters = result.covariance.matrix, result.covariance.names, result.parameters
        finite = (np.diag(covariance) > 0.0) & (np.diag(covariance) < np.inf)
        known = [i for i, n in enumerate(names) if parameters[n].identifiable and finite[i]]
        return cls(tuple(names[i] for i in known), fits.invert(covariance[np.ix_(known, known)]).matrix)

    def among(self, names: tuple[str, ...]) -> FloatArray:
        """Return the information (n, n) about the parameters of a list, zeros for unknown ones."""
        out = np.zeros((len(names), len(names)))
        shared = [i for i, n in enumerate(self.names) if n in names]
        others = [i for i in range(len(self.names)) if i not in shared]
        place = [names.index(self.names[i]) for i in shared]
        own = self.information[np.ix_(shared, shared)]
        if others:  # the others are unknown: marginal information
            cross = self.information[np.ix_(shared, others)]
            lost: FloatArray = cross @ fits.invert(self.information[np.ix_(others, others)]).matrix @ cross.T
            own = own - lost
        out[np.ix_(place, place)] = own
        return out


@dataclass(frozen=True, eq=False)
class Forecast:
    """Predicted readings (n, n_y) of a maneuver without noise, not finite where the flight diverges.

    ``excess`` is by how much they leave the envelope, in its widths, infinite for a flight that diverges; ``information``
    (D, D) is about the parameters in the unit box, everything else unknown, without prior knowledge.
    """

    readings: FloatArray
    excess: float
    information: FloatArray


@dataclass(frozen=True, eq=False)
class Setup:
    """A vehicle in steady flight, the limits of its maneuvers, and the information about its parameters.

    The parameters are the free numbers of the vehicle, at their present values; ``noise`` (n_y, n_y) is the covariance of
    the measurement noise. With ``retrim``, s, the aircraft flies as trimmed again that long before each input, as a pilot does
    who flies one line of a card after the other; each line has an initial state and sensor biases of its own.
    """

    vehicle: Vehicle
    trim: Trim
    limits: Limits
    knowledge: Knowledge
    noise: FloatArray
    retrim: float | None = None

    @cached_property
    def layout(self) -> fits.Layout:
        """Parameters without priors: prior information stands in `knowledge` alone."""
        layout = fits.Layout.of(self.vehicle, ())
        if not layout.parameters:
            raise IdentificationError(
                f"{self.vehicle.where}: no number is free; set free = true or use --free NAME"
            )
        return replace(layout, parameters=tuple(replace(p, prior=None) for p in layout.parameters))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the parameters."""
        return tuple(p.name for p in self.layout.parameters)

    @cached_property
    def values(self) -> FloatArray:
        """Return their present values (D,), SI."""
        return np.array([p.value for p in self.layout.parameters])

    @cached_property
    def known(self) -> FloatArray:
        """Information (D, D) that there is before the flight, in the unit box."""
        return self.knowledge.among(self.names) * np.outer(self.layout.width, self.layout.width)

    def forecast(self, maneuver: Maneuver, only_inside: bool = False) -> Forecast:
        """Return the predicted readings of a maneuver and their information: :func:`forecasts` of one flight."""
        return forecasts([(self, maneuver)], only_inside)[0]

    def std(self, *forecasts: Forecast) -> FloatArray:
        """Return the standard errors (D,), SI, that flights with these forecasts leave, with what is known."""
        whole = self.known + sum((f.information for f in forecasts), np.zeros_like(self.known))
        return information_errors(whole) * self.layout.width

    def gain(self, forecast: Forecast) -> float:
        """Return the mean logarithm of how much smaller a flight makes the parameters' uncertainty ellipsoid.

        D-optimality: log det of the information, per parameter; the box counts as weak knowledge, so that a
        parameter that is not excited costs much, but not infinitely much.
        """
        whole = self.known + BOX_INFORMATION * np.eye(len(self.names))
        after = np.linalg.slogdet(whole + forecast.information)[1] - np.linalg.slogdet(whole)[1]
        return 0.5 * float(after) / len(self.names)

    def with_values(self, values: FloatArray) -> Setup:
        """Return the setup with other values (D,) of the parameters, trimmed at the same speed."""
        from stoop import trim

        vehicle = self.vehicle.with_numbers(
            {n: {"value": float(v)} for n, v in zip(self.names, values, strict=True)}
        )
        return replace(
            self, vehicle=vehicle, trim=trim(vehicle, self.trim.start.get("V"), self.trim.start["h"])
        )


def information_errors(information: FloatArray) -> FloatArray:
    """Return the standard errors (n,) that information (n, n) leaves; infinite where it determines nothing."""
    inverse = fits.invert(information)
    return np.where(inverse.determined, np.sqrt(np.maximum(np.diag(inverse.matrix), 0.0)), np.inf)


def marginal(J: FloatArray, d: int) -> FloatArray:
    """Return the information (d, d) about the first d unknowns when the others are estimated too.

    A reading with a sensitivity in J (n, k), whitened, that is not finite has no information: neither about that parameter
    nor, as if it were known, about the others. Others that are not identifiable take only what they share.
    """
    J = J[np.isfinite(J).all(axis=1)]
    whole = J.T @ J
    shared = fits.invert(whole[d:, d:]).factor.T @ whole[d:, :d]
    out: FloatArray = whole[:d, :d] - shared.T @ shared
    return 0.5 * (out + out.T)


def forecasts(flights: Sequence[tuple[Setup, Maneuver]], only_inside: bool = False) -> list[Forecast]:
    """Return the predicted readings of maneuvers and their information; flights on rotors are flown side by side.

    With ``only_inside`` the information is zero where the flight leaves the envelope.
    """
    hovering = {i: one for i, one in enumerate(flights) if not one[0].trim.on_wings}
    vehicles = [(setup.vehicle, maneuver) for setup, maneuver in hovering.values()]
    flown = {
        i: one if isinstance(one, SimulationError) else recorded(*pair, one, 0, False, "design")
        for i, pair, one in zip(hovering, vehicles, fly_together(vehicles), strict=True)
    }
    return [
        forecast_on_rotors(*one, flown[i], only_inside)
        if i in hovering
        else forecast_on_wings(*one, only_inside)
        for i, one in enumerate(flights)
    ]


def flights_from_trim(maneuver: Maneuver, retrim: float | None) -> tuple[Maneuver, ...]:
    """Return the flights of a maneuver, each from trim, whose inputs are `retrim`, s, after it; the maneuver itself without."""
    if retrim is None:
        return (maneuver,)
    first, t = sorted(one.start - retrim for one in maneuver.input)[1:], maneuver.time
    out = []
    for a, b in pairwise([0, *np.searchsorted(t, np.array(first) - 1e-9).tolist(), len(t)]):
        begin, end = float(t[a]), float(t[b - 1])
        inputs = (
            one.model_copy(update={"start": round(one.start - begin, 9)})
            for one in maneuver.input
            if begin <= one.start <= end
        )
        out.append(maneuver.model_copy(update={"duration": round(end - begin, 9), "input": tuple(inputs)}))
    return tuple(out)


def forecast_on_wings(setup: Setup, maneuver: Maneuver, only_inside: bool) -> Forecast:
    """Return the forecast of a maneuver that is flown open loop, line by line from trim; as of :func:`forecasts`."""
    lines = [_forecast_of_line(setup, one, only_inside) for one in flights_from_trim(maneuver, setup.retrim)]
    readings, excess = np.concatenate([one.readings for one in lines]), max(one.excess for one in lines)
    if not np.isfinite(excess) or (only_inside and excess > 0.0):
        return Forecast(readings, excess, np.zeros_like(setup.known))
    return Forecast(readings, excess, np.sum([one.information for one in lines], axis=0))


def _forecast_of_line(setup: Setup, maneuver: Maneuver, only_inside: bool) -> Forecast:
    """Return the forecast of one flight, whose initial state and sensor biases are its own, as those of a window in a fit."""
    vehicle, t = setup.vehicle, maneuver.time
    inputs = setup.trim.inputs_about(vehicle, maneuver.deflections(), len(t))
    blank = np.zeros((len(t), len(vehicle.outputs)))
    piece = fits.Piece(0, t, inputs, blank, setup.trim.start, setup.trim.changes)
    prepared = fits.Prepared((Window("design", 0.0, float(t[-1])),), (piece,), ())
    layout = replace(setup.layout, nuisances=prepared.nuisances(vehicle))
    problem = fits.Misfit(layout, (piece,), fits.Weights.of(setup.noise), ((len(t),),))
    z = np.concatenate([setup.layout.unit(setup.values), np.zeros(problem.extra)])
    with np.errstate(invalid="ignore", over="ignore"):
        readings = problem.outputs(z, 0)
    finite = bool(np.isfinite(readings).all())
    excess = setup.limits.excess(readings, setup.vehicle.outputs) if finite else np.inf
    if not finite or (only_inside and excess > 0.0):
        return Forecast(readings, excess, np.zeros_like(setup.known))
    r = problem.residuals(z[None, :], 0)[0]
    J, _ = problem.jacobian(z, 0, r)
    return Forecast(readings, excess, marginal(J.dense(), problem.dimension))


def forecast_on_rotors(
    setup: Setup, maneuver: Maneuver, flight: Flight | SimulationError, only_inside: bool
) -> Forecast:
    """Return readings and information of a flight under the autopilot; as of :func:`forecasts`."""
    vehicle, nothing = setup.vehicle, np.zeros_like(setup.known)
    if isinstance(flight, SimulationError):  # it diverges
        return Forecast(np.full((len(maneuver.time), len(vehicle.outputs)), np.nan), np.inf, nothing)
    readings = np.column_stack([flight.column(c) for c in vehicle.outputs])
    excess = setup.limits.excess(readings, vehicle.outputs)
    if only_inside and excess > 0.0:
        return Forecast(readings, excess, nothing)
    # without noise a reading that does not change is not stuck
    prepared = fits.Prepared.of(vehicle, {flight.name: flight}, [Window(flight.name, 0.0, maneuver.duration)])
    pieces = tuple(part for piece in prepared.pieces for part in pieces_of(vehicle, piece))
    problem = CandidateProblem(replace(prepared, pieces=pieces), (len(pieces),))
    unit = setup.layout.unit(setup.values)
    at = VehicleInformation(vehicle, unit, fits.Weights.of(setup.noise), np.inf)
    information = at.information(problem)
    return Forecast(readings, excess, nothing if information is None else information)

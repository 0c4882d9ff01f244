"""Flights and windows -> pieces, nuisances and notices."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import rankdata

from stoop.base.arrays import BoolArray, FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import WRAPPED
from stoop.errors import FlightError, VehicleError
from stoop.flight import Flight, Segment, segments
from stoop.flight.flight import MIN_SEGMENT
from stoop.flight.gridding import complete
from stoop.problem import Nuisance, Piece, observation
from stoop.problem.misfit import HISTORY
from stoop.problem.windows import Window
from stoop.results.decisions import DecisionRecord, applied
from stoop.vehicle import Vehicle

SPIKE_SAMPLES: Final = 7  #: of a running median, which takes off up to three spikes
SPIKE_RATIO: Final = 30.0  #: stated standard deviations; vibration and gusts stay below
MIN_RANKS: Final = 50  #: samples, from which a rank correlation of `NEIGHBOR_CORRELATION` is seen
#: rank correlation of neighbors, below which they say nothing of one another
NEIGHBOR_CORRELATION: Final = 0.3


@dataclass(frozen=True, eq=False)
class Prepared:
    """Windows, one per maneuver, cut into pieces; the notices say what was trimmed, split, dropped or defaulted."""

    windows: tuple[Window, ...]
    pieces: tuple[Piece, ...]
    notices: tuple[Notice, ...] = ()
    #: that were taken by itself
    decisions: tuple[DecisionRecord, ...] = ()

    def of_maneuver(self, maneuver: int) -> list[int]:
        """Return the indices of a maneuver's pieces."""
        return [i for i, p in enumerate(self.pieces) if p.maneuver == maneuver]

    @staticmethod
    def of(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> Prepared:
        """Cut windows out of flights.

        Raises
        ------
        FlightError
            A channel that the vehicle needs is not in the flight, or nothing observable is.
        """
        pieces: list[Piece] = []
        notices: list[Notice] = []
        needed = ("altitude", *(c for c in observation.state_channels(vehicle) if c not in vehicle.outputs))
        for index, window in enumerate(windows):
            flight = with_average_voltage(vehicle, flights[window.flight])
            extras = tuple(name for name in needed if name in flight.names)
            here = decoupled(vehicle, flights, [window]).measured
            moving = [c for c in here if c in vehicle.measured]
            driving = [*vehicle.recorded, *moving]
            cut, found = segments(flight, window.start, window.stop, driving, vehicle.outputs, extras)
            notices += found
            if not any(np.isfinite(s.z).any() for s in cut):
                raise FlightError(
                    f"{window}: none of {', '.join(vehicle.outputs)} was recorded there; choose another window"
                )
            changes, before = _loading(vehicle, window), len(pieces)
            derived = [c for c, source in flight.sources.items() if source.derived]
            for segment in cut:
                piece, found = _piece(vehicle, window, segment, index, changes, moving, derived)
                if piece is not None:
                    pieces.append(replace(piece, before=_commands_before(vehicle, flight, piece.time[0])))
                notices += found
            if len(pieces) == before:
                raise FlightError(
                    f"{window}: nowhere {MIN_SEGMENT:g} s in which its whole state was measured; choose another window"
                )
        return Prepared(tuple(windows), tuple(pieces), tuple(notices))

    def without_stuck_channels(self, vehicle: Vehicle) -> Prepared:
        """Take a channel that never changes, or is all spikes, for one that was not measured.

        The estimated noise of the former would go to zero; the latter holds nothing else.
        """
        lost, found = np.zeros(len(vehicle.outputs), dtype=np.bool_), []
        for i, channel in enumerate(vehicle.outputs):
            columns = [p.measured[np.isfinite(p.measured[:, i]), i] for p in self.pieces]
            columns = [np.unwrap(c) if channel in WRAPPED else c for c in columns if c.size]
            if sum(c.size for c in columns) < 2:
                continue
            stuck = _constant(columns)
            lost[i] = stuck or _all_spikes(columns, getattr(vehicle.file.sensors, channel).sigma)
            if lost[i]:
                found.append(notice("stuck-channel" if stuck else "outliers-left-out", channel))
        if not found:
            return self
        pieces = tuple(replace(p, measured=np.where(lost, np.nan, p.measured)) for p in self.pieces)
        taken = applied("stuck-channels", found, "treated as not measured")
        notices, decisions = (*self.notices, *found), (*self.decisions, *taken)
        return replace(self, pieces=pieces, notices=notices, decisions=decisions)

    def nuisances(self, vehicle: Vehicle) -> tuple[Nuisance, ...]:
        """Return the nuisances: initial states of every piece, free biases of every maneuver.

        The prior of how far a lagged actuator is off its command at the start is a share of its largest command.

        Raises
        ------
        VehicleError
            A bias has bounds.
        """
        model, out = observation.observation_model(vehicle), []
        free = {p.name: p for p in vehicle.parameters if p.free}
        priors = {name: p.prior for name, p in free.items() if p.prior is not None}
        for i, piece in enumerate(self.pieces):
            for name in model.start_names(vehicle):
                scale = model.start_scales.get(name, observation.OTHER_SCALE)
                actuator = name.removesuffix(".lag")
                if actuator != name and actuator in vehicle.rotors:
                    rows = np.repeat(vehicle.parameter_rows(piece.changes), len(piece.inputs), axis=1)
                    largest = float(np.max(vehicle.commanded(actuator, rows, piece.inputs.T)))
                    scale *= largest or vehicle.value("rotors.gain")
                scale = math.hypot(scale, *errors_of_start(priors, name, piece.start))
                out.append(Nuisance(name, piece.maneuver, i, piece.start.get(name, 0.0), scale))
        biases = {i: free[n] for i, c in enumerate(vehicle.outputs) if (n := f"sensors.{c}.bias") in free}
        for i, bias in biases.items():
            if getattr(vehicle.file.sensors, vehicle.outputs[i]).bias.bounds is not None:
                raise VehicleError(
                    f"{vehicle.where}: {bias.name}: a bias takes no bounds; write prior = SIGMA instead"
                )
        for maneuver in range(len(self.windows)):
            own = [self.pieces[i].measured for i in self.of_maneuver(maneuver)]
            for i, bias in biases.items():
                if any(np.isfinite(measured[:, i]).any() for measured in own):
                    out.append(Nuisance(bias.name, maneuver, None, bias.prior_mean, bias.prior or 1.0))
        return tuple(out)


def _commands_before(vehicle: Vehicle, flight: Flight, start: float) -> FloatArray:
    """Return the recorded channels (m, n_c) of up to `HISTORY` s before a piece, as far as they are without a hole."""
    k = int(np.searchsorted(flight.time, start))
    first = max(0, k - round(HISTORY * flight.rate))
    columns = [flight.column(c)[first:k] for c in vehicle.recorded]
    rows = np.reshape(columns, (len(columns), k - first)).T
    holes = np.flatnonzero(~complete(rows))
    return rows[holes[-1] + 1 :] if holes.size else rows


def decoupled(vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]) -> Vehicle:
    """Return a reduced vehicle that takes the states which it leaves out from the record, as far as some window has them."""

    def recorded(channel: str, window: Window) -> bool:
        flight = flights[window.flight]
        inside = (flight.time >= window.start) & (flight.time <= window.stop)
        return channel in flight.names and bool(np.isfinite(flight.column(channel)[inside]).any())

    there = {c for c in vehicle.held_channels for w in windows if recorded(c, w)}
    return vehicle.coupled_to(there if there >= set(observation.REQUIRED.get(vehicle.reduce, ())) else ())


def with_average_voltage(vehicle: Vehicle, flight: Flight) -> Flight:
    """Return the flight with a voltage as slow as the vehicle's rotors take it (`rotors.voltage_average`, s).

    A battery sags while motors pull. That goes with the command and is in the thrust's polynomial already; and it is
    quicker than most logs hold the voltage. The mean over many seconds shows the charge of the battery.
    """
    rotors = vehicle.file.rotors
    if rotors is None or rotors.voltage_average is None or "voltage" not in flight.names:
        return flight
    volts = flight.column("voltage")
    there = np.isfinite(volts)
    sums = np.concatenate([[[0.0, 0.0]], np.cumsum(np.column_stack([np.nan_to_num(volts), there]), axis=0)])
    half = round(0.5 * rotors.voltage_average * flight.rate)
    k = np.arange(len(volts))
    total, count = (sums[np.minimum(k + half + 1, len(volts))] - sums[np.maximum(k - half, 0)]).T
    mean = np.where(there, total / np.maximum(count, 1.0), np.nan)
    return replace(flight, data=flight.data.assign(voltage=("time", mean, flight.data["voltage"].attrs)))


def _piece(
    vehicle: Vehicle,
    window: Window,
    segment: Segment,
    index: int,
    changes: dict[str, float],
    moving: Sequence[str],
    derived: Sequence[str],
) -> tuple[Piece | None, list[Notice]]:
    """Make a piece that begins where the state can be read off the measurements; None where little is left."""
    blank = np.full(len(segment.t), np.nan)
    columns = dict(zip(vehicle.outputs, segment.z.T, strict=True)) | dict(segment.extras)
    readings = {c: columns.get(c, blank) for c in observation.state_channels(vehicle)}
    first = observation.first_complete(readings)
    t, where = segment.t[first:], str(window)
    if t[-1] - t[0] < 0.9 * MIN_SEGMENT:
        span = {"start": float(segment.t[0]), "stop": float(segment.t[-1])}
        return None, [notice("piece-dropped", where, **span)]
    notices = [notice("piece-starts-late", where, time=float(t[0]))] if first else []
    start, missing = observation.guess_start(vehicle, t, {c: v[first:] for c, v in readings.items()}, where)
    if missing:
        notices.append(notice("start-defaulted", where, channels=tuple(missing)))
    altitude = segment.extras.get("altitude", np.empty(0))[first:]
    recorded = altitude[np.isfinite(altitude)]
    if not recorded.size and vehicle.file.environment.density == "standard":
        raise FlightError(
            f"{window}: no altitude was recorded; write environment.density as a number in {vehicle.where}"
        )
    start["h"] = float(recorded[0]) if recorded.size else 0.0
    u = np.zeros((len(t), len(vehicle.inputs)))  # zeros: what is no channel, and the noise behind gusts
    driven = len(vehicle.recorded)
    u[:, :driven] = segment.u[first:, :driven]
    if vehicle.motion:
        columns |= dict(zip(moving, segment.u[:, driven:].T, strict=True))
        motion = observation.motion_inputs(vehicle, columns, float(t[1] - t[0]))
        u[:, u.shape[1] - len(vehicle.motion) :] = motion[first:]
    piece = Piece(index, t, np.ascontiguousarray(u), segment.z[first:], start, changes)
    return _without(piece, [c in derived for c in vehicle.outputs]), notices


def _without(piece: Piece, unread: BoolArray | Sequence[bool]) -> Piece:
    """Return a piece without readings in some columns (n_y,), or at some samples (n, n_y): a fit begins by them only."""
    if not np.any(unread):
        return piece
    return replace(piece, measured=np.where(unread, np.nan, piece.measured), interpolated=piece.whole)


def _loading(vehicle: Vehicle, window: Window) -> dict[str, float]:
    """Return the numbers that the window's loading changes."""
    if window.loading is None:
        return {}
    loadings = vehicle.file.loadings
    if window.loading not in loadings:
        raise VehicleError(
            f"{vehicle.where}: no loading is called '{window.loading}'; loadings are {', '.join(loadings) or 'none'}"
        )
    changes = dict(loadings[window.loading])
    for name in changes:
        if vehicle.parameters[vehicle.rows[name]].free:  # its estimate would stand in for the loading's value
            raise VehicleError(
                f"{vehicle.where}: loadings.{window.loading}.{name}: the number is free, so one estimate holds for all "
                f"maneuvers; remove it from the loading or use --fix {name}"
            )
    return changes


def _constant(columns: Sequence[FloatArray]) -> bool:
    """Tell whether readings (n_i,) of all pieces are the same number."""
    low, high = min(c.min() for c in columns), max(c.max() for c in columns)
    return bool(high - low <= 1e-12 * max(1.0, abs(low), abs(high)))


def _all_spikes(columns: Sequence[FloatArray], sigma: float) -> bool:
    """Tell whether readings (n_i,) of each piece are spikes on a constant, or random from sample to sample and far too wide.

    Signals of flight resemble their neighbors in time. What does not may be the noise of a sensor at rest; here it is
    `SPIKE_RATIO` times as large as the vehicle file says.
    """
    if _constant([median_filter(c, SPIKE_SAMPLES, mode="mirror") for c in columns]):
        return True
    whole = np.concatenate(columns)
    # so wide is a normal distribution
    if float(np.ptp(np.quantile(whole, (0.1, 0.9)))) <= 2.56 * SPIKE_RATIO * sigma:
        return False
    before, after = (np.concatenate([c[rows] for c in columns]) for rows in (np.s_[:-1], np.s_[1:]))
    if len(before) < MIN_RANKS:
        return False
    return float(np.corrcoef(rankdata(before), rankdata(after))[0, 1]) < NEIGHBOR_CORRELATION


def at_readings(vehicle: Vehicle, prepared: Prepared, flights: Mapping[str, Flight]) -> tuple[Piece, ...]:
    """Return the pieces with readings only where they were taken: what was interpolated between has no error of its own."""
    pieces, whole = [], dict[str, BoolArray]()
    for name in {w.flight for w in prepared.windows}:  # once, however many windows it has
        sources, count = flights[name].sources, len(flights[name].time)
        every = np.ones(count, np.bool_)
        own = [sources[c].counted(count) if c in sources else every for c in vehicle.outputs]
        whole[name] = np.column_stack(own)
    for piece in prepared.pieces:
        name = prepared.windows[piece.maneuver].flight
        first = int(np.searchsorted(flights[name].time, piece.time[0]))
        pieces.append(_without(piece, ~whole[name][first : first + len(piece.time)]))
    return tuple(pieces)


def errors_of_start(priors: Mapping[str, float], name: str, start: Mapping[str, float]) -> Iterator[float]:
    """Yield by how much the priors of free errors of its instrument let an initial state, as it was read, be wrong."""
    yield priors.get(f"sensors.{name}.bias", 0.0)
    yield priors.get(f"sensors.{name}.scale", 0.0) * start.get(name, 0.0)
    share = {"V": 1.0, "alpha": 1.0 / start["V"], "beta": 1.0 / start["V"]} if start.get("V") else {}
    for axis in "xyz" if name in share else "":
        yield priors.get(f"sensors.wind_error.{axis}", 0.0) * share[name]

"""A flight: registry variables on one uniform grid, on the log's own clock, and segments cut out of it."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.base.arrays import FloatArray, run_slices
from stoop.base.html import table
from stoop.base.notices import Notice, notice
from stoop.base.rotations import continuous, euler_angles, normalized, quaternions_of, wrap
from stoop.base.text import printable, unknown_name
from stoop.base.variables import EULER, QUATERNION, VARIABLES, WRAPPED, variable
from stoop.errors import FlightError
from stoop.flight import airborne as airborne_rules
from stoop.flight import faults as sensor_faults
from stoop.flight import maneuvers as command_rules
from stoop.flight.faults import Fault
from stoop.flight.gridding import (
    MAX_GAP,
    TIME_TOLERANCE,
    Grid,
    SourceRate,
    complete,
    drop_impossible,
    resample,
    source_rate,
)

if TYPE_CHECKING:
    import xarray as xr

#: of logs; what stands before them is the name of the flight
ENDINGS: Final = (
    ".gz", ".csv", ".ulg", ".ulog", ".nc", ".cdf", ".bin", ".log", ".usd", ".bbl", ".bfl", ".mat", ".parquet", ".pq",
    ".bag", ".mcap", ".db3",
)  # fmt: skip
#: of a window, that may lie beyond the record: rounded times; more is another clock or a wrong log
MAX_TRIM: Final = 0.05
MIN_SEGMENT: Final = 0.5  #: s; shorter pieces say nothing about the aircraft and are dropped
NAN: Final = float("nan")
POOR_WIND: Final = 1.5  #: m/s, standard error of a wind that is hardly known


@dataclass(frozen=True)
class AirData:
    """What the air data reconstruction found; NaN where the flight holds no such thing."""

    #: "pitot", "pitot and sideslip", "pitot and log", "sideslip", "log" (where the wind is from), "still air" (it is
    #: unknown and taken as zero) or "none" (nothing was reconstructed)
    method: str
    wind_n: float = NAN  #: m/s, towards which the air moves; steady over the flight
    wind_e: float = NAN
    wind_n_std: float = NAN  #: m/s, standard errors, the color of the residuals counted
    wind_e_std: float = NAN
    pitot_scale: float = NAN  #: true airspeed = (airspeed_pitot - pitot_offset) * pitot_scale; 1, m/s
    pitot_scale_std: float = NAN  #: standard errors
    pitot_offset: float = NAN
    pitot_offset_std: float = NAN
    rest_offset: float = NAN  #: m/s, median reading of the pitot on the ground
    residual_rms: float = NAN  #: m/s, of the residual that the wind was fitted to
    #: (north, east, standard errors of both) m/s, from sideslip and lateral force alone
    sideslip_wind: tuple[float, float, float, float] = (NAN, NAN, NAN, NAN)
    gust: float = NAN  #: m/s, estimate of what a steady wind leaves out, per axis
    #: rad, standard error of alpha and beta from gusts and the error of the wind together
    incidence_std: float = NAN
    velocity_delay: float = NAN  #: s, by which the logged velocity is late (corrected when evident)
    velocity_delay_std: float = NAN
    heading_error: float = NAN  #: rad, true minus logged heading, mean of the flight (not corrected)
    heading_error_std: float = NAN
    accelerometer_bias: tuple[float, float, float] = (NAN, NAN, NAN)  #: (3,) m/s2, body axes
    accelerometer_bias_std: tuple[float, float, float] = (NAN, NAN, NAN)
    notices: tuple[Notice, ...] = ()  #: for the user
    #: name -> (n,), airborne samples to plot: time, speed_inertial (|v - w|), pitot, pitot_corrected, wind_n_log,
    #: wind_e_log, beta, beta_from_force
    traces: Mapping[str, FloatArray] = field(default_factory=dict, compare=False, repr=False)

    @property
    def wind_known(self) -> bool:
        """Whether the standard errors of the wind are less than `POOR_WIND`."""
        return max(self.wind_n_std, self.wind_e_std) < POOR_WIND


@dataclass(frozen=True, eq=False)
class Gridded:
    """Registry variables over one uniform time axis."""

    time: FloatArray  #: (n,) s
    columns: Mapping[str, FloatArray]  #: variable -> (n,) SI, NaN where there is no data
    attributes: Mapping[str, str] = field(default_factory=dict)


class _AsDataset:
    """Keeps the variables of a flight as arrays until the data set is asked for: to import xarray takes half a second."""

    def __get__(self, flight: Flight | None, owner: type[Flight] | None = None) -> xr.Dataset:
        if flight is None:
            raise AttributeError  # there is no default
        kept: xr.Dataset | Gridded = vars(flight)["data"]
        if isinstance(kept, Gridded):
            made = dataset(kept.time, kept.columns).assign_attrs(kept.attributes)
            kept = vars(flight)["data"] = made
        return kept

    def __set__(self, flight: Flight, given: xr.Dataset | Gridded) -> None:
        vars(flight)["data"] = given


@dataclass(frozen=True, repr=False)
class Flight:
    """One flight, ready to be cut into maneuvers."""

    name: str  #: stem of the path, as in FLIGHT@START:STOP
    path: Path | None  #: where it was read from, if anywhere
    #: registry variables (SI, body axes forward-right-down) over "time" [s, log's own clock], uniform, NaN where there
    #: is no data
    data: _AsDataset = _AsDataset()
    #: Hz, of the grid
    rate: float  # type: ignore[misc] # mypy takes the line above for a default
    #: variable -> how it was recorded
    sources: Mapping[str, SourceRate]  # type: ignore[misc]
    notices: tuple[Notice, ...] = ()  #: what was found: gaps, faults, defects, what was reconstructed
    air: AirData | None = None  #: result of the air data reconstruction, where there was one
    faults: tuple[Fault, ...] = ()  #: suspected faults of sensors; each has a notice too
    #: stream -> columns of the log that no mapping names; not kept in files of our own
    unmapped: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)  #: of the autopilot; kept in logs only

    @property
    def time(self) -> FloatArray:
        """Grid, shape (n,) [s, log's own clock]."""
        kept = vars(self)["data"]
        return kept.time if isinstance(kept, Gridded) else kept["time"].to_numpy()

    @property
    def channels(self) -> tuple[str, ...]:
        """Variables of the flight, in order."""
        kept = vars(self)["data"]
        return tuple(kept.columns) if isinstance(kept, Gridded) else tuple(map(str, kept.data_vars))

    @property
    def names(self) -> frozenset[str]:
        """Variables of the flight."""
        return frozenset(self.channels)

    def __getitem__(self, name: str) -> xr.DataArray:
        """Return a variable over ``time``, labeled."""
        if name not in self.names and name != "time":
            raise unknown_name(name, self.channels)
        found: xr.DataArray = self.data[name]
        return found

    def __contains__(self, name: object) -> bool:
        """Tell whether the flight has a variable."""
        return name in self.names

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the variables."""
        return iter(self.channels)

    def plot(self) -> Any:
        """Return the page of the flight, as :func:`stoop.look` does."""
        # By name: pages are drawn rooms above this one, and nothing here depends on them.
        return importlib.import_module("stoop.api").look(self)

    def column(self, name: str) -> FloatArray:
        """Return a variable, shape (n,), SI, NaN where there is no data."""
        kept = vars(self)["data"]
        return kept.columns[name] if isinstance(kept, Gridded) else kept[name].to_numpy()

    def texts(self, name: str) -> dict[str, str]:
        """Return what is said of a variable, or of the time: units, long_name, frame, positive."""
        kept = vars(self)["data"]
        return _texts(name) if isinstance(kept, Gridded) else dict(kept[name].attrs)

    @property
    def attributes(self) -> dict[str, Any]:
        """What stands with the variables, such as the truth of a simulated flight."""
        kept = vars(self)["data"]
        return dict(kept.attributes if isinstance(kept, Gridded) else kept.attrs)

    def with_notices(self, found: Iterable[Notice]) -> Flight:
        """Return the flight with more notices."""
        return replace(self, data=vars(self)["data"], notices=(*self.notices, *found))

    def between(self, start: float, stop: float) -> slice:
        """Return which samples lie between two times [s], both included."""
        time = self.time
        return slice(int(np.searchsorted(time, start)), int(np.searchsorted(time, stop, "right")))

    def resampled(self, time: FloatArray, values: FloatArray) -> FloatArray:
        """Return a series (m,) of the same clock on the grid (n,) of the flight, smoothed as channels are."""
        grid = Grid(0, self.time.size, self.rate, float(self.time[0]))
        return resample(grid, time, values[:, None], smooth=True)[:, 0]

    without_faults = sensor_faults.without_faults
    flying = airborne_rules.flying
    in_flight = airborne_rules.in_flight
    airborne = airborne_rules.airborne
    carried_by_rotors = airborne_rules.carried_by_rotors
    lift_command = airborne_rules.lift_command
    rotor_pulses = airborne_rules.rotor_pulses
    require_motors_ran = airborne_rules.require_motors_ran
    commands = command_rules.commands
    output_families = command_rules.output_families
    directions = command_rules.directions
    band_pass = command_rules.band_pass
    feedback = command_rules.feedback
    find_maneuvers = command_rules.find_maneuvers

    def __repr__(self) -> str:
        """Return name, length and number of channels on one line."""
        length = float(self.time[-1] - self.time[0]) if self.time.size else 0.0
        size = f"{length:.1f} s at {self.rate:g} Hz, {len(self.channels)} channels"
        return printable(f"<Flight {self.name}: {size}>")

    def _repr_html_(self) -> str:
        texts = {name: self.texts(name) for name in self.channels}
        rows = [(name, *(known.get(k, "") for k in ("units", "long_name"))) for name, known in texts.items()]
        return table(repr(self).strip("<>"), ("channel", "unit", "meaning"), rows)


def from_columns(
    name: str,
    time: FloatArray,
    columns: Mapping[str, FloatArray],
    notices: tuple[Notice, ...] = (),
    source: str = "simulation",
    attributes: Mapping[str, str] | None = None,
) -> Flight:
    """Make a flight of channels that already lie on one uniform grid; nothing is filtered.

    Parameters
    ----------
    name : as in FLIGHT@START:STOP
    time : (n,) s, uniform
    columns : registry variable -> (n,) SI, NaN where there is no data; from Euler angles the quaternion
        is added, and the other way around; phi and psi of any number of turns are brought into (-pi, pi], and
        values that are impossibly large are taken as missing
    notices : for the user
    source : where the channels come from
    attributes : texts that stand with the channels

    Raises
    ------
    FlightError
        When a variable is unknown, a column is too short, or the time is not uniform.
    """
    time = np.ascontiguousarray(time, dtype=np.float64)
    steps = np.diff(time)
    if time.ndim != 1 or time.size < 2 or not np.all(steps > 0.0):
        raise FlightError(f"{name}: the time does not increase; give two and more rising samples")
    period = float((time[-1] - time[0]) / steps.size)
    if np.max(np.abs(steps - period)) > 1e-3 * period:
        raise FlightError(f"{name}: the time is not uniform; save the channels as CSV and load that instead")
    rate = 1.0 / period
    if abs(rate - round(rate)) < 1e-6 * rate:  # whole but for the rounding of the time stamps
        rate = float(round(rate))
    data = {key: np.asarray(values, dtype=np.float64) for key, values in columns.items()}
    for key, values in data.items():
        variable(key, name)
        if values.shape != time.shape:
            raise FlightError(
                f"{name}: '{key}' has {values.size} samples, the time {time.size}; give as many"
            )
    data, found = drop_impossible(source, data)
    data = with_attitude(on_circle(data))
    ordered = {key: data[key] for key in VARIABLES if key in data}
    sources = {key: source_rate(source, time[np.isfinite(values)]) for key, values in ordered.items()}
    return Flight(name, None, Gridded(time, ordered, attributes or {}), rate, sources, (*notices, *found))


def on_circle(data: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Bring phi and psi into (-pi, pi]: differences between them are taken within one turn."""
    return {key: wrap(values) if key in WRAPPED else values for key, values in data.items()}


def with_attitude(data: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Add the quaternion to Euler angles, or Euler angles to the quaternion, where the other is missing."""
    given = next((names for names in (QUATERNION, EULER) if set(names) <= data.keys()), None)
    if given is None or {*QUATERNION, *EULER} <= data.keys():
        return data
    parts = np.column_stack([data[key] for key in given])
    if given == QUATERNION:
        return {**data, **dict(zip(EULER, euler_angles(normalized(parts)).T, strict=True))}
    return {**data, **dict(zip(QUATERNION, continuous(quaternions_of(parts)).T, strict=True))}


def with_other_form(taken: Set[str]) -> frozenset[str]:
    """Count the other form of an attitude, or of the pitot's airspeed, as taken too: both would contradict each other."""
    pairs = (({*EULER}, {*QUATERNION}), ({"airspeed_pitot"}, {"airspeed_equivalent"}))
    others = [other for forms in pairs for form, other in (forms, forms[::-1]) if taken & form]
    return frozenset(taken).union(*others)


def dataset(time: FloatArray, data: Mapping[str, FloatArray]) -> xr.Dataset:
    """Make a data set of gridded variables, with units and meanings from the registry."""
    import xarray as xr  # heavy, and only here

    columns = {name: ("time", x, _texts(name)) for name, x in data.items()}
    return xr.Dataset(columns, coords={"time": ("time", time, _texts("time"))})


def _texts(name: str) -> dict[str, str]:
    if name == "time":
        return {"units": "s", "long_name": "time on the log's own clock"}
    one = VARIABLES[name]
    texts = {"units": one.unit, "long_name": one.meaning, "frame": one.frame, "positive": one.sign}
    return {key: value for key, value in texts.items() if value}


def flight_name(path: Path) -> str:
    """Return the name by which a maneuver refers to a flight: the path's last part without endings, unless it is one.

    It is text, which any file can hold: bytes of a path that are none become question marks.
    """
    name = stem = path.resolve().name.encode("utf-8", "replace").decode()
    for ending in ENDINGS:
        stem = stem.removesuffix(ending)
    return stem or name


@dataclass(frozen=True)
class Segment:
    """A contiguous piece of a maneuver; it has its own initial state."""

    t: FloatArray  #: (n,) s, uniform, on the log's own clock
    u: FloatArray  #: (n, m) inputs, complete
    z: FloatArray  #: (n, ny) outputs, NaN where missing
    extras: Mapping[str, FloatArray]  #: name -> (n,), NaN where missing


def _check_span(where: str, t: FloatArray, start: float, stop: float) -> list[Notice]:
    """Return the notice of a window that is trimmed to a record (n,); raises `FlightError` where too much of it lies beyond."""
    first, last, period = float(t[0]), float(t[-1]), float(t[1] - t[0]) if len(t) > 1 else 0.0
    if not start < stop:
        raise FlightError(f"{where}: the window ends before it begins; write START:STOP in seconds")
    if stop <= first or start >= last:
        raise FlightError(
            f"{where}: outside the record, which runs from {first:.2f} to {last:.2f} s "
            "on the log's own clock; choose a window inside"
        )
    notices, beyond = [], max(first - start, 0.0) + max(stop - last, 0.0)
    if beyond > max(period, MAX_TRIM * (stop - start)):
        raise FlightError(
            f"{where}: {beyond:.2f} s of it lie beyond the record, which runs from {first:.2f} to {last:.2f} s on the log's "
            f"own clock; write {max(start, first):.10g}:{min(stop, last):.10g} for what there is, or choose a window inside"
        )
    if start < first - period or stop > last + period:
        notices.append(notice("window-trimmed", where, start=max(start, first), stop=min(stop, last)))
    return notices


def segments(
    flight: Flight,
    start: float,
    stop: float,
    inputs: Sequence[str],
    outputs: Sequence[str],
    extras: Sequence[str] = (),
) -> tuple[list[Segment], list[Notice]]:
    """Cut a window out of a flight and split it where an input has a hole.

    Parameters
    ----------
    flight : the flight
    start, stop : s, on the log's own clock, both included
    inputs : variables that must be complete
    outputs : variables to compare with; may be missing in places, or altogether (then NaN)
    extras : further variables to carry along, as the outputs

    Returns
    -------
    segments : at least one
    notices : what was cut away

    Raises
    ------
    FlightError
        When an input is not in the flight, the window lies outside the record or more than `MAX_TRIM` of it beyond its
        ends, or nothing is left of it.
    """
    for name in inputs:
        if name not in flight.names:
            variable(name, flight.name)
            there = ", ".join(flight.channels)
            raise FlightError(f"{flight.name}: input '{name}' is not in this flight; it has {there}")
    where, t = f"{flight.name} {start:g}:{stop:g}", flight.time
    notices = _check_span(where, t, start, stop)
    low, high = np.searchsorted(t, [start - TIME_TOLERANCE, stop + TIME_TOLERANCE])
    t = t[low:high]
    inside = {}
    for name in (*inputs, *outputs, *extras):
        variable(name, flight.name)
        inside[name] = flight.column(name)[low:high] if name in flight.names else np.full(t.size, np.nan)
    nothing = np.empty((t.size, 0))
    u, z = (np.column_stack([nothing, *(inside[name] for name in own)]) for own in (inputs, outputs))
    whole = complete(u)
    runs = run_slices(whole)
    pieces = [run for run in runs if run.stop - run.start >= MIN_SEGMENT * flight.rate]
    if not pieces:
        short = bool(t.size) and t[-1] - t[0] < MIN_SEGMENT - 0.5 / flight.rate
        hole = f"no {MIN_SEGMENT:g} s without a hole in {', '.join(inputs)}; choose another window"
        brief = "s are too short; choose another window, one that holds"
        what = f"{t[-1] - t[0]:.2g} {brief} {MIN_SEGMENT:g} s without a hole" if short else hole
        raise FlightError(f"{where}: {what}")
    made = [Segment(t[p], u[p], z[p], {name: inside[name][p] for name in extras}) for p in pieces]
    # a single sample at the edge is the rounding of the window, no hole
    gaps = run_slices(~whole)
    holes = [run for run in gaps if run.stop - run.start > 1 or not {run.start, run.stop} & {0, t.size}]
    spans = [(float(t[run.start]), float(t[run.stop - 1])) for run in holes]
    if len(holes) > 4:  # one notice for all
        lost = sum(run.stop - run.start for run in holes) / flight.rate
        values = {"count": len(holes), "duration": lost, "start": spans[0][0], "stop": spans[-1][1]}
        notices.append(notice("inputs-missing-often", flight.name, **values))
    else:
        notices += [notice("inputs-missing", flight.name, start=a, stop=b) for a, b in spans]
    if len(runs) > len(pieces):
        count = len(runs) - len(pieces)
        notices.append(notice("short-pieces-dropped", flight.name, count=count, duration=MIN_SEGMENT))
    for name in inputs:
        source = flight.sources.get(name)
        if source is not None and 0.0 < source.rate < 1.0 / MAX_GAP:
            notices.append(notice("slow-input", flight.name, variable=name, rate=source.rate))
    return made, notices

"""Log -> Flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import EULER, QUATERNION, RATES, VARIABLES
from stoop.checks.kinematics import MOTION, check_motion, check_rates
from stoop.checks.lines import Lines, read_lines
from stoop.checks.units import check_units
from stoop.errors import FlightError
from stoop.flight.air_data_reconstruction import with_air
from stoop.flight.airborne import carried_by_rotors
from stoop.flight.airspeed import faults_of_true_airspeed, with_true_airspeed
from stoop.flight.alignment import attitude_delay
from stoop.flight.apply_mapping import Mapped, read_mapped
from stoop.flight.attitude_interpolation import interpolate_by_rates
from stoop.flight.channels import SourceRate, drop_outliers
from stoop.flight.faults import Fault, contradiction, recorded_faults, rest_faults, without_faulty
from stoop.flight.flight import Flight, dataset, flight_name, with_attitude
from stoop.flight.gridding import grid_channels
from stoop.flight.store import restore
from stoop.logs import Recording

DEFAULT_RATE: Final = 100.0  #: Hz
SUSPECT_CLOCK: Final = 5.0  #: Hz; body rates are hardly ever logged more slowly
SLOW_RATES: Final = 25.0  #: Hz; body rates below this do not show the fast modes


def load(path: str | Path, mapping: str | Path | None = None, rate: float = DEFAULT_RATE) -> Flight:
    """Read a log and lay its channels on one uniform grid.

    Channels faster than the grid are low-passed first (zero phase, per contiguous stretch). Nothing is
    interpolated across gaps. Without a vane, V, alpha and beta are reconstructed from the velocity over
    ground, the attitude and an estimated steady wind.

    Parameters
    ----------
    path : see `stoop.logs.read`
    mapping : TOML file, see `stoop.flight.mapping`; None looks beside the log, else takes the ready one
    rate : Hz, of the grid; a flight written by stoop keeps the rate it was written with

    Raises
    ------
    LogError
        When the log cannot be read.
    FlightError
        When it holds no known variable, or degrees where radians belong.
    """
    path = Path(path)
    recording, mapped = read_mapped(path, Path(mapping) if mapping is not None else None)
    if mapped is None:
        return restore(recording, flight_name(path))
    notices: list[Notice] = []
    channels = []
    for group in mapped.channels:
        cleaned, found = drop_outliers(group)
        channels.append(cleaned)
        notices += found
    flight = with_air(_gridded(path, recording, replace(mapped, channels=channels), rate))
    return replace(flight, notices=(*notices, *flight.notices, *_limits_of_record(flight)))


def _gridded(path: Path, recording: Recording, mapped: Mapped, rate: float) -> Flight:
    channels, lines = mapped.channels, read_lines(mapped.places)
    signals = {name: (group.time, x) for group in channels for name, x in group.values.items()}
    refused, units, _ = check_units(signals, lines)
    if refused:
        raise FlightError(f"{path}: {str(refused[0]).removesuffix('.')}")
    grid, data, sources = grid_channels(channels, rate, str(path))
    data, sources = _complete_attitude(data, sources)
    data, sources, airspeed = with_true_airspeed(data, sources)
    recorded = faults_of_true_airspeed(recorded_faults(channels), data)
    dirty = {fault.variable for fault in recorded} | _slow(sources, SUSPECT_CLOCK).keys()
    found = _contradictions(data, rate, lines, units, sound=not MOTION & dirty)
    span = float(grid.time[0]), float(grid.time[-1])
    faults = (
        *recorded,
        *rest_faults(grid.time, data, rate),
        *(contradiction(one, *span) for one in found),
    )
    if any(fault.kind == "inconsistent" for fault in faults):
        attitude = attitude_delay(channels)
    else:
        data, attitude = interpolate_by_rates(grid, data, sources, channels)
    notices = (
        *_defects(recording, sources),
        *mapped.notices,
        *attitude,
        *airspeed,
        *_gaps(sources),
        *(fault.notice for fault in faults),
    )
    return Flight(
        flight_name(path),
        path,
        dataset(grid.time, data),
        rate,
        sources,
        notices,
        None,
        faults,
        mapped.unmapped,
    )


def _contradictions(
    data: Mapping[str, FloatArray], rate: float, lines: Lines, units: Sequence[Notice], *, sound: bool
) -> list[Notice]:
    """Return the lines of the mapping that the data contradict, then what else disagrees with these corrected.

    Where units or clocks are wrong, or channels stuck or clipped, kinematics would accuse the innocent.
    """
    upward = any(one.code == "force-points-up" for one in units)
    upright = {**data, "az": -data["az"]} if upward else data
    wrong, corrected = check_motion(upright, rate, lines if sound and len(units) == upward else {})
    return [*units, *wrong, *check_rates(corrected, rate, lines)]


def _complete_attitude(
    data: dict[str, FloatArray], sources: dict[str, SourceRate]
) -> tuple[dict[str, FloatArray], dict[str, SourceRate]]:
    """Complete an attitude whose parts came from several files; its rate is that of the slowest."""
    whole = with_attitude(data)
    parts = [sources[name] for name in (*EULER, *QUATERNION) if name in sources]
    slowest = {name: min(parts, key=lambda part: part.rate) for name in whole.keys() - data.keys()}
    return {name: whole[name] for name in VARIABLES if name in whole}, {**sources, **slowest}


def _defects(recording: Recording, sources: Mapping[str, SourceRate]) -> list[Notice]:
    """Name the defects of the log; those of topics that supply nothing do not matter to the user."""
    used = {name for s in sources.values() for name in (s.source, s.source.replace("/", "_"))}  # topic, file
    return [
        notice("log-defect", defect.place, kind=defect.kind, text=defect.message)
        for defect in recording.defects
        if defect.kind in ("corrupt", "truncated", "dropout") or any(topic in defect.place for topic in used)
    ]


def _gaps(sources: Mapping[str, SourceRate]) -> list[Notice]:
    """Name the sources that have gaps."""
    gaps = {source.source: source for source in sources.values() if source.gaps}
    if not gaps:
        return []
    longest = max(source.longest_gap for source in gaps.values())
    counts = tuple(f"{name} {source.gaps}" for name, source in gaps.items())
    return [notice("gaps", longest=longest, counts=counts)]


def _limits_of_record(flight: Flight) -> list[Notice]:
    """Name what this record cannot show, whatever is fitted to it."""
    found = []
    slow = _slow(flight.sources, SLOW_RATES)
    if slow:
        rate = min(slow.values())
        code = "slow-rates-suspect-clock" if rate < SUSPECT_CLOCK else "slow-rates"
        found.append(notice(code, variables=tuple(slow), rate=rate))
    explained = flight.air is not None and bool(flight.air.notices)  # the reconstruction knows better why
    if not {"V", "alpha", "beta"} & flight.names and not carried_by_rotors(flight) and not explained:
        found.append(notice("no-air-data"))
    return found


def _slow(sources: Mapping[str, SourceRate], limit: float) -> dict[str, float]:
    """Return the body rates that were logged more slowly than a limit, and how fast; Hz."""
    there = {name: sources[name].rate for name in RATES if name in sources}
    return {name: rate for name, rate in there.items() if 0.0 < rate < limit}


def without_faults(flight: Flight) -> Flight:
    """Return the flight with the samples of clipped and stuck sensors taken as not measured."""
    by_name: dict[str, list[Fault]] = {}
    for fault in flight.faults:
        if fault.kind in ("clipped", "stuck"):
            by_name.setdefault(fault.variable, []).append(fault)
    if not by_name:
        return flight
    columns = {
        name: without_faulty(flight.time, flight.column(name), found) for name, found in by_name.items()
    }
    data = flight.data.assign({name: ("time", x, flight.data[name].attrs) for name, x in columns.items()})
    found = notice("samples-not-measured", variables=tuple(columns))
    return replace(flight, data=data, notices=(*flight.notices, found))

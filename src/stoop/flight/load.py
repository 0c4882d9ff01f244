"""Log -> Flight."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop import logs
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice
from stoop.base.variables import EULER, QUATERNION, VARIABLES
from stoop.checks.kinematics import MOTION, check_motion, check_rates
from stoop.checks.lines import Lines, read_lines
from stoop.checks.units import check_units
from stoop.errors import FlightError, one_line
from stoop.flight.aloft import hovered, lifting
from stoop.flight.between import following_rates
from stoop.flight.build import build
from stoop.flight.channels import SourceRate, tame
from stoop.flight.chosen import channels_of, mapping_of, topics_of
from stoop.flight.clocks import lateness
from stoop.flight.equivalent import of_the_true_one, with_true_airspeed
from stoop.flight.faults import Fault, as_fault, recorded_faults, rest_faults, without_faulty
from stoop.flight.flight import Flight
from stoop.flight.grid import Grid
from stoop.flight.make import dataset, named, with_attitude
from stoop.flight.mapped import Mapped
from stoop.flight.store import restore
from stoop.logs import Recording

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from stoop.flight.reconstruction import AirData

DEFAULT_RATE: Final = 100.0  #: Hz
WRONG_CLOCK: Final = 5.0  #: Hz; body rates are hardly ever logged more slowly
SLOW_RATES: Final = 25.0  #: Hz; body rates below this do not show the fast modes
RECONSTRUCTED: Final = "reconstructed"  #: source of what no sensor measured
_INERTIAL: Final = frozenset({"vn", "ve", "vd", *QUATERNION})


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
    place = mapping_of(path, Path(mapping) if mapping is not None else None)
    recording = logs.read(path, place if mapping is not None else None, topics_of(path, place))
    if recording.format == "stoop-netcdf":
        return restore(recording, named(path))
    named_channels = channels_of(recording, place)
    tamed = [tame(group) for group in named_channels.channels]
    channels = [group for group, _ in tamed]
    flight = with_air(_gridded(path, recording, replace(named_channels, channels=channels), rate))
    notes = (*(note for _, told in tamed for note in told), *flight.notes, *_warnings(flight))
    return replace(flight, notes=tuple(map(one_line, notes)))


def _gridded(path: Path, recording: Recording, found: Mapped, rate: float) -> Flight:
    channels, lines = found.channels, read_lines(found.places)
    signals = {name: (group.time, x) for group in channels for name, x in group.values.items()}
    refused, units, _ = check_units(signals, lines)
    if refused:
        raise FlightError(f"{path}: {str(refused[0]).removesuffix('.')}")
    grid, whole, known = _with_attitude(*build(channels, rate, str(path)))
    data, sources, air = with_true_airspeed(whole, known)
    recorded = of_the_true_one(recorded_faults(channels), data)
    faults = (
        *recorded,
        *rest_faults(grid.time, data, rate),
        *_contradictions(grid.time, data, rate, lines, units, recorded, sources),
    )
    doubted = any(fault.kind == "inconsistent" for fault in faults)
    late = lateness(channels) if doubted else ""
    data, followed = (data, "") if doubted else following_rates(grid, data, sources, channels)
    notes = [
        *_defect_notes(recording, sources),
        *found.notes,
        *(told for told in (late, followed, air) if told),
        *_gap_notes(sources),
        *(fault.message for fault in faults),
    ]
    return Flight(
        named(path),
        path,
        dataset(grid.time, data),
        rate,
        sources,
        tuple(notes),
        None,
        faults,
        found.unmapped,
    )


def _contradictions(
    time: FloatArray,
    data: Mapping[str, FloatArray],
    rate: float,
    lines: Lines,
    units: Sequence[Notice],
    recorded: Sequence[Fault],
    sources: Mapping[str, SourceRate],
) -> list[Fault]:
    """Report lines of the mapping that the data contradict, then what else disagrees with these corrected.

    Where units or clocks are wrong, or channels stuck or clipped, kinematics would accuse the innocent.
    """
    up = any(one.code == "force-points-up" for one in units)
    sound = (
        len(units) == up and not MOTION & {f.variable for f in recorded} and not _slow(sources, WRONG_CLOCK)
    )
    upright = {**data, "az": -data["az"]} if up else data
    wrong, corrected = check_motion(upright, rate, lines if sound else {})
    found = [*units, *wrong, *check_rates(corrected, rate, lines)]
    return [as_fault(one, float(time[0]), float(time[-1])) for one in found]


def _with_attitude(
    grid: Grid, data: dict[str, FloatArray], sources: dict[str, SourceRate]
) -> tuple[Grid, dict[str, FloatArray], dict[str, SourceRate]]:
    """Complete an attitude whose parts came from several files; its rate is that of the slowest."""
    whole = with_attitude(data)
    added = whole.keys() - data.keys()
    parts = [sources[name] for name in (*EULER, *QUATERNION) if name in sources]
    slowest = {name: min(parts, key=lambda source: source.rate) for name in added}
    return grid, {name: whole[name] for name in VARIABLES if name in whole}, {**sources, **slowest}


def _defect_notes(recording: Recording, sources: Mapping[str, SourceRate]) -> list[str]:
    """Defects of topics that supply nothing do not matter to the user."""
    used = {name for s in sources.values() for name in (s.source, s.source.replace("/", "_"))}  # topic, file
    return [
        str(defect)
        for defect in recording.defects
        if defect.kind in ("corrupt", "truncated", "dropout") or any(topic in defect.place for topic in used)
    ]


def _gap_notes(sources: Mapping[str, SourceRate]) -> list[str]:
    """Say in one line which sources have gaps."""
    gaps = {source.source: source for source in sources.values() if source.gaps}
    if not gaps:
        return []
    longest = max(source.longest_gap for source in gaps.values())
    counted = ", ".join(f"{name} {source.gaps}" for name, source in gaps.items())
    return [f"gaps of up to {longest:.2f} s, nothing is interpolated across them: {counted}"]


def with_air(flight: Flight) -> Flight:
    """Reconstruct what air data were not measured, where there is no vane but ground velocity and attitude.

    What hovers and has no pitot has none, and needs none.
    """
    there = {str(name) for name in flight.data.data_vars}
    if there & {"alpha", "beta"} or not there >= _INERTIAL or _empty(flight, _INERTIAL):
        return flight
    columns, air = _reconstructed(flight)
    if _carried_by_rotors(flight, air):
        return flight
    velocity = flight.sources["vn"]
    new = columns.keys() - (there if _measured_speed(flight) is not None else there - {"V"})
    sources = {name: replace(velocity, source=RECONSTRUCTED) for name in new}
    told = {
        fault.message for fault in flight.faults if fault.variable == "airspeed_pitot"
    }  # air tells more of it
    return replace(
        flight,
        data=dataset(flight.time, columns),
        air=air,
        sources={**flight.sources, **sources},
        notes=(*(note for note in flight.notes if note not in told), *air.notes),
    )


def _carried_by_rotors(flight: Flight, air: AirData) -> bool:
    """Tell whether no air data belong here: no wing weathercocks, and no pitot tells the wind."""
    return (air.method == "none" and lifting(flight)) or (air.method == "sideslip" and hovered(flight))


def _reconstructed(
    flight: Flight, exclude: Sequence[tuple[float, float]] = ()
) -> tuple[dict[str, FloatArray], AirData]:
    """Return all columns with reconstructed air data; a measured V stays, and is a pitot where there is none."""
    from stoop.flight.reconstruction import reconstruct  # heavy, and only here

    measured = _measured_speed(flight)
    lent = measured is not None and "airspeed_pitot" not in flight.data
    given = flight.data.assign(airspeed_pitot=("time", measured)) if lent else flight.data
    data, air = reconstruct(given, flight.sources["vn"].rate, exclude)
    columns = {name: data[name].to_numpy() for name in VARIABLES if name in data}
    if lent:
        del columns["airspeed_pitot"]
    if measured is None or air.method == "none":
        return columns, air
    role = "; it also served as the pitot that tells the wind" if lent else ""
    note = f"V is as measured, only alpha and beta are reconstructed{role}"
    return {**columns, "V": measured}, replace(air, notes=(*air.notes, note))


def _measured_speed(flight: Flight) -> FloatArray | None:
    source = flight.sources.get("V")
    if source is None or source.source == RECONSTRUCTED or _empty(flight, ["V"]):
        return None
    return flight.column("V")


def without(flight: Flight, windows: Sequence[tuple[float, float]]) -> Flight:
    """Reconstruct the air data anew, learning nothing about wind and pitot inside some windows [s].

    A flight whose air data were measured, or could not be reconstructed, is returned as it is.
    """
    if not windows or flight.air is None or flight.air.method == "none":
        return flight
    columns, air = _reconstructed(flight, windows)
    if air.method == "none":
        note = (
            f"{flight.name}: too little flight remains outside the predicted windows: the wind, and so the measured V, "
            "alpha and beta, were estimated with those windows in"
        )
        return replace(flight, notes=(*flight.notes, note))
    kept = tuple(note for note in flight.notes if note not in flight.air.notes)
    return replace(flight, data=dataset(flight.time, columns), air=air, notes=(*kept, *air.notes))


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
    note = f"{', '.join(columns)}: samples at a limit or standing still count as not measured"
    data = flight.data.assign({name: ("time", x, flight.data[name].attrs) for name, x in columns.items()})
    return replace(flight, data=data, notes=(*flight.notes, note))


def _warnings(flight: Flight) -> list[str]:
    """Say what this record cannot tell, whatever is fitted to it."""
    notes = []
    slow = _slow(flight.sources, SLOW_RATES)
    if slow:
        notes.append(
            f"{', '.join(slow)} were logged at only {min(slow.values()):.3g} Hz: "
            "too slow for the roll mode and the short period of most aircraft"
            + ("; is the unit of the log's time right?" if min(slow.values()) < WRONG_CLOCK else "")
        )
    there = {str(name) for name in flight.data.data_vars}
    said = flight.air is not None and bool(flight.air.notes)  # the reconstruction knows better why
    if not {"V", "alpha", "beta"} & there and not lifting(flight) and not said:
        notes.append(
            "no air data: neither airspeed and vanes, nor ground velocity and attitude to reconstruct it; "
            "V, alpha and beta are missing"
        )
    return notes


def _slow(sources: Mapping[str, SourceRate], limit: float) -> dict[str, float]:
    """Return the body rates that were logged more slowly than a limit, and how fast; Hz."""
    there = {name: sources[name].rate for name in ("p", "q", "r") if name in sources}
    return {name: rate for name, rate in there.items() if 0.0 < rate < limit}


def _empty(flight: Flight, names: Iterable[str]) -> bool:
    return not np.logical_and.reduce([np.isfinite(flight.column(name)) for name in names]).any()

"""Logs of a fleet that is made up, so that what changed in it is known: differences of vehicles and parts, exchanges, updates.

::

    vehicles = 4               # format = "stoop-fleet/1"; every key may be left out
    flights = 12               # of each vehicle
    vehicle = { "mass.mass" = 0.01 }    # standard deviations between vehicles; of `flight` between flights

    [part.m1]                  # a place; when no part is given, every rotor is one
    spread = { "rotor.m1.factor" = 0.003 }  # standard deviations between parts
    exchanges = 1              # on each vehicle, before flights that are drawn

    [[update]]                 # of all vehicles
    flight = 8                 # first one that has it, as below
    software = "1.1"

    [[change]]
    vehicle = 2
    flight = 7
    number = "rotor.m1.factor"
    by = -0.03                 # in its unit; of a drift, at the last flight
    part = "m1"                # is exchanged before this flight, and the new one has it
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from stoop import Vehicle
from stoop.extend import files
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError, StoopError
from stoop.extend.motion import Maneuver, fly_together, recorded
from stoop.extend.recordings import mapping_beside
from stoop.extend.text import nearest
from stoop.extend.vehicles import schema, with_free_number
from stoop_fleet.changes import Kind
from stoop_fleet.parts import COLUMNS, Fitting
from stoop_plan.flight_logs import px4_log

HOVER: Final = Maneuver(duration=40.0, rate=50.0)  #: a flight, unless a maneuver is named
PARTS, TRUTH, ENDING = "parts.csv", "truth.csv", ".ulg"
FACTOR_SPREAD: Final = 0.003  #: between the thrusts of propellers of one kind
FIRST_SOFTWARE: Final = "1.0"
DAY: Final = 86400.0  #: s
APART: Final = 0.2  #: share of the mean time between flights that lies between two of them, at least
#: m/s at which the gusts pass a vehicle that hovers, and their scale length, m
GUST_SPEED, GUST_LENGTH = 5.0, 20.0
TOGETHER: Final = 32  #: flights that are flown side by side

Spread = Annotated[schema.Number, Field(ge=0.0)]
Spreads = dict[str, Spread]
Nth = Annotated[int, Field(strict=True, ge=1)]
Later = Annotated[int, Field(strict=True, ge=2)]  #: of flights, counted from one: there is one before


class Place(schema.Table):
    """Parts of one kind in a place of every vehicle."""

    spread: Spreads = Field(default_factory=dict)
    exchanges: Annotated[int, Field(strict=True, ge=0)] = 1


class Update(schema.Table):
    """Other software on all vehicles."""

    flight: Later
    software: str


class KnownChange(schema.Table):
    """A change of a number of one vehicle."""

    vehicle: Nth
    flight: Later
    number: str
    by: schema.Number
    kind: Kind = "step"
    part: str = ""

    def course(self, flights: int) -> FloatArray:
        """Return what is added (n,) to the number in each flight."""
        since = np.maximum(np.arange(1.0, flights + 1.0) - self.flight + 1.0, 0.0)
        shape = since / since[-1] if self.kind == "drift" else np.minimum(since, 1.0)
        return np.asarray(self.by * shape)


class FleetFile(schema.Table):
    """A fleet that is made up, see the module."""

    format: Literal["stoop-fleet/1"] = "stoop-fleet/1"
    vehicles: Annotated[int, Field(strict=True, ge=1, le=1000)] = 4
    flights: Annotated[int, Field(strict=True, ge=2, le=10_000)] = 12
    start: date = date(2026, 1, 1)
    days: Annotated[schema.Number, Field(gt=0.0, le=36525.0)] = 365.0
    wind: Annotated[schema.Number, Field(ge=0.0, le=20.0)] = 1.0
    gusts: Annotated[schema.Number, Field(ge=0.0, le=20.0)] = 0.3
    vehicle: Spreads = Field(default_factory=dict)
    flight: Spreads = Field(default_factory=dict)
    part: dict[str, Place] = Field(default_factory=dict)
    update: tuple[Update, ...] = ()
    change: tuple[KnownChange, ...] = ()

    @model_validator(mode="after")
    def _within(self) -> FleetFile:
        for change in self.change:
            if change.vehicle > self.vehicles:
                raise ValueError(f"change: vehicle {change.vehicle} of {self.vehicles}; correct one of them")
            if change.part and self.part and change.part not in self.part:
                raise ValueError(
                    f"change: there is no part '{change.part}'; {nearest(change.part, self.part)}"
                )
        for flight in (one.flight for several in (self.update, self.change) for one in several):
            if flight > self.flights:
                raise ValueError(f"flight {flight} of {self.flights}; correct one of them")
        return self

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the numbers of the vehicle file that differ between flights, sorted."""
        spreads = [self.vehicle, self.flight, *(place.spread for place in self.part.values())]
        return tuple(sorted({*(n for one in spreads for n in one), *(c.number for c in self.change)}))


@dataclass(frozen=True, eq=False)
class MadeFlight:
    """A flight before it is flown.

    Attributes
    ----------
    begin : s since 1970
    numbers : of the vehicle file, that fly
    wind : (2,) north and east, m/s
    seed : of gusts and noise
    """

    name: str
    vehicle: str
    begin: float
    software: str
    numbers: Mapping[str, float]
    wind: FloatArray
    seed: int


def read_fleet(text: str, vehicle: Vehicle) -> FleetFile:
    """Return a fleet of a file, or of a number of vehicles in which nothing changes.

    Raises
    ------
    StoopError
        One line that names the key and the fix.
    """
    if text.isascii() and text.isdigit():
        raw, where = {"vehicles": int(text)}, f"--fleet {text}"
    else:
        raw, where = (
            files.toml.parse_source(files.toml.read_source(text, "fleet", StoopError), text, StoopError),
            text,
        )
    try:
        found = FleetFile.model_validate(raw)
        if not found.part:
            rotors = {name: Place(spread={f"rotor.{name}.factor": FACTOR_SPREAD}) for name in vehicle.rotors}
            found = FleetFile.model_validate({**found.model_dump(), "part": rotors})
    except ValidationError as error:
        raise StoopError(f"{where}: {files.first_complaint(error, raw, FleetFile)}") from None
    return found


def write_fleet(
    fleet: FleetFile,
    vehicle: Vehicle,
    maneuver: Maneuver,
    folder: Path,
    seed: int = 0,
    noise: bool = True,
    overwrite: bool = False,
    watch: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Fly a fleet, and write its logs, its table of parts and the truth; return how many flights there are.

    Parameters
    ----------
    fleet : FleetFile
    vehicle : Vehicle
        About whose numbers those of the fleet are.
    maneuver : Maneuver
        Which every flight is.
    folder : Path
        Takes a ULog for each flight, `PARTS`, and `TRUTH`: the numbers that flew.
    seed : int
        Of all that is drawn; a vehicle has the same draws whatever the number of vehicles.
    noise : bool
        Of the sensors.
    watch : callable, optional
        Called with the number of flights that are done and that of all.

    Raises
    ------
    StoopError
        A number that the vehicle does not have, a flight that fails, a folder that holds something else.
    """
    if fleet.days * DAY / fleet.flights * APART < maneuver.duration:
        raise StoopError(f"{fleet.flights} flights do not fit into {fleet.days:g} days; raise days")
    base = ready(vehicle, fleet)
    flights, fittings = drawn(fleet, base, seed)
    names = [one.name + ENDING for one in flights]
    files.check_targets(
        folder, (*names, *(mapping_beside(Path(n)).name for n in names), PARTS, TRUTH), overwrite
    )
    if strange := sorted({path.name for path in folder.glob(f"*{ENDING}")} - {*names}):
        raise StoopError(f"{folder}: holds {strange[0]}, which is no log of this fleet; name an empty folder")
    for k in range(0, len(flights), TOGETHER):
        watch(k, len(flights))
        block = flights[k : k + TOGETHER]
        for one, (content, mapping) in zip(block, _flown(block, base, maneuver, noise), strict=True):
            log = one.name + ENDING
            beside = mapping_beside(Path(log)).name
            written = {log: content} | ({beside: mapping} if mapping else {})
            files.write_files(folder, written, () if mapping else [beside])
    files.write_file(folder / PARTS, files.csv_text(COLUMNS, map(_row, fittings), "\n"))
    truth = ((f.name, f.vehicle, _date(f.begin), *map(str, f.numbers.values())) for f in flights)
    files.write_file(
        folder / TRUTH, files.csv_text(("flight", "vehicle", "time", *fleet.numbers), truth, "\n")
    )
    return len(flights)


def ready(vehicle: Vehicle, fleet: FleetFile) -> Vehicle:
    """Return the vehicle with the gusts of a fleet, and with all numbers that differ in it.

    Those that its file lacks begin where they have no effect, such as a factor of one.
    """
    if fleet.gusts and vehicle.file.turbulence is None:
        gust = {"intensity": fleet.gusts, "length": GUST_LENGTH}
        table = schema.Turbulence.model_validate({"airspeed": GUST_SPEED, **dict.fromkeys("uvw", gust)})
        vehicle = replace(vehicle, file=vehicle.file.model_copy(update={"turbulence": table}))
    for name in fleet.numbers:
        known = vehicle.quantities
        if name not in known:
            found = with_free_number(vehicle, name)
            if found is None:
                raise StoopError(f"{vehicle.where}: no number is called '{name}'; {nearest(name, known)}")
            vehicle = found[0]
    return vehicle


def drawn(fleet: FleetFile, vehicle: Vehicle, seed: int) -> tuple[list[MadeFlight], list[Fitting]]:
    """Return the flights of a fleet, vehicle by vehicle, and its parts."""
    each = [_of_vehicle(fleet, vehicle, v, seed) for v in range(1, fleet.vehicles + 1)]
    return [one for flights, _ in each for one in flights], [one for _, own in each for one in own]


def _of_vehicle(
    fleet: FleetFile, vehicle: Vehicle, v: int, seed: int
) -> tuple[list[MadeFlight], list[Fitting]]:
    rng, n, name = np.random.default_rng([seed, v]), fleet.flights, f"V{v}"
    start = datetime.combine(fleet.start, time(), UTC).timestamp()
    begin = start + fleet.days * DAY / n * (np.arange(n) + (1.0 - APART) * rng.random(n))
    wind, seeds = fleet.wind * rng.standard_normal((n, 2)), rng.integers(2**31, size=n).tolist()
    numbers = {number: np.full(n, vehicle.value(number)) for number in fleet.numbers}
    for number, spread in fleet.vehicle.items():
        numbers[number] += spread * rng.standard_normal()
    for number, spread in fleet.flight.items():
        numbers[number] += spread * rng.standard_normal(n)
    own = [change for change in fleet.change if change.vehicle == v]
    fittings = []
    for place, part in fleet.part.items():
        known = {change.flight - 1 for change in own if change.part == place}
        exchanged = 1 + rng.permutation(n - 1)[: part.exchanges]
        firsts = sorted({0, *(k for k in exchanged.tolist() if k < min(known, default=n)), *known})
        for i, (first, end) in enumerate(pairwise([*firsts, n]), start=1):
            for number, spread in part.spread.items():
                numbers[number][first:end] += spread * rng.standard_normal()
            since, until = (_between(begin, k) for k in (first, end))
            fittings.append(Fitting(name, place, f"{place}-{v}-{i}", since, until))
    for change in own:
        numbers[change.number] += change.course(n)
    software = [FIRST_SOFTWARE] * n
    for update in sorted(fleet.update, key=lambda one: one.flight):
        software[update.flight - 1 :] = [update.software] * (n - update.flight + 1)
    flights = [
        MadeFlight(
            f"{name}-{i + 1:03d}", name, float(begin[i]), software[i],
            {number: float(x[i]) for number, x in numbers.items()}, wind[i], seeds[i],
        )
        for i in range(n)
    ]  # fmt: skip
    return flights, fittings


def _between(begin: FloatArray, k: int) -> float:
    """Return a time, whole seconds, between flight k and the one before; infinite before the first and after the last."""
    if k == 0:
        return -np.inf
    return np.inf if k == len(begin) else float(np.rint(0.5 * (begin[k - 1] + begin[k])))


def _flown(
    flights: Sequence[MadeFlight], base: Vehicle, maneuver: Maneuver, noise: bool
) -> list[tuple[bytes, str]]:
    """Return the log of each flight, and its mapping."""
    each, out = [], []
    for one in flights:
        numbers = {name: {"value": value} for name, value in one.numbers.items()}
        wind = np.append(one.wind, 0.0) + (maneuver.wind or (0.0, 0.0, 0.0))
        each.append((base.with_numbers(numbers), maneuver.model_copy(update={"wind": tuple(wind.tolist())})))
    found = fly_together(each, [one.seed for one in flights])
    for one, (vehicle, windy), flown in zip(flights, each, found, strict=True):
        if isinstance(flown, SimulationError):
            raise SimulationError(f"flight {one.name}: {flown}; lower the spreads, the wind or the gusts")
        flight = recorded(vehicle, windy, flown, one.seed, noise, one.name)
        out.append(px4_log(flight, one.vehicle, one.software, one.begin - float(flight.time[0])))
    return out


def _row(one: Fitting) -> tuple[str, ...]:
    ends = ("" if np.isinf(x) else _date(x) for x in (one.begin, one.end))
    return one.vehicle, one.part, one.serial, *ends


def _date(seconds: float) -> str:
    return datetime.fromtimestamp(round(seconds), UTC).isoformat()

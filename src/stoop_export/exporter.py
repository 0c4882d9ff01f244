"""What every target of ``stoop export`` takes, gives and does: a model and a steady flight in, files and notes out."""

from __future__ import annotations

import importlib.util
import math
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError, StoopError
from stoop.extend.files import write_files
from stoop.extend.motion import Trim
from stoop.extend.text import count, printable
from stoop_analysis.known_model import Condition, KnownModel
from stoop_export.agreement import (
    EXPORT_PAGE,
    Compared,
    agreement_page,
    axis_shares,
    has_axes,
    loads_at,
    shares_of,
)
from stoop_export.jsbsim_flight import Record, own_readings, relative_differences
from stoop_export.reference_flight import ReferenceFlight, reference_flight, states_of

FLIP: Final = np.array([1.0, -1.0, -1.0])  #: forward, right, down <-> forward, left, up


DEFAULT: Final = Condition()
MOST_FILES: Final = 7  #: that a short text names


@dataclass(frozen=True, eq=False)
class ModelData(KnownModel):
    """A known model with its flight, and draws of its parameters."""

    maneuvers: tuple[Record, ...] = ()  #: of the flight, from the estimated initial states
    #: of the parameters, by name, (D,) each; empty where none are asked for
    draws: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def unidentified(self) -> tuple[str, ...]:
        """A note on the parameters that the flight does not determine, if there are any."""
        lost = () if self.covariance is None else self.covariance.not_identified
        note = f"Not identified by the flight: {', '.join(lost)}; these numbers rest on the vehicle file or on priors."
        return (note,) if lost else ()


@dataclass(frozen=True, eq=False, repr=False)
class Exported:
    """Files by their place below the output folder, the main one, and notes for the user."""

    files: Mapping[str, bytes]
    main: str
    notes: tuple[str, ...] = ()
    compared: tuple[Compared, ...] = ()

    def __repr__(self) -> str:
        """Return the largest files with their sizes, the main one first, and the number of notes."""
        found = f"{count(len(self.files), 'file')}, {sum(map(len, self.files.values()))} bytes"
        lines = [f"<Exported: {found}; {count(len(self.notes), 'note')}>"]
        names = sorted(self.files, key=lambda name: (name != self.main, -len(self.files[name])))
        lines += [f"{name}  {len(self.files[name])} bytes" for name in names[:MOST_FILES]]
        lines += [f"and {len(names) - MOST_FILES} more"] * (len(names) > MOST_FILES)
        return "\n".join(map(printable, lines))

    def with_notes(self, notes: Iterable[str]) -> Exported:
        """Return the files with further notes."""
        return replace(self, notes=(*self.notes, *notes))

    def with_flights(self, compared: Iterable[Compared]) -> Exported:
        """Return the files with further compared flights, and a note on each."""
        new = tuple(compared)
        return replace(self, compared=(*self.compared, *new)).with_notes(map(str, new))


@dataclass(frozen=True, eq=False)
class Exporter(ABC):
    """A model as files of one tool: a target of ``stoop export`` is one subclass, and one row of the table of targets."""

    model: ModelData
    condition: Condition = DEFAULT

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle of the model."""
        return self.model.vehicle

    @cached_property
    def point(self) -> Trim:
        """The steady flight of the condition; SimulationError where there is none."""
        return self.model.trim(self.condition)

    @property
    def actuators(self) -> tuple[str, ...]:
        """Names of dead zones, rate limits and delays that do something."""
        return self.vehicle.held_numbers(("dead_zone", "rate_limit", "delay"))

    @abstractmethod
    def files(self) -> Exported:
        """Return the files, and notes on them."""

    def lacks(self) -> list[str]:
        """Return notes on what the tool cannot represent of this model, and what that costs."""
        return []

    def with_draws(self, made: Exported) -> Exported:
        """Return the files with the parameter sets of the draws; a target that takes none refuses them."""
        if self.model.draws:
            raise StoopError(
                "--draws: this target takes one parameter set; give mujoco, pyflyt, gym-pybullet-drones, crazyflow or isaac"
            )
        return made

    def fly(self, made: Exported) -> Exported:
        """Fly the files in the tool; return them with notes on the agreement with our simulation, or why they were not flown."""
        return made

    def without_actuators(self, note: Callable[[tuple[str, ...]], str]) -> list[str]:
        """Return a note on the dead zones, rate limits and delays, where there are some, and what they make of each maneuver."""
        costs = map(cost_without_actuators, self.model.maneuvers)
        return [note(self.actuators), *costs] if self.actuators else []

    def along_reference(
        self, made: Exported, point: Trim, compare: Callable[[Exported, ReferenceFlight], Exported]
    ) -> Exported:
        """Return the files with the comparison along the flight from a steady flight, or why there is no such flight."""
        try:
            flight = reference_flight(self.vehicle, point)
        except SimulationError as error:
            return made.with_notes([f"Not flown: {error}."])
        diverges = ["Not flown: the open loop diverges within 3 s."]
        return made.with_notes(diverges) if flight is None else compare(made, flight)

    def export(self) -> Exported:
        """Return the files with all notes: of the model, on the files, on what the tool lacks, on the flight.

        Raises
        ------
        StoopError
            The model cannot be exported so, or no steady flight is found.
        """
        made = self.files()
        if not isinstance(made, Exported):
            raise StoopError(
                f"{type(self).__module__}: files() gives {type(made).__name__}, not Exported; correct it"
            )
        made = self.with_draws(made)
        made = self.fly(replace(made, notes=(*self.model.notes, *made.notes, *self.lacks())))
        if not made.compared:
            return made
        page = agreement_page(f"{self.vehicle.name}: agreement of the export", made.compared, made.notes)
        return replace(made, files={**made.files, **encoded({EXPORT_PAGE: page})})


@dataclass(frozen=True, eq=False)
class FullExporter(Exporter):
    """A target of models with all six degrees of freedom, whatever the fit had."""

    @cached_property
    def full(self) -> ModelData:
        """The model with the equations of all six degrees of freedom."""
        vehicle = self.model.vehicle
        return (
            self.model if vehicle.reduce == "full" else replace(self.model, vehicle=vehicle.reduced("full"))
        )

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with all six degrees of freedom."""
        return self.full.vehicle

    @cached_property
    def point(self) -> Trim:
        """The steady flight of the condition."""
        return self.full.trim(self.condition)

    @property
    def completed(self) -> list[str]:
        """A note on the degrees of freedom that the fit did not have, if it left some out."""
        reduced = self.model.vehicle.reduce
        note = (
            f"The equations of the fit are {reduced}; the models have all six degrees of freedom, the others with the "
            "numbers of the vehicle file."
        )
        return [note] if reduced != "full" else []


def encoded(texts: Mapping[str, str]) -> dict[str, bytes]:
    """Return texts as UTF-8."""
    return {place: text.encode("utf-8", errors="replace") for place, text in texts.items()}


def installed(package: str) -> bool:
    """Return whether a package that not every installation has is there."""
    return importlib.util.find_spec(package) is not None


def load_script(place: Path) -> Any:
    """Return a script that was written as a module; without a cache beside it."""
    spec = importlib.util.spec_from_file_location(f"_stoop_{place.stem}", place)
    if spec is None or spec.loader is None:
        raise StoopError(f"{place}: no script")
    module = importlib.util.module_from_spec(spec)
    keep, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
    finally:
        sys.dont_write_bytecode = keep
    return module


@contextmanager
def written(content: Mapping[str, str] | Mapping[str, bytes]) -> Iterator[Path]:
    """Give a temporary folder with files, in which a tool flies them before they are written where the user wants them."""
    with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
        write_files(Path(root), content)
        yield Path(root)


def cost_without_actuators(maneuver: Record) -> str:
    """Return how far a fitted maneuver moves where dead zones, rate limits and delays are left out."""
    idle, own = {"dead_zone": 0.0, "rate_limit": math.inf, "delay": 0.0}, maneuver.vehicle.quantities
    untied = [n for n in maneuver.vehicle.rows if n in own and own[n].tie is None]  # the others follow
    neutral = {n: {"value": idle[end]} for n in untied if (end := n.rpartition(".")[2]) in idle}
    prompt = replace(maneuver, vehicle=maneuver.vehicle.with_numbers(neutral))
    try:
        whole, less = own_readings(maneuver), own_readings(prompt)
    except SimulationError as error:
        return f"{maneuver.title}: {error}."
    shares = relative_differences(maneuver.vehicle.outputs, whole, less)
    worst = max(shares, key=lambda name: shares[name])
    axes = ""
    if has_axes(maneuver.vehicle):
        states = states_of(maneuver)
        loads, change = loads_at(maneuver, states), loads_at(prompt, states)
        axes = f"; loads at the same states differ by {axis_shares(shares_of(change - loads, loads))} (rms)"
    return (
        f"{maneuver.title}: without them readings move by up to {100.0 * shares[worst]:.2g} % of a channel's "
        f"maximum ({worst}){axes}."
    )

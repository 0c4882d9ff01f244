"""What to fly next, in one call: what is known, the best input of each family, what it would tell, and its files."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from stoop.base.arrays import FloatArray
from stoop.base.files import write_text_atomic
from stoop.base.numbers import finite_or_none
from stoop.design import SHAPES, Design, Forecast, Knowledge, Limits, Setup, design
from stoop.design.information import sensor_noise
from stoop.design.optimization import Plan, Robustness, mean_ratio, robustness, textbook_maneuver
from stoop.errors import OutputError
from stoop.report.sheet import write_sheet
from stoop.results.result import Result
from stoop.simulate import Maneuver, Trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.identified import Identified, read_identified
from stoop.workflow.provenance import versions

FORMAT: Final = "stoop-design/1"
DRAWS: Final = 20
FILES: Final = ("maneuver.toml", "reference.toml", "maneuver.csv", "design.html", "design.json")
"""In the order of writing: where the last one is, the others are."""


@dataclass(frozen=True, eq=False)
class Believed:
    """A model and what is known of it.

    Attributes
    ----------
    vehicle : Vehicle
    knowledge : Knowledge
    noise : (n_y, n_y)
    source : str
        Where it comes from, in words.
    """

    vehicle: Vehicle
    knowledge: Knowledge
    noise: FloatArray
    source: str


@dataclass(frozen=True, eq=False)
class Proposal:
    """What to fly next.

    Attributes
    ----------
    setup : Setup
    plan : Plan
    designs : tuple of Design
        One per family, the best first.
    reference : Maneuver
        The textbook's: a 3-2-1-1 on one control after the other, of the same duration and amplitude.
    expected : Forecast
        Of the reference.
    robustness : Robustness
        Of the best.
    source : str
    """

    setup: Setup
    plan: Plan
    designs: tuple[Design, ...]
    reference: Maneuver
    expected: Forecast
    robustness: Robustness
    source: str

    @property
    def best(self) -> Design:
        """The design that tells most."""
        return self.designs[0]

    @property
    def now(self) -> FloatArray:
        """Standard errors (D,) before the flight; infinite where nothing is known."""
        return self.setup.std()

    def ratio(self, told: Design) -> float:
        """Return the mean of a design's standard errors over the reference's."""
        return mean_ratio(self.setup.std(told.forecast), self.setup.std(self.expected))


def believed(name_or_path: str | Path) -> Believed:
    """Return the model to design for: a vehicle (priors are what is known of it), or what stoop identify found.

    Parameters
    ----------
    name_or_path : str or Path
        A built-in vehicle, a vehicle file, a result.json, or the folder that holds it.

    Raises
    ------
    StoopError
        There is no such thing, or the result's vehicle is not beside it.
    """
    path = Path(name_or_path)
    found = path / "result.json" if path.is_dir() else path
    if found.suffix != ".json":
        vehicle = resolve_vehicle(name_or_path)
        return Believed(vehicle, _priors(vehicle), sensor_noise(vehicle), "the vehicle file and its priors")
    told = read_identified(path)
    result, vehicle = told.result, searched(told)
    return Believed(
        vehicle, Knowledge.of_result(result), _noise(vehicle, result), f"the estimates in {found}"
    )


def searched(told: Identified) -> Vehicle:
    """Return the identified vehicle with those numbers free that were estimated, within the boxes of that search.

    Its file does not say what ``--free`` and ``--fix`` of stoop identify said.
    """
    estimated = told.result.parameters
    changes: dict[str, dict[str, Any]] = {
        p.name: {"free": False} for p in told.vehicle.parameters if p.free and p.name not in estimated
    }
    for name, p in estimated.items():
        changes[name] = {"free": True}
        if p.bound_lower < p.bound_upper and np.isfinite([p.bound_lower, p.bound_upper]).all():
            changes[name]["bounds"] = (p.bound_lower, p.bound_upper)
    return told.vehicle.with_numbers(changes)


def _priors(vehicle: Vehicle) -> Knowledge:
    stated = [p for p in vehicle.parameters if p.free and p.prior is not None]
    return Knowledge(tuple(p.name for p in stated), np.diag([(p.prior or 1.0) ** -2.0 for p in stated]))


def _noise(vehicle: Vehicle, result: Result) -> FloatArray:
    """Return the noise that was found where there was a measurement, else what the vehicle file states."""
    noise = sensor_noise(vehicle)
    for i, channel in enumerate(vehicle.outputs):
        if channel in result.noise_covariance.channels:
            j = result.noise_covariance.channels.index(channel)
            found = float(result.noise_covariance.matrix[j, j])
            noise[i, i] = found if np.isfinite(found) and found > 0.0 else noise[i, i]
    return noise


def propose(
    model: Believed,
    trim: Trim,
    limits: Limits,
    plan: Plan,
    shapes: Sequence[str] = tuple(SHAPES),
    callback: Callable[[str, Any], None] | None = None,
) -> Proposal:
    """Design the best maneuver of every family, and hold it against the textbook's and a doubtful model.

    Parameters
    ----------
    model : Believed
    trim : Trim
        Where it begins.
    limits : Limits
    plan : Plan
    shapes : sequence of str
        Names of :data:`stoop.design.SHAPES`.
    callback : callable, optional
        Sees the family's name and an :class:`stoop.optimize.Progress` after each generation.

    Raises
    ------
    SimulationError
        No maneuver stays within the limits.
    """
    setup = Setup(model.vehicle, trim, limits, model.knowledge, model.noise)
    reference = textbook_maneuver(setup, plan)
    watch = callback or (lambda name, progress: None)
    found = [design(setup, plan, name, lambda progress, name=name: watch(name, progress)) for name in shapes]  # type: ignore[misc]
    designs = tuple(sorted(found, key=lambda one: -one.gain))
    told = robustness(setup, designs[0].maneuver, reference, DRAWS, plan.seed)
    return Proposal(setup, plan, designs, reference, setup.forecast(reference), told, model.source)


def _make(folder: Path, overwrite: bool) -> None:
    """Make the folder, and refuse one that holds a design already."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file; name a folder with -o") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made ({error.strerror}); choose another") from None
    there = [name for name in FILES if (folder / name).exists()]
    if there and not overwrite:
        raise OutputError(f"{folder}: holds {there[0]} already; add --overwrite or name another folder")


def write_proposal(proposal: Proposal, folder: Path, command: str, overwrite: bool = False) -> None:
    """Write maneuver files, a table of deflections, the page and the numbers; each file whole or not at all.

    Raises
    ------
    OutputError
        The folder cannot be made, or holds a design already; or a file cannot be written.
    """
    from stoop.workflow.design_page import design_sheet

    sheet = design_sheet(proposal, command)
    _make(folder, overwrite)
    write_text_atomic(folder / "maneuver.toml", maneuver_toml(proposal.best.maneuver, f"designed: {command}"))
    write_text_atomic(
        folder / "reference.toml", maneuver_toml(proposal.reference, "what the design is compared with")
    )
    write_text_atomic(folder / "maneuver.csv", maneuver_csv(proposal.best.maneuver))
    write_sheet(sheet, folder / "design.html")
    write_text_atomic(
        folder / "design.json", json.dumps(document(proposal), indent=1, allow_nan=False) + "\n"
    )


def maneuver_toml(maneuver: Maneuver, words: str) -> str:
    """Return a maneuver as the file that ``stoop simulate`` reads."""
    plain = maneuver.model_dump(mode="json", exclude_none=True)
    text = tomlkit.document()
    for line in " ".join(words.split()).split(" -- "):
        text.add(tomlkit.comment(line))
    for key, value in plain.items():
        if key not in ("input", "noise"):
            text.add(key, value)
    tables = tomlkit.aot()
    for entry in plain["input"]:
        tables.append(tomlkit.item(entry))
    text.add("input", tables)
    return tomlkit.dumps(text)


def maneuver_csv(maneuver: Maneuver) -> str:
    """Return the deflections from the trim as CSV: time in s, angles in rad."""
    moves = maneuver.deflections()
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time_s", *(f"{control}_rad" for control in moves)])
    for t, *values in zip(maneuver.time, *moves.values(), strict=True):
        writer.writerow([f"{t:.6g}", *(f"{value:.9g}" for value in values)])
    return out.getvalue()


def document(proposal: Proposal) -> dict[str, Any]:
    """Return the numbers of a proposal for JSON, SI and rad; what does not exist is null."""
    setup, plan, told = proposal.setup, proposal.plan, proposal.robustness
    return {
        "format": FORMAT,
        "vehicle": setup.vehicle.name,
        "file": setup.vehicle.where,
        "knowledge": proposal.source,
        "airspeed": setup.trim.start["V"],
        "altitude": setup.trim.start["h"],
        "duration": plan.duration,
        "band": plan.band,
        "limits": {
            "amplitude": dict(setup.limits.amplitude),
            "slew": setup.limits.slew,
            "envelope": {c: list(span) for c, span in setup.limits.envelope.items()},
        },
        "shape": proposal.best.shape,
        "designs": {one.shape: _design_entry(proposal, one) for one in proposal.designs},
        "standard_errors": _errors(proposal),
        "robustness": {
            "draws": told.draws, "untrimmed": told.untrimmed, "outside": told.outside,
            "largest_excess": told.largest_excess, "ratios": list(told.ratios),
        },
        "optimizer": plan.optimizer,
        "seed": plan.seed,
        "versions": versions(),
    }  # fmt: skip


def _design_entry(proposal: Proposal, one: Design) -> dict[str, Any]:
    return {
        "gain": one.gain,
        "mean_ratio": finite_or_none(proposal.ratio(one)),
        "excess": finite_or_none(one.forecast.excess),
        "evaluations": one.evaluations,
    }


def _errors(proposal: Proposal) -> dict[str, Mapping[str, float | None]]:
    setup = proposal.setup
    columns = {
        "now": proposal.now,
        "reference": setup.std(proposal.expected),
        **{one.shape: setup.std(one.forecast) for one in proposal.designs},
    }
    return {
        name: {
            "value": float(setup.values[i]),
            **{key: finite_or_none(std[i]) for key, std in columns.items()},
        }
        for i, name in enumerate(setup.names)
    }

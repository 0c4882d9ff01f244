"""Planning: what to fly next, from the model as it is known; and which windows of a flight to fit and to predict."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from stoop.base.csv_text import csv_text
from stoop.base.files import check_targets, make_folder, write_files
from stoop.base.numbers import finite_or_none
from stoop.flight import Flight
from stoop.input_design.information import Knowledge, sensor_noise
from stoop.input_design.optimization import PriorModel, Proposal
from stoop.input_design.windows import Found
from stoop.problem.windows import NAME, Entry, written
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.outputs import read_identified, versions

DESIGN_FILES: Final = ("maneuver.toml", "reference.toml", "maneuver.csv", "design.html", "design.json")
"""In the order of writing: where the last one is, the others are."""
WINDOW_FILES: Final = (NAME, "windows.html")


def prior_model(name_or_path: str | Path) -> PriorModel:
    """Return the model to design for: a vehicle with its priors, or the result of stoop identify.

    It is a built-in vehicle, a vehicle file, a result.json, or the folder that holds it.

    Raises `StoopError`: there is no such thing, or the result's vehicle is not beside it.
    """
    path = Path(name_or_path)
    found = path / "result.json" if path.is_dir() else path
    if found.suffix != ".json":
        vehicle = resolve_vehicle(name_or_path)
        stated = [p for p in vehicle.parameters if p.free and p.prior is not None]
        priors = np.diag([(p.prior or 1.0) ** -2.0 for p in stated])
        knowledge = Knowledge(tuple(p.name for p in stated), priors)
        return PriorModel(vehicle, knowledge, sensor_noise(vehicle), "the vehicle file and its priors")
    identified = read_identified(path)
    # Those numbers are free that were estimated, within the boxes of that search, with its --free and --fix.
    estimated, covariance = identified.result.parameters, identified.result.noise_covariance
    free = [p.name for p in identified.vehicle.parameters if p.free]
    changes: dict[str, dict[str, Any]] = {name: {"free": name in estimated} for name in (*free, *estimated)}
    for name, p in estimated.items():
        if p.bound_lower < p.bound_upper and np.isfinite([p.bound_lower, p.bound_upper]).all():
            changes[name]["bounds"] = (p.bound_lower, p.bound_upper)
    vehicle = identified.vehicle.with_numbers(changes)
    # The noise that was estimated where there was a measurement, else that of the vehicle file.
    noise = sensor_noise(vehicle)
    variances = dict(zip(covariance.channels, np.diag(covariance.matrix), strict=True))
    for i, channel in enumerate(vehicle.outputs):
        variance = float(variances.get(channel, np.nan))
        if np.isfinite(variance) and variance > 0.0:
            noise[i, i] = variance
    return PriorModel(vehicle, Knowledge.of_result(identified.result), noise, f"the estimates in {found}")


def write_proposal(proposal: Proposal, folder: Path, command: str, overwrite: bool = False) -> None:
    """Write maneuver files, a table of deflections, the page and the numbers; all or none.

    Raises `OutputError`: the folder cannot be made, or holds a design already; or a file cannot be written.
    """
    from stoop.report.design import design_sheet
    from stoop.report.sheet import render_sheet

    check_targets(folder, DESIGN_FILES, overwrite)
    make_folder(folder)
    best = proposal.best.maneuver
    deflections = best.deflections()  # from the trim, rad
    head = ("time_s", *(f"{control}_rad" for control in deflections))
    rows = zip(best.time, *deflections.values(), strict=True)
    table = csv_text(head, ([f"{t:.6g}", *(f"{value:.9g}" for value in values)] for t, *values in rows))
    files = {
        "maneuver.toml": maneuver_toml(best, f"designed: {command}"),
        "reference.toml": maneuver_toml(proposal.reference, "what the design is compared with"),
        "maneuver.csv": table.replace("\r\n", "\n"),
        "design.html": render_sheet(design_sheet(proposal, command)),
        "design.json": json.dumps(design_document(proposal), indent=1, allow_nan=False) + "\n",
    }
    write_files(folder, files)


def maneuver_toml(maneuver: Maneuver, comment: str) -> str:
    """Return a maneuver as the file that ``stoop simulate`` reads."""
    plain = maneuver.model_dump(mode="json", exclude_none=True)
    text = tomlkit.document()
    for line in " ".join(comment.split()).split(" -- "):
        text.add(tomlkit.comment(line))
    for key, value in plain.items():
        if key not in ("input", "noise"):
            text.add(key, value)
    tables = tomlkit.aot()
    for entry in plain["input"]:
        tables.append(tomlkit.item(entry))
    text.add("input", tables)
    return tomlkit.dumps(text)


def design_document(proposal: Proposal) -> dict[str, Any]:
    """Return the numbers of a proposal for JSON, SI and rad; what does not exist is null."""
    setup, plan, robust = proposal.setup, proposal.plan, proposal.robustness
    limits = setup.limits
    columns = {
        "now": proposal.now,
        "reference": setup.std(proposal.expected),
        **{one.shape: setup.std(one.forecast) for one in proposal.designs},
    }
    return {
        "format": "stoop-design/1",
        "vehicle": setup.vehicle.name,
        "file": setup.vehicle.where,
        "knowledge": proposal.source,
        "airspeed": setup.trim.start["V"],
        "altitude": setup.trim.start["h"],
        "duration": plan.duration,
        "band": plan.band,
        "limits": {
            "amplitude": dict(limits.amplitude),
            "slew": limits.slew,
            "envelope": {c: list(span) for c, span in limits.envelope.items()},
        },
        "shape": proposal.best.shape,
        "designs": {
            one.shape: {
                "gain": one.gain,
                "mean_ratio": finite_or_none(proposal.ratio(one)),
                "excess": finite_or_none(one.forecast.excess),
                "evaluations": one.evaluations,
            }
            for one in proposal.designs
        },
        "standard_errors": {
            name: {
                "value": float(setup.values[i]),
                **{key: finite_or_none(std[i]) for key, std in columns.items()},
            }
            for i, name in enumerate(setup.names)
        },
        "robustness": {
            "draws": robust.draws, "untrimmed": robust.untrimmed, "outside": robust.outside,
            "largest_excess": robust.largest_excess, "ratios": list(robust.ratios),
        },
        "notices": [robust.notice.to_dict()] if np.any(setup.known) else [],
        "optimizer": plan.optimizer,
        "seed": plan.seed,
        "versions": versions(),
    }  # fmt: skip


def write_windows(
    found: Found,
    flights: Mapping[str, Flight],
    vehicle: str,
    folder: Path,
    command: str,
    following: Sequence[str],
) -> None:
    """Write `windows.toml` and `windows.html` into a folder; both or none.

    `vehicle` is its name or empty; `following` are the words of the command that takes the file.
    """
    from stoop.report.design import windows_sheet
    from stoop.report.sheet import render_sheet

    make_folder(folder)
    entries = [
        Entry(
            flight=w.flight, start=w.start, stop=w.stop, accept=w.accept, use=w.use, axis=w.axis, why=w.why,
            information=round(w.information, 3), gain=round(w.gain, 3),
        )
        for w in found.windows
    ]  # fmt: skip
    text = written(entries, shlex.join(following), tuple(map(str, found.notices)))
    page = render_sheet(windows_sheet(found, flights, vehicle, command, following))
    write_files(folder, {NAME: text, "windows.html": page})

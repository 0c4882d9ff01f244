"""Planning: what to fly next, from the model as it is known; and which windows of a flight to fit and to predict."""

from __future__ import annotations

import json
import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from stoop import FittedModel, Flight, Vehicle, trim
from stoop.extend.arrays import FloatArray
from stoop.extend.files import check_targets, csv_text, to_json, versions, write_files
from stoop.extend.fits import takes_model_or_vehicle
from stoop.extend.motion import Maneuver, Trim
from stoop_plan.injection import Injection
from stoop_plan.input_design.information import Knowledge, Limits, Setup, flights_from_trim
from stoop_plan.input_design.optimization import Plan, Proposal, propose
from stoop_plan.input_design.sensitivity import sensor_noise
from stoop_plan.input_design.windows import FoundWindows
from stoop_plan.input_design.windows_file import NAME, Entry, written
from stoop_plan.targets import FLOWN_BY, flown_by

DESIGN_FILES: Final = ("maneuver.toml", "reference.toml", "maneuver.csv", "design.html", "design.json")
"""In the order of writing: where the last one is, the others are. Of a pilot's lines there are maneuver_1.toml and so on."""
WINDOW_FILES: Final = (NAME, "windows.html")
BEAT: Final = 0.5  #: s, that a pilot flies by
BY_HAND: Final = math.radians(2.0)  #: smallest amplitude of a surface that a pilot makes evenly (our choice)
EVALUATIONS, ROTOR_EVALUATIONS = 2000, 200  #: of a family


def known_before(model: FittedModel | Vehicle) -> tuple[Vehicle, Knowledge, FloatArray, str]:
    """Return the vehicle to design for, the knowledge of its numbers, its noise (n_y, n_y), and where these come from.

    Those numbers are free that were estimated, within the boxes of that search. The noise is the one that was estimated where
    there was a measurement, else that of the vehicle file.
    """
    if isinstance(model, Vehicle):
        stated = [p for p in model.parameters if p.free and p.prior is not None]
        priors = np.diag([(p.prior or 1.0) ** -2.0 for p in stated])
        knowledge = Knowledge(tuple(p.name for p in stated), priors)
        return model, knowledge, sensor_noise(model), "the vehicle file and its priors"
    estimated, covariance = model.result.parameters, model.result.noise_covariance
    free = [p.name for p in model.vehicle.parameters if p.free]
    changes: dict[str, dict[str, Any]] = {name: {"free": name in estimated} for name in (*free, *estimated)}
    for name, p in estimated.items():
        if p.bound_lower < p.bound_upper and np.isfinite([p.bound_lower, p.bound_upper]).all():
            changes[name]["bounds"] = (p.bound_lower, p.bound_upper)
    vehicle = model.vehicle.with_numbers(changes)
    noise = sensor_noise(vehicle)
    variances = dict(zip(covariance.channels, np.diag(covariance.matrix), strict=True))
    for i, channel in enumerate(vehicle.outputs):
        variance = float(variances.get(channel, np.nan))
        if np.isfinite(variance) and variance > 0.0:
            noise[i, i] = variance
    refused = "".join(f" ({one})" for one in model.refusal)
    return vehicle, Knowledge.of_result(model.result), noise, f"the estimates in {model.source}{refused}"


@takes_model_or_vehicle
def design(
    model: FittedModel | Vehicle,
    duration: float | None = None,
    airspeed: float | None = None,
    altitude: float = 200.0,
    amplitude: Mapping[str, float] | None = None,
    envelope: Mapping[str, tuple[float, float]] | None = None,
    shapes: Sequence[str] = (),
    seed: int = 0,
    min_amplitude: Mapping[str, float] | None = None,
    beat: float | None = None,
    evaluations: int | None = None,
    target: str | None = None,
) -> Proposal:
    """Design the maneuver that makes the standard errors smallest.

    Parameters
    ----------
    model : FittedModel, the folder of one, Vehicle, built-in vehicle or vehicle file
    duration : float, s, optional
        20 s when absent; by hand 40 s, sweeps 60 s.
    airspeed : float, m/s, optional
        V* of the vehicle when absent.
    altitude : float, m
    amplitude : mapping, optional
        Largest deflection of each control, rad; on rotors of each command, rad/s2 or m/s2.
    envelope : mapping, optional
        Lowest and highest value of a channel, SI.
    shapes : sequence of str, optional
        Of :data:`stoop_plan.input_design.inputs.SHAPES`; the usual ones when absent.
    seed : int
    min_amplitude : mapping, optional
        Smallest amplitude of each control that can be flown; 0.5 deg when absent.
    beat : float, s, optional
        Of counts, where a pilot flies the steps by hand; 0.5 s when absent for the target "pilot".
    evaluations : int, optional
        Maneuvers tried for each family; 2000 when absent, on rotors 200.
    target : str, optional
        Who flies it, of `stoop_plan.targets.FLOWN_BY`: chooses families that it can fly.

    Raises
    ------
    SimulationError
        No maneuver stays within the limits.
    """
    vehicle, knowledge, noise, source = known_before(model)
    steady = trim(vehicle, airspeed, altitude)
    smallest = min_amplitudes(vehicle.controls, target, min_amplitude)
    limits = Limits.about(vehicle, steady, amplitude, envelope=envelope, min_amplitude=smallest)
    plan, families = usual_plan(steady, target, shapes, duration, beat, evaluations, seed=seed)
    return propose(Setup(vehicle, steady, limits, knowledge, noise), plan, families, source=source)


def usual_plan(
    steady: Trim,
    target: str | None = None,
    shapes: Sequence[str] = (),
    duration: float | None = None,
    beat: float | None = None,
    evaluations: int | None = None,
    **more: Any,
) -> tuple[Plan, tuple[str, ...]]:
    """Return a plan, and families of inputs, with what is usual for a target in place of what is not given.

    No families are those that are usually tried. On rotors an autopilot flies each candidate, so fewer are.
    """
    on_wings = steady.on_wings
    if not shapes and target == "ardupilot" and not on_wings:
        shapes = ("sweep",)  # all that the mode System ID flies
    if target == "pilot" and beat is None:
        beat = BEAT
    usual = 60.0 if "sweep" in shapes else 20.0 if beat is None else 40.0
    tried = EVALUATIONS if on_wings else ROTOR_EVALUATIONS
    plan = Plan(
        duration=duration or usual, beat=beat, evaluations=evaluations or tried,
        textbook=on_wings or target != "ardupilot", **{name: value for name, value in more.items() if value},
    )  # fmt: skip
    return plan, tuple(shapes)


def min_amplitudes(
    controls: Iterable[str], target: str | None, given: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Return the smallest amplitudes for a target, in place of those that are not given."""
    return {**(dict.fromkeys(controls, BY_HAND) if target == "pilot" else {}), **(given or {})}


def flight_files(
    proposal: Proposal, target: str, throws: Mapping[str, float] | None = None
) -> dict[str, str]:
    """Return the files with which a pilot or an autopilot flies the best design.

    Parameters
    ----------
    target : of `stoop_plan.targets.FLOWN_BY`
    throws : control to its deflection at full output, rad

    Raises
    ------
    SimulationError
        The target cannot fly it; with what can be changed.
    """
    setup, best, known = proposal.setup, proposal.best, dict(throws or {})
    flies = flown_by(target)
    flies.check(target, setup.vehicle, setup.trim, setup.limits.amplitude, known)
    injection = Injection(
        setup.vehicle,
        setup.trim,
        best.maneuver,
        best.forecast.readings,
        setup.limits.envelope,
        known,
        proposal.plan.beat,
        str(proposal.robustness.notice) if proposal.robustness.outside else "",
    )
    return flies.write(injection)


def save_design(
    proposal: Proposal,
    folder: str | Path,
    target: str | None = None,
    throws: Mapping[str, float] | None = None,
    overwrite: bool = False,
) -> Path:
    """Save a designed maneuver: maneuver files, page, and the files with which a pilot or an autopilot flies it.

    Parameters
    ----------
    proposal : Proposal
        Of :func:`design`.
    folder : path
    target : str, optional
        Who flies it: "pilot", "ardupilot", "px4" or "crazyflie".
    throws : mapping, optional
        Deflection of each surface at full output, rad.
    overwrite : bool

    Returns
    -------
    Path
        The folder, with ``maneuver.toml`` (of a pilot ``maneuver_1.toml`` and so on) for :func:`load_maneuver`.

    Raises
    ------
    StoopError
        The target cannot fly the maneuver, or the folder cannot be written.
    """
    flight = flight_files(proposal, target, throws) if target is not None else {}
    write_proposal(proposal, Path(folder), "stoop.design(...)", overwrite, flight)
    return Path(folder)


def write_proposal(
    proposal: Proposal,
    folder: Path,
    command: str,
    overwrite: bool = False,
    flight: Mapping[str, str] | None = None,
) -> None:
    """Write maneuver files, a table of deflections, the page and the numbers; all or none.

    ``flight`` are further files, as of :func:`flight_files`; those of the design that is replaced go with it.

    Raises `OutputError`: the folder cannot be made, or holds a design already; or a file cannot be written.
    """
    from stoop.extend.reports import sheet
    from stoop_plan.report import design_sheet

    flight = flight or {}
    best = proposal.best.maneuver
    deflections = best.deflections()  # from the trim, rad; on rotors in the unit of the command
    units = {control: Maneuver.unit_of(control).replace("/", "_") for control in deflections}
    head = ("time_s", *(f"{control}_{unit}" for control, unit in units.items()))
    rows = zip(best.time, *deflections.values(), strict=True)
    cells = ([f"{t:.6g}", *(f"{value:.9g}" for value in values)] for t, *values in rows)
    retrim = proposal.setup.retrim
    maneuvers = {
        **maneuver_files("maneuver", best, retrim, f"designed: {command}"),
        **maneuver_files("reference", proposal.reference, retrim, "what the design is compared with"),
    }
    files = {
        **flight,
        **maneuvers,
        "maneuver.csv": csv_text(head, cells, "\n"),
        "design.html": sheet.render_sheet(design_sheet(proposal, command, flight)),
        "design.json": to_json(
            {**design_document(proposal), "maneuvers": [*maneuvers], "files": [*flight]}, indent=1
        )
        + "\n",
    }
    check_targets(folder, (*files, DESIGN_FILES[-1]), overwrite)
    obsolete = [name for name in _earlier_files(folder) if name not in files]
    write_files(folder, files, obsolete)


def _earlier_files(folder: Path) -> list[str]:
    """Return the maneuvers, and the files for a pilot or an autopilot, that the design in a folder has written."""
    try:
        found = json.loads((folder / DESIGN_FILES[-1]).read_text("utf-8"))
        written, maneuvers = found.get("files", []), found.get("maneuvers", [])
        lines = [name for name in maneuvers if re.fullmatch(r"(maneuver|reference)(_\d+)?\.toml", name)]
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return []
    return lines + [name for target in FLOWN_BY for name in flown_by(target).names if name in written]


def maneuver_files(stem: str, maneuver: Maneuver, retrim: float | None, comment: str) -> dict[str, str]:
    """Return the files of a maneuver, one for each of its flights from trim, as ``stoop simulate`` reads them."""
    flights = flights_from_trim(maneuver, retrim)
    if len(flights) == 1:
        return {f"{stem}.toml": maneuver_toml(maneuver, comment)}
    return {
        f"{stem}_{i}.toml": maneuver_toml(one, f"line {i} of {len(flights)}, from trim -- {comment}")
        for i, one in enumerate(flights, 1)
    }


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
        "airspeed": setup.trim.start.get("V"),
        "altitude": setup.trim.start["h"],
        "duration": plan.duration,
        "band": plan.band,
        "beat": plan.beat,
        "retrim": setup.retrim,
        "limits": {
            "amplitude": dict(limits.amplitude),
            "slew": dict(limits.slew),
            "min_amplitude": dict(limits.min_amplitude),
            "envelope": {c: list(span) for c, span in limits.envelope.items()},
        },
        "shape": proposal.best.shape,
        "refused": dict(proposal.refused),
        "designs": {
            one.shape: {
                "gain": one.gain,
                "ratio": proposal.ratio(one),
                "excess": one.forecast.excess,
                "evaluations": one.evaluations,
            }
            for one in proposal.designs
        },
        "standard_errors": {
            name: {
                "value": float(setup.values[i]),
                **{key: std[i] for key, std in columns.items()},
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
    found: FoundWindows,
    flights: Mapping[str, Flight],
    vehicle: str,
    folder: Path,
    command: str,
    following: Sequence[str],
) -> None:
    """Write `windows.toml` and `windows.html` into a folder; both or none.

    `vehicle` is its name or empty; `following` are the words of the command that takes the file.
    """
    from stoop.extend.reports import sheet
    from stoop_plan.report import windows_sheet

    entries = [
        Entry(
            flight=w.flight, start=w.start, stop=w.stop, accept=w.accept, use=w.use, axis=w.axis, why=w.why,
            information=round(w.information, 3), gain=round(w.gain, 3),
        )
        for w in found.windows
    ]  # fmt: skip
    text = written(entries, shlex.join(following), tuple(map(str, found.notices)))
    page = sheet.render_sheet(windows_sheet(found, flights, vehicle, command, following))
    write_files(folder, {NAME: text, "windows.html": page})

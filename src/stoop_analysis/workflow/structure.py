"""Model structure determination: chosen terms, as a vehicle file, a table of steps and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import tomlkit

from stoop import Flight, Vehicle
from stoop.extend.errors import IdentificationError
from stoop.extend.files import csv_text, write_files
from stoop.extend.fits import AircraftEquations, Layout
from stoop.extend.flights import Window
from stoop.extend.vehicles import EQUATION_1, parse_vehicle, terms
from stoop_analysis.structure import Choose, Domain, Structure, determine, same_term

FILES: Final = ("vehicle.toml", "structure.csv", "structure.html")
HEAD: Final = ("coefficient", "step", "action", "term", "F", "threshold", "terms", "R2", "PRESS", "PSE")


@dataclass(frozen=True, eq=False)
class Determined:
    """A structure and the vehicle that has it."""

    structure: Structure
    vehicle: Vehicle  #: with the chosen terms at their estimates
    names: Mapping[str, Mapping[str, str]]  #: coefficient -> term -> parameter, of what was chosen
    estimates: Mapping[str, tuple[float, float]]  #: estimate and standard error by parameter
    domain: Domain


def structure(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    maneuvers: Sequence[str],
    candidates: Mapping[str, Sequence[str]],
    choose: Choose,
    domain: Domain,
    keep: Sequence[str] = (),
) -> Determined:
    """Choose the terms of a vehicle from maneuvers of flights, and estimate them; parameters of `keep` stay.

    Raises
    ------
    StoopError
        One line that says what is wrong and what to do.
    """
    if vehicle.rotors:
        raise IdentificationError(
            f"{vehicle.where}: it has rotors, and terms are chosen of aerodynamic coefficients only; use stoop identify, "
            "and --fix what it finds at a bound or not identifiable"
        )
    windows = [Window.parse(text, flights) for text in maneuvers]
    found = determine(vehicle, flights, windows, candidates, choose, domain, keep)
    names: dict[str, dict[str, str]] = {}
    taken = {p.name for p in vehicle.parameters}
    # a parameter for each term: the file's own where it has one
    for coefficient, chosen in found.chosen.items():
        own = {n: t.term for n, t in getattr(vehicle.file.aerodynamics, coefficient).items()}
        known = own | {n: t for n, (t, _, _) in EQUATION_1[coefficient].items()}
        group = names[coefficient] = {}
        for term in chosen.terms:
            written = next((n for n, t in known.items() if same_term(t, term)), None)
            group[term] = written or terms.parameter_name(coefficient, term, {*taken, *group.values()})
    shaped = parse_vehicle(_text(vehicle, names, {}), vehicle.where)
    shaped = shaped if shaped.reduce == vehicle.reduce else shaped.reduced(vehicle.reduce)
    # Nothing is free but the chosen terms and the constants beside them.
    wanted = {n for group in names.values() for n in group.values()}
    wanted |= {n for c in names for n, t in shaped.terms[c].items() if t.strip() == "1"}
    freed = shaped.with_numbers({p.name: {"free": p.name in wanted} for p in shaped.parameters})
    equations = AircraftEquations(Layout.of(freed, ()), found.histories)
    fitted = equations.estimate(domain)
    estimates: dict[str, tuple[float, float]] = {}
    if fitted is not None:
        std = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
        pairs = zip(equations.names, fitted.values, std, strict=True)
        estimates = {n: (float(v), float(s)) for n, v, s in pairs}
    values = {n: v for n, (v, _) in estimates.items()}
    final = parse_vehicle(_text(vehicle, names, values), vehicle.where)
    return Determined(found, final, names, estimates, domain)


def _text(vehicle: Vehicle, names: Mapping[str, Mapping[str, str]], values: Mapping[str, float]) -> str:
    """Return the vehicle file with other terms; comments and order stay."""
    document = tomlkit.parse(vehicle.text)
    aerodynamics = document.setdefault("aerodynamics", tomlkit.table(is_super_table=True))
    for coefficient, group in names.items():
        if coefficient not in aerodynamics:
            aerodynamics.add(coefficient, tomlkit.table())
        table = aerodynamics[coefficient]
        own = getattr(vehicle.file.aerodynamics, coefficient)
        for name, term in own.items():
            if term.term.strip() == "1":
                _put(table, name, term.term, values.get(name))
            elif name in group.values():
                continue
            elif vehicle.file.aerodynamics.default and name in EQUATION_1[coefficient]:
                table[name] = False  # else a term of eq. (1) would come back by default
            else:
                del table[name]
        for term, name in group.items():
            _put(table, name, term, values.get(name))
    return tomlkit.dumps(document)


def _put(table: Any, name: str, term: str, value: float | None) -> None:
    """Write a term with its value, free; what else was written of it stays."""
    entry = table.get(name)
    if isinstance(entry, str):
        return  # tied: its value is another's
    number = float(f"{value:.6g}") if value is not None else 0.0
    if isinstance(entry, dict):
        if entry.get("free") is False:
            entry["free"] = True
        if value is not None:
            entry["value"] = number
        if value is not None and "bounds" in entry and not entry["bounds"][0] <= number <= entry["bounds"][1]:
            low, high = (float(b) for b in entry["bounds"])
            entry["bounds"] = [min(low, number - abs(number)), max(high, number + abs(number))]
    elif any(name == n and same_term(t, term) for c in EQUATION_1.values() for n, (t, _, _) in c.items()):
        table[name] = number
    else:  # a term has passed the white list: it holds no quote
        table[name] = tomlkit.parse(f'fresh = {{ term = "{term}", value = {number!r} }}')["fresh"]


def write_structure(found: Determined, folder: Path, command: str) -> None:
    """Write vehicle, table of steps and page into a folder; all or none."""
    from stoop.extend.reports import sheet
    from stoop_analysis.report.structure import structure_sheet

    rows = [
        (
            c, i, s.action, chosen.candidates[s.column], s.f, s.threshold, len(s.model.columns), s.model.r2,
            s.model.press, s.model.pse,
        )
        for c, chosen in found.structure.chosen.items()
        for i, s in enumerate(chosen.selection.steps, 1)
    ]  # fmt: skip
    page = sheet.render_sheet(
        structure_sheet(found.structure, found.vehicle, found.names, found.estimates, command)
    )
    texts = {
        "vehicle.toml": found.vehicle.text,
        "structure.csv": csv_text(HEAD, rows),
        "structure.html": page,
    }
    write_files(folder, texts)

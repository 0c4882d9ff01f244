"""Verbs that analyze flights without a fit: `stoop polar`, `stoop rotors` and `stoop structure`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.extend.errors import FlightError, IdentificationError
from stoop.extend.files import check_targets
from stoop.extend.text import within_limits
from stoop.extend.verbs import LiveLine, column, options, page

if TYPE_CHECKING:
    from stoop import Flight
    from stoop_analysis.performance.effectiveness import Assessment, Hover, Reference

MAX_VOLTAGE_DIFFERENCE = 0.05  #: relative; beyond it a flight is named


def polar(arguments: argparse.Namespace) -> int:
    """Fit a drag polar, write where asked to, and print what was found."""
    from stoop import load_flight
    from stoop.extend.fits import NORMAL_95
    from stoop.extend.flights import spans
    from stoop_analysis.performance.polar import Propulsion
    from stoop_analysis.report.polar import MEANINGS, lift_grid
    from stoop_analysis.workflow.polar import POLAR, drag_polar, write_polar

    folder, others = arguments.output, options.given_paths(arguments.mapping)
    if folder is not None:
        check_targets(folder, POLAR, arguments.overwrite)
    with LiveLine("reading the log"):
        flight = load_flight(arguments.flight, arguments.mapping)
    efficiency, spread = arguments.efficiency
    propulsion = Propulsion(efficiency, spread, arguments.disc)
    used = spans(arguments.window, flight)
    found, notices = drag_polar(flight, arguments.mass, arguments.area, used, propulsion)
    out, summary = page(), found.summary
    out.heading("Polar")
    values, errors = zip(*summary.values(), strict=True)
    meanings = column("meaning", [MEANINGS[name] for name in summary])
    out.table(column("", summary), column("estimate", values), column("std error", errors), meanings)
    CL = lift_grid(found)
    value, std = found.drag(CL)
    low, high = value - NORMAL_95 * std, value + NORMAL_95 * std
    out.heading("Drag coefficient, 95 % interval")
    out.table(column("CL", CL, 1), column("CD", value, 4), column("from", low, 4), column("to", high, 4))
    out.bullets(notices, "What it rests on")
    if folder is not None:
        write_polar(found, notices, flight, folder, options.command_line(), others)
        out.line(f"page: {folder / POLAR[0]}")
    return 0


def rotors(arguments: argparse.Namespace) -> int:
    """Compare flights near hover with healthy ones, and say which rotor gives less than its command says."""
    from stoop import load_flight, load_vehicle
    from stoop.extend.flights import Window
    from stoop.extend.vehicles import foreign_motors
    from stoop_analysis.performance import effectiveness

    chance = arguments.chance
    if chance >= 0.5:
        raise FlightError(
            f"--chance {chance:g}: half of all flights or more; write a small share, such as 0.05"
        )
    paths = [*arguments.flight, *arguments.healthy]
    known = [path.resolve() for path in paths]
    for path in paths:  # it would be compared with itself, or count twice
        if known.count(path.resolve()) > 1:
            raise FlightError(f"{path}: given twice; name each flight once, in question or under --healthy")
    balance = effectiveness.Balance(load_vehicle(arguments.vehicle))
    flights: dict[str, Flight] = {}

    def read_hover(paths: Sequence[Path], watch: LiveLine) -> tuple[Hover, ...]:
        out = []
        for path in paths:
            flight = load_flight(path, arguments.mapping)
            out.append(effectiveness.hover(flight, balance))
            flights[flight.name] = flight
            for found in foreign_motors(balance.vehicle, flight, Window.whole({flight.name: flight})):
                watch.warn(str(found))
        return tuple(out)

    with LiveLine("reading the logs") as watch:
        healthy = read_hover(arguments.healthy, watch)
        flown = read_hover(arguments.flight, watch)
    one = arguments.together and len(flown) > 1
    reference = effectiveness.Reference(balance, healthy, repeats=(flown,) if one else ())
    out, alike = page(), effectiveness.leave_one_out(reference)
    _compare("Healthy flights, each against the others", alike, chance)
    found = [effectiveness.assess(h, reference) for h in flown]
    _compare("Flights in question", found, chance)
    if one:
        together = effectiveness.assess(effectiveness.pooled(flown), reference)
        _compare("All in question as one", [together], chance)
    judged = [effectiveness.judge(f, chance) for f in found]
    notes = {
        "What it rests on": _notes(reference, flown, chance),
        "What would make it sharper": [
            str(one) for one in effectiveness.advice(reference, flown, judged, chance)
        ],
    }
    for title, items in notes.items():
        out.bullets(items, title)
    if arguments.output is not None:
        from stoop.extend.reports import sheet
        from stoop_analysis.report.rotors import rotors_sheet

        page_of_rotors = rotors_sheet(alike, found, flights, notes, chance, options.command_line())
        sheet.write_sheet(page_of_rotors, arguments.output)
        out.line(f"wrote {arguments.output}")
    return 0


def structure(arguments: argparse.Namespace) -> int:
    """Choose, write, and print what was chosen."""
    from stoop import load_vehicle
    from stoop.extend.files import by_name, toml
    from stoop.extend.fits import FrequencyDomain
    from stoop.extend.flights import load_several
    from stoop_analysis.structure import Press, orthogonal, parse_candidates, standard_candidates, stepwise
    from stoop_analysis.workflow.structure import FILES, write_structure
    from stoop_analysis.workflow.structure import structure as determined

    check_targets(arguments.output, FILES, arguments.overwrite)
    low, high = within_limits("band in Hz", arguments.band, 2)
    press = partial(stepwise, criterion=Press())
    criteria: dict[str, Any] = {"f": stepwise, "press": press, "pse": orthogonal}
    vehicle = load_vehicle(arguments.vehicle)
    candidates: dict[str, tuple[str, ...]] = {} if arguments.candidates else standard_candidates(vehicle)
    for text in arguments.candidates:
        lines, where = [text], "--candidates"
        if ":" not in text or Path(text).exists():
            lines, where = toml.read_source(text, "candidates", IdentificationError).splitlines(), text
        for coefficient, terms in parse_candidates(lines, vehicle, where).items():
            candidates[coefficient] = (*candidates.get(coefficient, ()), *terms)
    flights = by_name(load_several(arguments.flight, arguments.mapping), "structure")
    choose = criteria[arguments.criterion]
    domain = FrequencyDomain(low, high)
    with LiveLine(options.COMPILING):
        found = determined(vehicle, flights, arguments.maneuver, candidates, choose, domain, arguments.keep)
    write_structure(found, arguments.output, options.command_line())

    out, nothing = page(), (float("nan"),) * 2
    for coefficient, chosen in found.structure.chosen.items():
        share = f"{len(chosen.terms)} of {len(chosen.candidates)} candidates"
        out.heading(f"{coefficient}: {share}, R2 {chosen.selection.model.r2:.3f}")
        names = found.names[coefficient]
        values = [found.estimates.get(name, nothing) for name in names.values()]
        estimates = column("estimate", [value for value, _ in values])
        errors = column("std error", [error for _, error in values])
        out.table(column("term", names), column("parameter", names.values()), estimates, errors)
    of_terms = [n for chosen in found.structure.chosen.values() for n in chosen.notices]
    out.bullets([*of_terms, *found.structure.notices], "notes")
    out.line()
    out.line(f"page: {arguments.output / 'structure.html'}")
    made = arguments.output / "vehicle.toml"
    out.command("next: ", options.identify_command(arguments, f"{arguments.output}-result", vehicle=made))
    return 0


def _compare(title: str, found: Sequence[Assessment], chance: float) -> None:
    """Print verdicts, with the rotor whose loss explains most and those that explain it nearly as well."""
    from stoop_analysis.performance.effectiveness import indistinct, judge

    if not found:
        return
    out, suspects, names = page(), [f.suspected for f in found], [(f, indistinct(f)) for f in found]
    out.heading(title)
    named = ["any" if len(n) == len(f.weak) else " or ".join(n) or "none" for f, n in names]
    out.table(
        column("flight", [f.name for f in found]),
        column("suspected", named),
        column("factor", [1.0 - s.size for s in suspects], 3),
        column("std error", [s.std for s in suspects], 3),
        column("chance", [f.chance for f in found], 4),
        column("verdict", [str(judge(f, chance).notice) for f in found], wraps=True),
    )


def _notes(reference: Reference, flown: Sequence[Hover], chance: float) -> list[str]:
    lift, roll, pitch, yaw = (100.0 * float(v) ** 0.5 for v in reference.variances)
    healthy, battery = len(reference.flights), reference.battery
    notes = [
        "suspected: whose loss explains most, and who explains it nearly as well; any: all of them do",
        "factor: thrust and torque per command, against the healthy flights, if the first of them alone has changed",
        f"chance: how often a healthy flight makes any rotor this suspect; a rotor is accused below {chance:g}",
        f"between healthy flights lift scatters by {lift:.1f} %, roll and pitch by {roll:.1f} % and {pitch:.1f} % of "
        f"weight times arm, yaw by {yaw:.1f} % of the rotors' torque ({healthy} flight{'s' * (healthy > 1)}, and what is usual)",
        "a weak propeller and a mass near it differ in the yaw balance alone; what hangs in the wake of a rotor changes it too",
    ]
    if math.isfinite(reference.voltage):
        notes.append(
            f"commanded lift goes with the voltage by {battery.slope:.2f} ± {battery.std:.2f} (relative to relative); "
            "this is taken off"
        )
    far = [h.name for h in flown if abs(h.voltage / reference.voltage - 1.0) > MAX_VOLTAGE_DIFFERENCE]
    if far:
        notes.append(
            f"{', '.join(far)}: the battery's voltage is more than {100.0 * MAX_VOLTAGE_DIFFERENCE:.0f} % from that of the "
            "healthy flights; compare flights on equal charge"
        )
    return notes

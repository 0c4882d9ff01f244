"""`stoop rotors`: which rotor gives less than its command says, from flights near hover."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.cli.arguments import add_mapping
from stoop.cli.numbers import positive
from stoop.cli.page import Page, page
from stoop.cli.progress import Watch
from stoop.errors import FlightError

if TYPE_CHECKING:
    from stoop.estimate.effectiveness import Assessment, Balance, Hover, Reference

CHANCE = 0.05
MAX_VOLTAGE_DIFFERENCE = 0.05  #: relative; beyond it a flight is named


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    healthy = (
        "logs of flights near hover of the same vehicle while all was well; three or more are better than one"
    )
    one = "the flights in question are of one and the same configuration"
    add(
        "flight",
        metavar="FLIGHT",
        type=Path,
        nargs="+",
        help="logs of flights near hover that are in question",
    )
    add("--healthy", metavar="FLIGHT", type=Path, nargs="+", required=True, help=healthy)
    add("--vehicle", metavar="V", required=True, help="vehicle file with rotors, or a built-in name")
    add("--together", action="store_true", help=one)
    chance = "how often a healthy flight may be accused (default: 0.05)"
    add("--chance", metavar="P", type=positive, default=CHANCE, help=chance)
    add_mapping(parser)


def run(arguments: argparse.Namespace) -> int:
    """Compare, and say what each flight shows."""
    from stoop.estimate.effectiveness import Balance, Reference, advice, assess, judge, leave_one_out, pooled
    from stoop.vehicle.builtin import resolve_vehicle

    if arguments.chance >= 0.5:
        raise FlightError(
            f"--chance {arguments.chance:g}: half of all flights or more; write a small share, such as 0.05"
        )
    _check_once([*arguments.flight, *arguments.healthy])
    balance = Balance(resolve_vehicle(arguments.vehicle))
    with Watch("reading the logs") as watch:
        healthy = _hovers(arguments.healthy, balance, arguments.mapping, watch)
        flown = _hovers(arguments.flight, balance, arguments.mapping, watch)
    one = arguments.together and len(flown) > 1
    reference = Reference(balance, healthy, repeats=(flown,) if one else ())
    out = page()
    _compare(out, "Healthy flights, each against the others", leave_one_out(reference), arguments.chance)
    found = [assess(h, reference) for h in flown]
    _compare(out, "Flights in question", found, arguments.chance)
    if one:
        _compare(out, "All in question as one", [assess(pooled(flown), reference)], arguments.chance)
    out.heading("What it rests on")
    out.bullets(_notes(reference, flown, arguments.chance))
    advised = advice(reference, flown, [judge(f, arguments.chance) for f in found], arguments.chance)
    if advised:
        out.heading("What would make it sharper")
        out.bullets(map(str, advised))
    return 0


def _check_once(paths: Sequence[Path]) -> None:
    """Refuse a flight that would be compared with itself, or count twice."""
    known = [path.resolve() for path in paths]
    for path in paths:
        if known.count(path.resolve()) > 1:
            raise FlightError(f"{path}: given twice; name each flight once, in question or under --healthy")


def _hovers(paths: Sequence[Path], balance: Balance, mapping: Path | None, watch: Watch) -> tuple[Hover, ...]:
    from stoop.checks.vehicle import foreign_motors
    from stoop.estimate.effectiveness import hover
    from stoop.flight import load
    from stoop.problem.windows import whole

    out = []
    for path in paths:
        flight = load(path, mapping)
        out.append(hover(flight, balance))
        for found in foreign_motors(balance.vehicle, flight, whole({flight.name: flight})):
            watch.warn(str(found))
    return tuple(out)


def _compare(out: Page, title: str, found: Sequence[Assessment], chance: float) -> None:
    from stoop.cli.tables import fixed, words
    from stoop.estimate.effectiveness import judge

    if not found:
        return
    out.heading(title)
    suspects = [f.suspected for f in found]
    out.table(
        [
            words("flight", [f.name for f in found]),
            words("suspected", [_named(f) for f in found]),
            fixed("factor", [1.0 - s.size for s in suspects], 3),
            fixed("std error", [s.std for s in suspects], 3),
            fixed("chance", [f.chance for f in found], 4),
            words("verdict", [str(judge(f, chance).notice) for f in found], wraps=True),
        ]
    )


def _named(found: Assessment) -> str:
    """Name the rotor whose loss explains most, and with it those that explain it nearly as well."""
    from stoop.estimate.effectiveness import indistinct

    names = indistinct(found)
    if len(names) == len(found.weak):
        return "any"
    return " or ".join(names) or "none"


def _notes(reference: Reference, flown: Sequence[Hover], chance: float) -> list[str]:
    lift, roll, pitch, yaw = (100.0 * float(v) ** 0.5 for v in reference.variances)
    count = len(reference.hovers)
    battery = reference.battery
    notes = [
        "suspected: whose loss explains most, and who explains it nearly as well; any: all of them do",
        "factor: thrust and torque per command, against the healthy flights, if the first of them alone has changed",
        f"chance: how often a healthy flight makes any rotor this suspect; a rotor is accused below {chance:g}",
        f"between healthy flights lift scatters by {lift:.1f} %, roll and pitch by {roll:.1f} % and {pitch:.1f} % of "
        f"weight times arm, yaw by {yaw:.1f} % of the rotors' torque ({count} flight{'s' * (count > 1)}, and what is usual)",
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

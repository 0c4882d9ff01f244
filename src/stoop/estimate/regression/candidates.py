"""Candidate terms: what a coefficient may depend on."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from stoop.errors import IdentificationError
from stoop.vehicle import Vehicle, terms
from stoop.vehicle.defaults import COEFFICIENTS

SYMMETRIC: Final = ("CL", "CD", "Cm")
MOST: Final = 200  #: candidates of one coefficient
_WORD: Final = re.compile(r"[^A-Za-z0-9]+")


def standard(vehicle: Vehicle) -> dict[str, tuple[str, ...]]:
    """Return the candidates that are tried unless others are given, by coefficient.

    Lift, drag and pitching moment: angle of attack up to the third power, pitch rate, speed, every control,
    their products with angle of attack, and the even part of sideslip. Side force, rolling and yawing moment:
    sideslip, roll and yaw rate, every control, their products with angle of attack, and sideslip cubed.
    """
    controls = vehicle.controls
    along = ("alpha", "q", "V", *controls, "alpha^2", "alpha^3", "alpha*q")
    across = ("beta", "p", "r", *controls, "alpha*beta", "alpha*p", "alpha*r", "beta^3")
    by_alpha = tuple(f"alpha*{c}" for c in controls)
    even = ("beta^2",) if vehicle.reduce == "full" else ()
    kinds = {True: (*along, *by_alpha, *even), False: (*across, *by_alpha)}
    return {c: kinds[c in SYMMETRIC] for c in COEFFICIENTS}


def given(lines: Iterable[str], vehicle: Vehicle, where: str) -> dict[str, tuple[str, ...]]:
    """Return candidates written as ``Cm: alpha, q, alpha^2``; coefficients not named have none.

    Raises
    ------
    IdentificationError
        A line of another form, or a coefficient that does not exist.
    TermError
        A term that cannot be read.
    """
    names = {*terms.STATE_VARIABLES, *vehicle.file.controls}
    out: dict[str, tuple[str, ...]] = {}
    for line in lines:
        text = line.partition("#")[0].strip()
        if not text:
            continue
        coefficient, colon, rest = (part.strip() for part in text.partition(":"))
        if not colon or coefficient not in COEFFICIENTS:
            raise IdentificationError(
                f"{where}: cannot read '{text[:60]}'; write a line per coefficient, e.g. Cm: alpha, q, elevator, alpha^2"
            )
        found = tuple(dict.fromkeys(t.strip() for t in rest.split(",") if t.strip()))
        for term in found:
            terms.parse(term, names, f"{where}: {coefficient}")
        out[coefficient] = (*out.get(coefficient, ()), *found)
    _check(out, where)
    return out


def _check(found: Mapping[str, Sequence[str]], where: str) -> None:
    if not any(found.values()):
        raise IdentificationError(f"{where}: names no candidate; write e.g. Cm: alpha, q, elevator, alpha^2")
    for coefficient, texts in found.items():
        if len(texts) > MOST:
            raise IdentificationError(f"{where}: {coefficient}: more than {MOST} candidates; leave some out")


def parameter_name(coefficient: str, term: str, taken: Iterable[str] = ()) -> str:
    """Return the name of a term's parameter: ``CLalpha2`` for ``alpha^2``, ``Cmalphaelevator`` for a product."""
    base = (coefficient + _WORD.sub("", term.replace("^", "")))[:36]
    used, name, number = set(taken), base, 2
    while name in used:
        name, number = f"{base}_{number}", number + 1
    return name

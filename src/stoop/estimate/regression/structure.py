"""Model structure determination: candidate terms of each coefficient, and those that flights need."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.sparse.csgraph import connected_components

from stoop.base.notices import Notice, notice
from stoop.errors import IdentificationError
from stoop.estimate.regression.aircraft import COEFFICIENTS, History, histories
from stoop.estimate.regression.domain import Domain
from stoop.estimate.regression.selection import TOLERANCE, Model, Regression, Selection
from stoop.flight import Flight
from stoop.problem.prepare import prepare, without_stuck_channels
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle, defaults, terms

Choose = Callable[[Regression], Selection]
SYMMETRIC: Final = ("CL", "CD", "Cm")
MAX_CANDIDATES: Final = 200  #: of one coefficient
CORRELATION_LIMIT: Final = 0.95  #: above, the data hardly distinguish two candidates
FAIR_R2: Final = 0.5  #: below, what was chosen is no structure
MIN_ROWS: Final = 3
NOT_MEASURED: Final = (
    "airspeed, flow angles, rates, attitude and accelerations must be measured together, for "
    "longer than a few periods of the lowest frequency; choose other windows"
)
_NOT_A_WORD: Final = re.compile(r"[^A-Za-z0-9]+")


def standard_candidates(vehicle: Vehicle) -> dict[str, tuple[str, ...]]:
    """Return the candidates by coefficient that are tried unless others are given.

    Lift, drag and pitching moment: angle of attack up to the third power, pitch rate, speed, every control,
    their products with angle of attack, and the even part of sideslip. Side force, rolling and yawing moment:
    sideslip, roll and yaw rate, every control, their products with angle of attack, and sideslip cubed.
    """
    controls = vehicle.controls
    longitudinal = ("alpha", "q", "V", *controls, "alpha^2", "alpha^3", "alpha*q")
    lateral = ("beta", "p", "r", *controls, "alpha*beta", "alpha*p", "alpha*r", "beta^3")
    products = tuple(f"alpha*{c}" for c in controls)
    even = ("beta^2",) if vehicle.reduce == "full" else ()
    kinds = {True: (*longitudinal, *products, *even), False: (*lateral, *products)}
    return {c: kinds[c in SYMMETRIC] for c in defaults.COEFFICIENTS}


def parse_candidates(lines: Iterable[str], vehicle: Vehicle, where: str) -> dict[str, tuple[str, ...]]:
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
        if not colon or coefficient not in defaults.COEFFICIENTS:
            raise IdentificationError(
                f"{where}: cannot read '{text[:60]}'; write a line per coefficient, e.g. Cm: alpha, q, elevator, alpha^2"
            )
        found = tuple(dict.fromkeys(t.strip() for t in rest.split(",") if t.strip()))
        for term in found:
            terms.parse(term, names, f"{where}: {coefficient}")
        out[coefficient] = (*out.get(coefficient, ()), *found)
        if len(out[coefficient]) > MAX_CANDIDATES:
            raise IdentificationError(
                f"{where}: {coefficient}: more than {MAX_CANDIDATES} candidates; leave some out"
            )
    if not any(out.values()):
        raise IdentificationError(f"{where}: names no candidate; write e.g. Cm: alpha, q, elevator, alpha^2")
    return out


def parameter_name(coefficient: str, term: str, taken: Iterable[str] = ()) -> str:
    """Return the name of a term's parameter: ``CLalpha2`` for ``alpha^2``, ``Cmalphaelevator`` for a product."""
    base = (coefficient + _NOT_A_WORD.sub("", term.replace("^", "")))[:36]
    used, name, number = set(taken), base, 2
    while name in used:
        name, number = f"{base}_{number}", number + 1
    return name


def parents(trees: Sequence[ast.expr]) -> tuple[tuple[int, ...], ...]:
    """Return for each term the places of the plain variables that it is a product or power of (marginality).

    `alpha^3` without `alpha` would become a model with both at another reference angle. Variables that are no candidates
    are not asked for, so an even function stays possible: `beta^2` in lift. What is no monomial, such as `abs(beta)`,
    has none.
    """
    plain = {tree.id: i for i, tree in enumerate(trees) if isinstance(tree, ast.Name)}
    powers = [_powers(tree) for tree in trees]
    return tuple(
        () if p is None or p.total() < 2 else tuple(sorted(plain[name] for name in p if name in plain))
        for p in powers
    )


def _powers(tree: ast.expr) -> Counter[str] | None:
    """Return the exponents of a monomial; None for anything else."""
    match tree:
        case ast.Name(id=name):
            return Counter({name: 1})
        case ast.Constant():
            return Counter()
        case ast.UnaryOp(operand=inner):
            return _powers(inner)
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            a, b = _powers(left), _powers(right)
            return None if a is None or b is None else a + b
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int(power))) if power > 0:
            base = _powers(left)
            return None if base is None else Counter({n: e * power for n, e in base.items()})
    return None


@dataclass(frozen=True, eq=False)
class ChosenTerms:
    """The terms of one coefficient.

    Attributes
    ----------
    candidates : tuple of str
        Those that moved.
    selection : Selection
        Its columns are places in `candidates`.
    notices : tuple of Notice
        Candidates that the flights hardly distinguish, or do not contain.
    """

    candidates: tuple[str, ...]
    selection: Selection
    notices: tuple[Notice, ...]

    @property
    def terms(self) -> tuple[str, ...]:
        """The chosen terms, in the order of the candidates."""
        return tuple(self.candidates[i] for i in sorted(self.selection.model.columns))


@dataclass(frozen=True, eq=False)
class Structure:
    """The terms of each coefficient that had candidates, and the histories that they were chosen on."""

    chosen: Mapping[str, ChosenTerms]
    histories: tuple[History, ...]
    notices: tuple[Notice, ...]


def determine(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    candidates: Mapping[str, Sequence[str]],
    choose: Choose,
    domain: Domain,
) -> Structure:
    """Choose terms among candidates; a constant is always there.

    Parameters
    ----------
    vehicle : Vehicle
        Mass, geometry, thrust, controls and instruments count; of its terms only those of coefficients that a
        reduced model takes as they are.
    flights, windows
        As for `stoop.estimate.fit.fit`.
    candidates : mapping of str to sequence of str
        Coefficient -> terms; those of coefficients that are not estimated are ignored.
    choose : callable
        From a regression to a selection, such as `stepwise`.
    domain : Domain

    Raises
    ------
    IdentificationError
        The motion was not measured, or for too short a time.
    """
    prepared = without_stuck_channels(vehicle, prepare(vehicle, flights, windows))
    found = tuple(h for piece in prepared.pieces for h in histories(vehicle, piece))
    if not found:
        raise IdentificationError(f"{vehicle.where}: no coefficient can be computed: {NOT_MEASURED}")
    estimated = [c for c in COEFFICIENTS[vehicle.reduce] if candidates.get(c)]
    if not estimated:
        raise IdentificationError(
            f"{vehicle.where}: no coefficient of the {vehicle.reduce} model has a candidate; "
            f"name some of {', '.join(COEFFICIENTS[vehicle.reduce])}"
        )
    chosen = {c: _chosen(vehicle, c, tuple(candidates[c]), found, choose, domain) for c in estimated}
    return Structure(chosen, found, prepared.notices)


def _chosen(
    vehicle: Vehicle, coefficient: str, candidates: tuple[str, ...], found: Sequence[History],
    choose: Choose, domain: Domain,
) -> ChosenTerms:  # fmt: skip
    names = {*terms.STATE_VARIABLES, *vehicle.file.controls}
    trees = [terms.parse(text, names, coefficient) for text in candidates]
    for text, tree in zip(candidates, trees, strict=True):
        unknown = terms.variables(tree) - set(found[0].variables)
        if unknown:  # a control that the equations lack: its deflection is not known
            raise IdentificationError(
                f"{vehicle.where}: {coefficient}: candidate {text}: no term of the file has {min(unknown)}, so its channel "
                "is not read; add one with value 0"
            )
    signals = [np.column_stack([h.coefficients[coefficient], *map(h.regressor, candidates)]) for h in found]
    whole = Regression.of(signals, domain, found[0].dt)
    if whole.count < MIN_ROWS:
        raise IdentificationError(
            f"{vehicle.where}: {coefficient}: the windows are too short: {NOT_MEASURED}"
        )
    constant = np.linalg.norm(whole.X, axis=0) <= 1e-9 * np.sqrt(whole.count)
    moving = tuple(np.flatnonzero(~constant).tolist())
    kept = tuple(candidates[i] for i in moving)
    regression = replace(whole, X=whole.X[:, moving], parents=parents([trees[i] for i in moving]))
    selection = choose(regression)
    notices = []
    if constant.any():
        still = tuple(c for c, s in zip(candidates, constant, strict=True) if s)
        notices.append(notice("candidate-constant", coefficient, terms=still))
    notices += _indistinct(coefficient, kept, regression)
    if selection.model.r2 < FAIR_R2:
        notices.append(notice("structure-low-r-squared", coefficient, r2=max(selection.model.r2, 0.0)))
    return ChosenTerms(kept, selection, tuple(notices))


def _indistinct(coefficient: str, names: Sequence[str], regression: Regression) -> list[Notice]:
    """Return which candidates are so nearly collinear that the choice among them is arbitrary."""
    correlation = np.abs(np.corrcoef(regression.X, rowvar=False).reshape(len(names), len(names)))
    groups, member = connected_components(correlation > CORRELATION_LIMIT, directed=False)
    out = []
    for places in (np.flatnonzero(member == g) for g in range(groups)):
        if len(places) > 1:
            least = float(np.min(correlation[np.ix_(places, places)]))
            alike = tuple(names[int(i)] for i in places)
            out.append(notice("candidates-correlated", coefficient, terms=alike, correlation=least))
    every = range(len(names))
    others = {i: tuple(j for j in every if j != i) for i in every}
    spanned = tuple(
        names[i]
        for i in every
        if len(others[i]) < regression.count and Model(regression, others[i]).tolerance(i) < TOLERANCE
    )
    if spanned:
        out.append(notice("candidates-collinear", coefficient, terms=spanned, share=1.0 - TOLERANCE))
    return out

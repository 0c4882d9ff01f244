"""Which terms each coefficient of a vehicle needs, from flights."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError
from stoop.estimate.regression import hierarchy
from stoop.estimate.regression.domain import Domain
from stoop.estimate.regression.history import ESTIMATED, History, histories
from stoop.estimate.regression.rows import Model, Rows, stack
from stoop.estimate.regression.selection import TOLERANCE, Selection
from stoop.flight import Flight
from stoop.problem import Piece
from stoop.problem.prepare import prepare, without_stuck_channels
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle, terms

Choose = Callable[[Rows], Selection]
ALIKE: Final = 0.95  #: correlation above which the data hardly tell two candidates apart
FAIR: Final = 0.5  #: of the motion explained; less is no structure
FEWEST_ROWS: Final = 3  #: times the candidates
UNMEASURED: Final = (
    "airspeed, flow angles, rates, attitude and accelerations must be measured together, for "
    "longer than a few periods of the lowest frequency; choose other windows"
)


@dataclass(frozen=True, eq=False)
class Chosen:
    """What was found of one coefficient.

    Attributes
    ----------
    candidates : tuple of str
    selection : Selection
        Its columns are places in `candidates`.
    notes : tuple of str
        Candidates that the flights hardly tell apart, or do not contain.
    """

    candidates: tuple[str, ...]
    selection: Selection
    notes: tuple[str, ...]

    @property
    def terms(self) -> tuple[str, ...]:
        """The terms that were chosen, in the order of the candidates."""
        return tuple(self.candidates[i] for i in sorted(self.selection.model.columns))


@dataclass(frozen=True, eq=False)
class Structure:
    """The terms of each coefficient that had candidates, and the histories that they were chosen on."""

    chosen: Mapping[str, Chosen]
    histories: tuple[History, ...]
    notes: tuple[str, ...]


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
        Coefficient -> terms; those of coefficients that are not estimated are passed over.
    choose : callable
        From the rows of a regression to a selection, such as `stepwise`.
    domain : Domain

    Raises
    ------
    IdentificationError
        The motion was not measured, or for too short a time.
    """
    prepared = without_stuck_channels(vehicle, prepare(vehicle, flights, windows))
    found = all_histories(vehicle, prepared.pieces)
    known = [c for c in ESTIMATED[vehicle.reduce] if candidates.get(c)]
    if not known:
        raise IdentificationError(
            f"{vehicle.where}: no coefficient of the {vehicle.reduce} model has a candidate; "
            f"name some of {', '.join(ESTIMATED[vehicle.reduce])}"
        )
    _check_variables(vehicle, {c: candidates[c] for c in known}, found[0])
    chosen = {c: _chosen(vehicle, c, tuple(candidates[c]), found, choose, domain) for c in known}
    return Structure(chosen, found, tuple(dict.fromkeys(map(str, prepared.notices))))


def _check_variables(vehicle: Vehicle, candidates: Mapping[str, Sequence[str]], history: History) -> None:
    """Refuse candidates of a control that the vehicle's equations do not have: its deflection is not known."""
    names = {*terms.STATE_VARIABLES, *vehicle.file.controls}
    for coefficient, texts in candidates.items():
        for text in texts:
            unknown = terms.variables(terms.parse(text, names, coefficient)) - set(history.variables)
            if unknown:
                raise IdentificationError(
                    f"{vehicle.where}: {coefficient}: candidate {text}: no term of the file has {min(unknown)}, so its channel "
                    "is not read; add one with value 0"
                )


def all_histories(vehicle: Vehicle, pieces: Sequence[Piece]) -> tuple[History, ...]:
    """Return the histories of all pieces.

    Raises
    ------
    IdentificationError
        There are none.
    """
    found = tuple(h for piece in pieces for h in histories(vehicle, piece))
    if not found:
        raise IdentificationError(f"{vehicle.where}: no coefficient can be computed: {UNMEASURED}")
    return found


def _chosen(
    vehicle: Vehicle, coefficient: str, candidates: tuple[str, ...], found: Sequence[History],
    choose: Choose, domain: Domain,
) -> Chosen:  # fmt: skip
    signals = [np.column_stack([h.coefficients[coefficient], *map(h.regressor, candidates)]) for h in found]
    rows = stack(signals, domain, found[0].dt)
    if rows.count < FEWEST_ROWS:
        raise IdentificationError(f"{vehicle.where}: {coefficient}: the windows are too short: {UNMEASURED}")
    still = np.linalg.norm(rows.X, axis=0) <= 1e-9 * np.sqrt(rows.count)
    moving = tuple(np.flatnonzero(~still).tolist())
    names = tuple(candidates[i] for i in moving)
    known = {*terms.STATE_VARIABLES, *vehicle.file.controls}
    parents = hierarchy.parents([terms.parse(name, known, coefficient) for name in names])
    reduced = replace(rows, X=rows.X[:, moving], parents=parents)
    selection = choose(reduced)
    notes = (
        *_still(coefficient, candidates, still), *_alike(coefficient, names, reduced),
        *_little(coefficient, selection.model.r2),
    )  # fmt: skip
    return Chosen(names, selection, notes)


def _little(coefficient: str, share: float) -> list[str]:
    """Say when what was chosen explains little: terms are missing among the candidates, or in the inputs."""
    if share >= FAIR:
        return []
    return [
        f"{coefficient}: the chosen terms explain {max(share, 0.0):.0%} of its motion only, so this is not its structure: "
        "larger inputs about its axis, a wider band, other candidates, or channels and inertia that are right"
    ]


def _still(coefficient: str, candidates: Sequence[str], still: NDArray[np.bool_]) -> list[str]:
    names = [c for c, s in zip(candidates, still, strict=True) if s]
    return [f"{coefficient}: {', '.join(names)} did not move; nothing can be said of it"] if names else []


def _alike(coefficient: str, names: Sequence[str], rows: Rows) -> list[str]:
    """Say which candidates go together so closely that choosing one of them is luck."""
    correlation = np.corrcoef(rows.X, rowvar=False).reshape(len(names), len(names))
    said = [
        f"{coefficient}: {', '.join(names[i] for i in group)} move together (correlation {_least(correlation, group):.2f} or "
        "more); these flights hardly tell which is needed"
        for group in _groups(np.abs(correlation) > ALIKE)
    ]
    spanned = [names[i] for i in range(len(names)) if _spanned(rows, i)]
    if spanned:
        said.append(
            f"{coefficient}: {', '.join(spanned)}: more than {1.0 - TOLERANCE:.0%} of it is a combination of the other "
            "candidates; move the controls independently, or set reference.alpha to the mean angle of attack"
        )
    return said


def _groups(alike: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return the places that are alike, directly or by way of others, group by group."""
    count, member = connected_components(alike, directed=False)
    groups = [np.flatnonzero(member == g) for g in range(count)]
    return [group for group in groups if len(group) > 1]


def _least(correlation: FloatArray, group: NDArray[np.intp]) -> float:
    return float(np.min(np.abs(correlation[np.ix_(group, group)])))


def _spanned(rows: Rows, column: int) -> bool:
    others = tuple(i for i in range(rows.X.shape[1]) if i != column)
    return len(others) < rows.count and Model(rows, others).tolerance(column) < TOLERANCE

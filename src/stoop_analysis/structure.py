"""Model structure determination: candidate terms of each coefficient, and those that flights need.

A product or power enters after the variables that it is made of, which stay as long as it does (marginality).

References
----------
J. A. Nelder, "A reformulation of linear models", Journal of the Royal Statistical Society A 140(1), 1977 (marginality).
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016,
sections 5.4 and 5.5.
E. A. Morelli, "Global nonlinear aerodynamic modeling using multivariate orthogonal functions", *Journal of
Aircraft* 32(2), 1995, pp. 270-277.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np
from scipy.sparse.csgraph import connected_components

from stoop import Flight, Notice, Vehicle
from stoop.extend import fits
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import IdentificationError
from stoop.extend.fits import History
from stoop.extend.flights import Window
from stoop.extend.notices import notice
from stoop.extend.text import nearest
from stoop.extend.vehicles import COEFFICIENTS, terms

Domain: TypeAlias = fits.TimeDomain | fits.FrequencyDomain
MAX_STEPS: Final = 200
MIN_TOLERANCE: Final = 0.01  #: share of a candidate that is new (variance inflation of 100)
ROWS_PER_TERM: Final = 3  #: that elimination from all candidates needs
MAX_CANDIDATES: Final = 200  #: of one coefficient
CORRELATION_LIMIT: Final = 0.95  #: above, the data hardly distinguish two candidates
FAIR_R2: Final = 0.5  #: below, what was chosen is no structure
MIN_ROWS: Final = 3
#: standard errors by which a neighbor moves with a term that was left out: more is a bias to report
MIN_MOVE: Final = 1.0
NOT_MEASURED: Final = (
    "airspeed, flow angles, rates, attitude and accelerations must be measured together, for "
    "longer than a few periods of the lowest frequency; choose other windows"
)


@dataclass(frozen=True, eq=False)
class Regression:
    """One coefficient and its candidate terms; constants are removed, by the domain or by the mean."""

    y: FloatArray  #: (n,)
    X: FloatArray  #: (n, k), a column per candidate
    stretches: tuple[slice, ...]  #: rows of one record each: residuals are correlated within them
    dt: float  #: s
    domain: Domain
    spent: int = 0  #: degrees of freedom that the constant took
    #: for each column those of the variables that it is a product or power of; empty without marginality
    parents: tuple[tuple[int, ...], ...] = ()
    kept: tuple[int, ...] = ()  #: columns that are in every model

    @classmethod
    def of(cls, signals: Sequence[FloatArray], domain: Domain, dt: float) -> Regression:
        """Return the regression on signals (n, 1 + k) of several stretches, y first."""
        rows = [r for s in signals if len(r := domain.rows(s, dt))]
        whole = np.concatenate(rows) if rows else np.empty((0, signals[0].shape[1]))
        edges = np.cumsum([0, *(len(r) for r in rows)])
        if domain.keeps_constants and len(whole):
            whole = whole - whole.mean(axis=0)
        stretches = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
        return cls(whole[:, 0], whole[:, 1:], stretches, dt, domain, int(domain.keeps_constants))

    @cached_property
    def total(self) -> float:
        """Sum of squares of y."""
        return float(self.y @ self.y)

    @property
    def count(self) -> int:
        """Number of rows."""
        return len(self.y)

    def parents_of(self, column: int) -> tuple[int, ...]:
        """Return the columns that a column needs beside it."""
        return self.parents[column] if self.parents else ()


@dataclass(frozen=True, eq=False)
class Model:
    """Least squares on some columns of a regression."""

    regression: Regression
    columns: tuple[int, ...]

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis (n, p) of the model's columns."""
        return np.asarray(np.linalg.qr(self.regression.X[:, self.columns])[0])

    @cached_property
    def residual(self) -> FloatArray:
        """Residuals (n,)."""
        return self.regression.y - self.basis @ (self.basis.T @ self.regression.y)

    @cached_property
    def rss(self) -> float:
        """Sum of squared residuals."""
        return float(self.residual @ self.residual)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.regression.count - len(self.columns) - self.regression.spent

    @property
    def r2(self) -> float:
        """Coefficient of determination."""
        return 1.0 - self.rss / self.regression.total if self.regression.total > 0.0 else 0.0

    @property
    def press(self) -> float:
        """Prediction sum of squares of e_i / (1 - h_ii), each row left out (D. M. Allen, Technometrics 16(1), 1974)."""
        leverage = np.sum(self.basis**2, axis=1) + self.regression.spent / max(self.regression.count, 1)
        return float(np.sum((self.residual / np.maximum(1.0 - leverage, 1e-12)) ** 2))

    @property
    def pse(self) -> float:
        """Predicted squared error: a penalty per term for the largest noise (J. Aircraft 32(6), 1995, eqs. 27 to 29)."""
        max_noise = self.regression.total / max(self.regression.count, 1)
        return (self.rss + max_noise * len(self.columns)) / self.regression.count

    def orthogonal_part(self, column: int) -> FloatArray:
        """Return the part (n,) of a column that the model's columns do not span."""
        x = self.regression.X[:, column]
        for _ in range(2):  # twice, against rounding
            x = x - self.basis @ (self.basis.T @ x)
        return np.asarray(x)

    def tolerance(self, column: int) -> float:
        """Return the share of a column that the model's columns do not span; one over its variance inflation."""
        x, part = self.regression.X[:, column], self.orthogonal_part(column)
        size = float(x @ x)
        return float(part @ part) / size if size > 0.0 else 0.0

    def admits(self, column: int) -> bool:
        """Whether a column is new to the model, and all its parents are in it."""
        parents = set(self.regression.parents_of(column))
        return parents <= set(self.columns) and self.tolerance(column) >= MIN_TOLERANCE

    def with_column(self, column: int) -> Model:
        """Return the model with one more term."""
        return Model(self.regression, (*self.columns, column))

    def without(self, column: int) -> Model:
        """Return the model with one term less."""
        return Model(self.regression, tuple(c for c in self.columns if c != column))

    def partial_f(self, column: int) -> float:
        """Return the partial F-ratio of a column of the model: the squared estimate over its variance.

        It is (RSS without - RSS with) over the residual variance where residuals are white (Klein and Morelli, section 5.4).
        """
        r = self.regression
        x = self.without(column).orthogonal_part(column)
        scatters = (r.domain.scatter(x[s, None], self.residual[s], r.dt)[0, 0] for s in r.stretches)
        effect, variance = float(x @ r.y), sum(map(float, scatters))
        inflated = variance * r.count / max(self.freedom, 1)
        return effect**2 / inflated if inflated > 0.0 else (np.inf if effect else 0.0)

    def moves(self, column: int) -> dict[int, float]:
        """Return by how many of its standard errors each column's coefficient moves if another column joins the model."""
        larger, out = self.with_column(column), {}
        values, beside = (
            np.linalg.lstsq(m.regression.X[:, m.columns], m.regression.y)[0] for m in (self, larger)
        )
        for place, value, other in zip(
            self.columns, values, beside, strict=False
        ):  # the joining one is the last
            error = abs(value) / np.sqrt(self.partial_f(place))
            out[place] = float((other - value) / error) if error > 0.0 else np.nan
        return out

    def best_candidate(self) -> int | None:
        """Return the column outside the model that lowers the sum of squares most; None where none is admitted."""
        gains = {}
        for column in range(self.regression.X.shape[1]):
            if column not in self.columns and self.freedom >= 2 and self.admits(column):
                x = self.orthogonal_part(column)
                gains[column] = float(x @ self.regression.y) ** 2 / float(x @ x)
        return max(gains, key=gains.__getitem__) if gains else None


@dataclass(frozen=True, eq=False)
class Step:
    """One step: the term that came or went with its partial F-ratio, the criterion's threshold, and the model after it."""

    action: str  #: "add" or "remove"
    column: int
    f: float
    threshold: float
    model: Model


@dataclass(frozen=True, eq=False)
class Selection:
    """The selected model, columns in the order of entering, and every step there."""

    model: Model
    steps: tuple[Step, ...]


@dataclass(frozen=True)
class PartialF:
    """The partial F-ratio exceeds what the largest of so many needless candidates reaches by chance."""

    significance: float = 0.001  #: chance that any needless candidate of one coefficient gets in (Bonferroni)

    def threshold(self, model: Model) -> float:
        """Return the quantile of F(1, degrees of freedom)."""
        from scipy.stats import f

        return float(f.isf(self.significance / max(model.regression.X.shape[1], 1), 1, max(model.freedom, 1)))

    def needs(self, model: Model, column: int) -> bool:
        """Whether F is above the threshold."""
        return model.partial_f(column) > self.threshold(model)


@dataclass(frozen=True)
class Press:
    """The prediction sum of squares falls with the term."""

    def threshold(self, model: Model) -> float:
        """Return zero: any fall counts."""
        return 0.0

    def needs(self, model: Model, column: int) -> bool:
        """Whether PRESS would rise without the term."""
        return model.press < model.without(column).press


Criterion = PartialF | Press  #: whether a model needs a term


def stepwise(regression: Regression, criterion: Criterion = PartialF()) -> Selection:
    """Add the candidate that explains most, remove what is no longer needed, until nothing changes.

    From no term, and from all candidates: forward selection misses terms that cancel each other (static stability, damping and
    elevator in a slow pitching moment), backward elimination does not. The end with the lower PRESS is kept.
    """
    empty = everything = Model(regression, regression.kept)
    for place in sorted(range(regression.X.shape[1]), key=lambda c: len(regression.parents_of(c)) > 0):
        if place not in regression.kept and everything.admits(place):
            everything = everything.with_column(place)
    enough = regression.count > ROWS_PER_TERM * len(everything.columns)
    ends = []
    for model in (empty, everything) if enough else (empty,):
        model, steps = _eliminated(model, criterion)
        seen = {frozenset(model.columns)}
        while len(steps) < MAX_STEPS and (column := model.best_candidate()) is not None:
            larger = model.with_column(column)
            if not criterion.needs(larger, column):
                break
            added = Step("add", column, larger.partial_f(column), criterion.threshold(larger), larger)
            model, removed = _eliminated(larger, criterion)
            steps += [added, *removed]
            if frozenset(model.columns) in seen:  # a cycle
                break
            seen.add(frozenset(model.columns))
        ends.append(Selection(model, tuple(steps)))
    return min(ends, key=lambda end: end.model.press)


def _eliminated(model: Model, criterion: Criterion) -> tuple[Model, list[Step]]:
    """Remove needless terms, the weakest first."""
    steps = list[Step]()
    while len(model.columns) > len(model.regression.kept):
        needed = {parent for column in model.columns for parent in model.regression.parents_of(column)}
        needed |= set(model.regression.kept)
        if needed >= set(model.columns):
            break
        weakest = min((c for c in model.columns if c not in needed), key=model.partial_f)
        if criterion.needs(model, weakest):
            break
        f, threshold, model = model.partial_f(weakest), criterion.threshold(model), model.without(weakest)
        steps.append(Step("remove", weakest, f, threshold, model))
    return model, steps


def orthogonal(regression: Regression) -> Selection:
    """Order candidates by what each explains beyond those before it; cut where the predicted squared error is least."""
    model, steps = Model(regression, regression.kept), list[Step]()
    kept = model
    while (column := model.best_candidate()) is not None and len(steps) < MAX_STEPS:
        before, model = model, model.with_column(column)
        variance = max(model.rss / max(model.freedom, 1), np.finfo(float).tiny)
        steps.append(Step("add", column, float(before.rss - model.rss) / variance, kept.pse, model))
        kept = model if model.pse < kept.pse else kept
    return Selection(kept, tuple(steps))


Choose = Callable[[Regression], Selection]


def standard_candidates(vehicle: Vehicle) -> dict[str, tuple[str, ...]]:
    """Return the candidates by coefficient that are tried unless others are given."""
    controls, products = vehicle.controls, tuple(f"alpha*{c}" for c in vehicle.controls)
    even = ("beta^2",) if vehicle.reduce == "full" else ()
    longitudinal = ("alpha", "q", "V", *controls, "alpha^2", "alpha^3", "alpha*q", *products, *even)
    lateral = ("beta", "p", "r", *controls, "alpha*beta", "alpha*p", "alpha*r", "beta^3", *products)
    return {c: longitudinal if c in ("CL", "CD", "Cm") else lateral for c in COEFFICIENTS}


def parse_candidates(lines: Iterable[str], vehicle: Vehicle, where: str) -> dict[str, tuple[str, ...]]:
    """Return candidates written as ``Cm: alpha, q, alpha^2``; coefficients not named have none.

    An IdentificationError names a line of another form or an unknown coefficient, a TermError a term that cannot be read.
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
        if len(out[coefficient]) > MAX_CANDIDATES:
            raise IdentificationError(
                f"{where}: {coefficient}: more than {MAX_CANDIDATES} candidates; leave some out"
            )
    if not any(out.values()):
        raise IdentificationError(f"{where}: names no candidate; write e.g. Cm: alpha, q, elevator, alpha^2")
    return out


def parents(trees: Sequence[ast.expr]) -> tuple[tuple[int, ...], ...]:
    """Return for each term the places of the plain variables that it is a product or power of (marginality).

    Variables that are no candidates are not asked for, so an even function stays possible: `beta^2` in lift. What is no
    monomial, such as `abs(beta)`, has none.
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
    """The terms of one coefficient."""

    candidates: tuple[str, ...]  #: those that moved
    selection: Selection  #: its columns are places in `candidates`
    notices: tuple[Notice, ...]  #: candidates that the flights hardly distinguish, or do not contain

    @property
    def terms(self) -> tuple[str, ...]:
        """The chosen terms, in the order of the candidates."""
        return tuple(self.candidates[i] for i in sorted(self.selection.model.columns))


@dataclass(frozen=True, eq=False)
class Structure:
    """The terms of each coefficient that had candidates, and the histories that they were chosen on."""

    chosen: Mapping[str, ChosenTerms]
    histories: tuple[fits.History, ...]
    notices: tuple[Notice, ...]


def determine(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    candidates: Mapping[str, Sequence[str]],
    choose: Choose,
    domain: Domain,
    keep: Sequence[str] = (),
) -> Structure:
    """Choose terms among candidates (coefficient -> terms) with `choose`, such as `stepwise`; a constant is always there.

    `keep` names parameters of the vehicle whose terms stay, whatever the criterion says.
    Of the vehicle, mass, geometry, thrust, controls and instruments count, and the terms of coefficients that a reduced model
    takes as they are. Candidates of coefficients that are not estimated are ignored. An IdentificationError says that the
    motion was not measured, or for too short a time.
    """
    vehicle = fits.decoupled(vehicle, flights, windows)
    prepared = fits.Prepared.of(vehicle, flights, windows).without_stuck_channels(vehicle)
    found = tuple(h for piece in prepared.pieces for h in History.of(vehicle, piece))
    if not found:
        raise IdentificationError(f"{vehicle.where}: no coefficient can be computed: {NOT_MEASURED}")
    estimated = [c for c in fits.AircraftEquations.COEFFICIENTS[vehicle.reduce] if candidates.get(c)]
    if not estimated:
        raise IdentificationError(
            f"{vehicle.where}: no coefficient of the {vehicle.reduce} model has a candidate; "
            f"name some of {', '.join(fits.AircraftEquations.COEFFICIENTS[vehicle.reduce])}"
        )
    known = {name for c in estimated for name, term in vehicle.terms[c].items() if term.strip() != "1"}
    for name in keep:
        if name not in known:
            raise IdentificationError(f"--keep {name}: {nearest(name, known)}")
    chosen = {}
    for c in estimated:
        own = {name: term for name, term in vehicle.terms[c].items() if term.strip() != "1"}
        kept = [term for name, term in own.items() if name in keep]
        new = (t for t in kept if not any(same_term(t, other) for other in candidates[c]))
        chosen[c] = _chosen(vehicle, c, (*candidates[c], *new), found, choose, domain, own, kept)
    return Structure(chosen, found, prepared.notices)


def _chosen(
    vehicle: Vehicle, coefficient: str, candidates: tuple[str, ...], found: Sequence[fits.History],
    choose: Choose, domain: Domain, own: Mapping[str, str], keep: Sequence[str],
) -> ChosenTerms:  # fmt: skip
    names, where = {*terms.STATE_VARIABLES, *vehicle.file.controls}, f"{vehicle.where}: {coefficient}:"
    trees = [terms.parse(text, names, coefficient) for text in candidates]
    for text, tree in zip(candidates, trees, strict=True):
        unknown = terms.variables(tree) - set(found[0].variables)
        if unknown:  # a control that the equations lack: its deflection is not known
            raise IdentificationError(
                f"{where} candidate {text}: no term of the file has {min(unknown)}, so its channel "
                "is not read; add one with value 0"
            )
    signals = [np.column_stack([h.coefficients[coefficient], *map(h.regressor, candidates)]) for h in found]
    whole = Regression.of(signals, domain, found[0].dt)
    if whole.count < MIN_ROWS:
        raise IdentificationError(f"{where} the windows are too short: {NOT_MEASURED}")
    constant = np.linalg.norm(whole.X, axis=0) <= 1e-9 * np.sqrt(whole.count)
    moving = np.flatnonzero(~constant)
    kept = tuple(candidates[i] for i in moving)
    stay = tuple(i for i, text in enumerate(kept) if any(same_term(text, term) for term in keep))
    regression = replace(whole, X=whole.X[:, moving], parents=parents([trees[i] for i in moving]), kept=stay)
    selection = choose(regression)
    notices = []
    if constant.any():
        still = tuple(candidates[i] for i in np.flatnonzero(constant))
        notices.append(notice("candidate-constant", coefficient, terms=still))
    notices += _indistinct(coefficient, kept, regression)
    if selection.model.r2 < FAIR_R2:
        notices.append(notice("structure-low-r-squared", coefficient, r2=max(selection.model.r2, 0.0)))
    return ChosenTerms(kept, selection, (*notices, *_left_out(coefficient, kept, selection.model, own)))


def same_term(a: str, b: str) -> bool:
    """Whether two terms are written alike, blanks and the sign for powers apart."""
    return terms.written(a) == terms.written(b)


def _left_out(
    coefficient: str, candidates: Sequence[str], model: Model, own: Mapping[str, str]
) -> Iterator[Notice]:
    """Yield which terms of the vehicle were left out although their neighbors move by more than a standard error with them."""
    for name, term in own.items():
        place = next((i for i, text in enumerate(candidates) if same_term(text, term)), None)
        if place is None or place in model.columns or not model.columns or not model.admits(place):
            continue
        moves = {i: move for i, move in model.moves(place).items() if abs(move) > MIN_MOVE}
        if moves:
            f = model.with_column(place).partial_f(place)
            moved, by = tuple(candidates[i] for i in moves), tuple(moves.values())
            yield notice(
                "term-left-out", name, coefficient=coefficient, term=term, f=f, moved=moved, moves=by
            )


def _indistinct(coefficient: str, names: Sequence[str], regression: Regression) -> Iterator[Notice]:
    """Yield which candidates are so nearly collinear that the choice among them is arbitrary."""
    count = len(names)
    correlation = np.abs(np.corrcoef(regression.X, rowvar=False).reshape(count, count))
    groups, member = connected_components(correlation > CORRELATION_LIMIT, directed=False)
    for places in (np.flatnonzero(member == g) for g in range(groups)):
        if len(places) > 1:
            least = float(np.min(correlation[np.ix_(places, places)]))
            alike = tuple(names[int(i)] for i in places)
            yield notice("candidates-correlated", coefficient, terms=alike, correlation=least)
    if count > regression.count:
        return
    others = (Model(regression, tuple(j for j in range(count) if j != i)) for i in range(count))
    spanned = tuple(
        n for i, (n, m) in enumerate(zip(names, others, strict=True)) if m.tolerance(i) < MIN_TOLERANCE
    )
    if spanned:
        yield notice("candidates-collinear", coefficient, terms=spanned, share=1.0 - MIN_TOLERANCE)

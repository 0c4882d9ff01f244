"""Changes of a fleet: the model of every figure, alarms at a stated rate, and the causes that explain each best."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop_fleet.causes import EVERY, SOFTWARE, Cause, Stretch, causes, events, software_event
from stoop_fleet.changes import LEAST, Change, Readings, changes, peaks, threshold
from stoop_fleet.mixed_model import Design, MixedModel, Outlier, fit_robust_model, indices
from stoop_fleet.parts import Parts
from stoop_fleet.software_updates import CommonStep, common_steps, significant, version_levels
from stoop_fleet.table import FigureTable

DAY: Final = 86400.0  #: s
YEAR: Final = 365.25 * DAY
DRAWS: Final = 10_000  #: sequences without a change that are simulated for the threshold, at most
EXPECTED: Final = 200  #: false alarms among them that are enough
ROUNDS: Final = 2  #: of model and changes: changes that were found are taken off before the second model
ROWS_EACH: Final = 5  #: flights for each condition, at least
VEHICLE: Final = "vehicle"


@dataclass(frozen=True)
class Alarm:
    """A change of a figure of a vehicle.

    Attributes
    ----------
    vehicle, figure : str; the vehicle is `EVERY` where an update changed those that had it alike
    change : Change, indices among the flights of the vehicle with this figure
    began, found : flight in which it began, and in which it was found
    began_time, found_time : of these flights, s since 1970
    causes : the likeliest first
    back : flight of the change before that it takes back, such as a roll-back does; empty where it takes none back
    """

    vehicle: str
    figure: str
    change: Change
    began: str
    found: str
    began_time: float
    found_time: float
    causes: tuple[Cause, ...]
    back: str = ""


@dataclass(frozen=True, eq=False)
class FigureModel:
    """A figure over the fleet: the mixed model, what differs from the others, and for each vehicle its rows and readings.

    The first coefficients of the model are those of `fixed`: empty for the mean, levels of software, conditions; `software` has
    the level of each version that is not of level zero.
    """

    rows: FigureTable
    model: MixedModel
    outliers: tuple[Outlier, ...]
    sequences: Mapping[str, tuple[FigureTable, Readings]]
    fixed: tuple[str | int, ...]
    software: Mapping[str, int]

    def mean(self, software: Sequence[str]) -> FloatArray:
        """Return the mean of the fleet (n,) with these versions, at mean conditions."""
        known = dict(zip(self.fixed, self.model.coefficients.tolist(), strict=False))
        return np.array([known[""] + known.get(self.software.get(one, 0), 0.0) for one in software])

    def step(self, before: str, after: str) -> tuple[float, float]:
        """Return the step from one version to another, and its standard error."""
        levels = [self.software.get(one, 0) for one in (before, after)]
        contrast = np.array([float(one == levels[1]) - float(one == levels[0]) for one in self.fixed])
        own = slice(len(contrast))
        variance = contrast @ self.model.covariance[own, own] @ contrast
        return float(contrast @ self.model.coefficients[own]), float(np.sqrt(variance))


@dataclass(frozen=True, eq=False)
class FleetAnalysis:
    """Models of the figures, the threshold for all of them, and the alarms in order of vehicle, figure and time."""

    figures: Mapping[str, FigureModel]
    threshold: float
    alarms: tuple[Alarm, ...]


def analyze(table: FigureTable, parts: Parts, alarms_a_year: float = 1.0, seed: int = 0) -> FleetAnalysis:
    """Return what changed in a fleet.

    Parameters
    ----------
    table : FigureTable
    parts : Parts
    alarms_a_year : float
        Mean number of false alarms of the whole fleet in a year.
    seed : int
        Of the simulation that sets the threshold.
    """
    years, own = float(np.ptp(table.time)) / YEAR, {name: table.of(name) for name in table.figures()}
    sequences = len(set(zip(table.figure, table.vehicle, strict=True)))
    draws = math.ceil(min(EXPECTED / max(alarms_a_year * years, LEAST), DRAWS / sequences))
    most: dict[str, dict[str, FloatArray]] = {}
    found: dict[str, dict[str, list[Change]]] = {name: {} for name in own}
    models = {name: figure_model(rows, parts, np.zeros(len(rows.value))) for name, rows in own.items()}
    steps = {name: common_steps(model.sequences) for name, model in models.items()}
    updates = significant(steps)
    versions = {name: version_levels(several, updates[name]) for name, several in steps.items()}
    for _ in range(ROUNDS):
        for i, (name, rows) in enumerate(own.items()):
            changed = any(found[name].values())
            if changed or (updates[name] and name not in most):
                models[name] = figure_model(rows, parts, _shift(rows, found[name]), versions[name])
            if changed or name not in most:
                rng = np.random.default_rng([seed, i])
                most[name] = {v: peaks(one, draws, rng) for v, (_, one) in models[name].sequences.items()}
        drawn = np.concatenate([one[1:] for by_vehicle in most.values() for one in by_vehicle.values()])
        limit = threshold(drawn, alarms_a_year * years * draws)
        found = {
            name: {
                vehicle: list(changes(readings, limit))
                for vehicle, (_, readings) in one.sequences.items()
                if most[name][vehicle][0] > limit
            }
            for name, one in models.items()
        }
    alarms = [_of_update(name, models[name], step) for name, several in updates.items() for step in several]
    alarms += [
        alarm
        for name, by_vehicle in found.items()
        for vehicle, several in by_vehicle.items()
        for alarm in _alarms(name, vehicle, models, several, parts)
    ]
    return FleetAnalysis(
        models, limit, tuple(sorted(alarms, key=lambda a: (a.vehicle, a.figure, a.change.first)))
    )


def figure_model(
    rows: FigureTable, parts: Parts, shift: FloatArray, software: Mapping[str, int] = {}
) -> FigureModel:
    """Return the mixed model of a figure whose changes so far are `shift` (n,), and the readings of each vehicle.

    `software` has the level of each version. Of the level of a vehicle that lies apart from the others nothing is known.
    """
    places = sorted({place for text in set(rows.parts) for place in text.split()})
    serials = {place: parts.serials(place, rows.vehicle, rows.time) for place in places}
    at, vehicles = indices(rows.vehicle)
    groups = {VEHICLE: at} | {place: indices(own)[0] for place, own in serials.items() if any(own)}
    columns = _fixed(rows, software)
    fixed = np.column_stack([*columns.values()])
    model, outliers = fit_robust_model(Design(rows.value - shift, rows.std_error, fixed, groups))
    mean = fixed @ model.coefficients[: fixed.shape[1]]
    left, deviations = rows.value - mean, np.hypot(model.flight, rows.std_error)
    apart = {one.level for one in outliers if one.group == VEHICLE}
    sequences = {}
    for i, vehicle in enumerate(vehicles):
        which = at == i
        effects, spread = [np.ones(int(which.sum()))], [np.inf if i in apart else model.deviations[VEHICLE]]
        for place, levels in groups.items():
            if place != VEHICLE:
                own = levels[which]
                effects += [(own == level).astype(float) for level in np.unique(own[own >= 0])]
                spread += [model.deviations[place]] * (len(effects) - len(spread))
        readings = Readings(
            left[which], deviations[which], rows.time[which] / DAY, np.column_stack(effects), np.array(spread)
        )
        own_rows = rows.rows(which)
        onsets = Stretch(own_rows, readings).onsets([*events(own_rows, parts, vehicle)])
        sequences[vehicle] = own_rows, replace(readings, onsets=onsets)
    return FigureModel(rows, model, outliers, sequences, tuple(columns), software)


def _fixed(rows: FigureTable, software: Mapping[str, int]) -> dict[str | int, FloatArray]:
    """Return the intercept, levels of the software above zero, and the conditions that vary, standardized: (n,) each by name.

    A condition that is not known counts as usual.
    """
    levels = np.array([software.get(version, 0) for version in rows.software])
    regressors: dict[str | int, FloatArray] = {
        level: (levels == level).astype(float) for level in sorted({*software.values()} - {0})
    }
    for name, x in rows.conditions.items():
        known = x[np.isfinite(x)]
        if known.size and np.ptp(known) > 0.0:
            regressors[name] = np.nan_to_num((x - known.mean()) / known.std())
    fixed: dict[str | int, FloatArray] = {"": np.ones(len(levels))}
    for one, regressor in regressors.items():
        wider = np.column_stack([*fixed.values(), regressor])
        if wider.shape[1] <= len(levels) / ROWS_EACH and np.linalg.matrix_rank(wider) == wider.shape[1]:
            fixed[one] = regressor
    return fixed


def _shift(rows: FigureTable, found: Mapping[str, Sequence[Change]]) -> FloatArray:
    """Return the sum (n,) of the changes that were found, by row of the figure."""
    out = np.zeros(len(rows.value))
    for vehicle, several in found.items():
        at = np.flatnonzero([name == vehicle for name in rows.vehicle])
        for change in several:
            out[at] += change.course(rows.time[at] / DAY)
    return out


def _alarms(
    figure: str, vehicle: str, models: Mapping[str, FigureModel], several: Sequence[Change], parts: Parts
) -> Iterator[Alarm]:
    rows, own = models[figure].sequences[vehicle]
    recorded = list(events(rows, parts, vehicle))
    others = {
        name: Stretch(*model.sequences[vehicle])
        for name, model in models.items()
        if name != figure and vehicle in model.sequences
    }
    begin, before = 0, None
    for i, change in enumerate(several):
        end = several[i + 1].first if i + 1 < len(several) else len(rows.flight)
        end = max(end, change.found + 1)
        stretch = Stretch(rows.span(begin, end), own.until(end - begin))
        explained = causes(stretch, change.kind, recorded, others)
        back = "" if before is None or not change.takes_back(before) else rows.flight[before.first]
        flights = (rows.flight[change.first], rows.flight[change.found])
        times = (float(rows.time[change.first]), float(rows.time[change.found]))
        yield Alarm(vehicle, figure, change, *flights, *times, explained, back)
        own, begin, before = own.since(replace(change, first=change.first - begin)), change.first, change


def _of_update(name: str, figure: FigureModel, step: CommonStep) -> Alarm:
    """Return what an update changed, its size beside the conditions and the changes of vehicles."""
    size, error = figure.step(step.before, step.after)
    first, found = np.searchsorted(figure.rows.time, [step.began, step.found]).tolist()
    change = Change("step", first, found, size, max(error, step.error), (step.size / step.error) ** 2)
    flights = (figure.rows.flight[first], figure.rows.flight[found])
    cause = Cause(software_event(step.before, step.after), flights[0], 1.0 - step.chance, (), SOFTWARE)
    return Alarm(EVERY, name, change, *flights, step.began, step.found, (cause,))

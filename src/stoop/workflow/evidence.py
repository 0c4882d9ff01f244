"""What a finished fit says of its own uncertainty before any assessment: two error bars, and what the data can tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stoop.assess.advice import Flown, Term, advice
from stoop.assess.covariance import correlation, intervals_95
from stoop.assess.directions import blind_directions, marginal_information, partners, worst_pairs
from stoop.assess.estimate import Uncertainty
from stoop.assess.identifiability import scaled_singular_values
from stoop.assess.trust import CORRECTED, CRAMER_RAO, trust
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Fit
from stoop.problem import Piece
from stoop.results.result import Result
from stoop.results.uncertainty import (
    IdentifiabilityAnalysis,
    Interval,
    MethodIntervals,
    NearNullDirection,
    ParameterIdentifiability,
)
from stoop.simulate import parameter_rows
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle, terms
from stoop.workflow.errorbars import ErrorBars

MOST_HIDDEN = 5  #: parameters named that move along with one where the data do not see it
_AXES = {"pitch": ("Cm", "elevator"), "roll": ("Cl", "aileron"), "yaw": ("Cn", "rudder")}


def with_evidence(result: Result, fit: Fit, bars: ErrorBars) -> Result:
    """Return the result with its two error bars side by side, which to trust, and what the data can tell."""
    methods = {CORRECTED: MethodIntervals(_spreads(result, bars, bars.std))}
    if not np.isnan(bars.white).all():  # a method that takes residuals as white has nothing to compare
        methods[CRAMER_RAO] = MethodIntervals(_spreads(result, bars, bars.white))
    return replace(
        result,
        uncertainty=methods,
        trust=trust(result.parameters, methods),
        identifiability=_identifiable(result, fit, bars),
    )


def _spreads(result: Result, bars: ErrorBars, std: FloatArray) -> dict[str, Interval]:
    out = {}
    for i, (name, p) in enumerate(result.parameters.items()):
        low, high = intervals_95(np.array([p.estimate]), std[i : i + 1])[0]
        sure = p.identifiable and not p.at_bound
        ends = (float(low), float(high)) if sure else (np.nan, np.nan)
        out[name] = Interval(np.nan if bars.held[i] else float(std[i]), *ends)
    return out


def _identifiable(result: Result, fit: Fit, bars: ErrorBars) -> IdentifiabilityAnalysis:
    names = [p.name for p in fit.problem.layout.parameters]
    related = correlation(bars.covariance[: len(names), : len(names)])
    flown = _flown(result, fit)
    values, directions = _seen(fit, bars.found, bars, names)
    sights = {}
    for i, name in enumerate(names):
        hidden = [n for d in directions if name in d.changes for n in d.changes if n != name]
        stand_ins = tuple(dict.fromkeys([*partners(names, related, i), *hidden[:MOST_HIDDEN]]))
        sights[name] = _sight(name, i, bars, stand_ins, flown)
    return IdentifiabilityAnalysis(values, sights, worst_pairs(names, related), directions)


def _sight(
    name: str, index: int, bars: ErrorBars, stand_ins: tuple[str, ...], flown: Flown
) -> ParameterIdentifiability:
    if bars.held[index]:
        doubt = "it lies at its bound"
        return ParameterIdentifiability(
            np.nan, np.nan, np.nan, stand_ins, doubt, advice(name, stand_ins, flown)
        )
    one = bars.judged[name]
    said = advice(name, stand_ins, flown) if one.reason else ""
    return ParameterIdentifiability(
        one.conditional_std, one.marginal_std, one.multiple_correlation, stand_ins, one.reason, said
    )


def _seen(
    fit: Fit, found: Uncertainty | None, bars: ErrorBars, names: list[str]
) -> tuple[tuple[float, ...], tuple[NearNullDirection, ...]]:
    """Return singular values of all free unknowns, and the blind directions of the parameters, priors left out."""
    if found is None:
        return (), ()
    free = np.flatnonzero(~bars.held)
    mine = free[free < len(names)]
    prior = np.array([fit.problem.layout.parameters[i].prior or np.inf for i in mine])
    data = marginal_information(found.information, len(mine)) - np.diag(prior**-2.0)
    values = tuple(float(v) for v in scaled_singular_values(found.information))
    sizes = np.abs(np.array([fit.estimates[names[i]] for i in mine]))
    return values, blind_directions([names[i] for i in mine], _cleaned(data, found.information), sizes)


def _cleaned(data: FloatArray, whole: FloatArray) -> FloatArray:
    """Return information without what is rounding: a prior taken off again leaves some."""
    diagonal = np.diag(whole)[: len(data)]
    lost = np.diag(data) <= 1e-12 * diagonal
    out = data.copy()
    out[lost, :] = out[:, lost] = 0.0
    return out


def _flown(result: Result, fit: Fit) -> Flown:
    """Return the terms as the model flew them, and the controls and modes of the vehicle."""
    vehicle, layout = fit.problem.layout.vehicle, fit.problem.layout
    if vehicle.rotors:
        return Flown({}, frequencies=_frequencies(result))
    free = {p.name for p in layout.parameters}
    columns = [_columns(vehicle, fit, i, piece) for i, piece in enumerate(fit.problem.pieces)]
    known = set(terms.STATE_VARIABLES) | set(vehicle.file.controls)
    found = {}
    for coefficient, texts in vehicle.terms.items():
        for name, text in texts.items():
            tree = terms.parse(text, known, vehicle.where)
            series = [np.broadcast_to(terms.convert(tree, c), len(c["V"])) for c in columns]
            value = fit.estimates[name] if name in free else vehicle.value(name)
            flown = np.concatenate(series).astype(np.float64)
            found[name] = Term(name, coefficient, terms.variables(tree), value, flown)
    axes = {axis: _strongest(found, vehicle, *of) for axis, of in _AXES.items()}
    return Flown(found, power=_power(vehicle), frequencies=_frequencies(result), **axes)


def _columns(vehicle: Vehicle, fit: Fit, index: int, piece: Piece) -> dict[str, FloatArray]:
    """Return what terms are made of, (n,) each, along one piece as the model flew it."""
    read = dict(zip(vehicle.outputs, fit.problem.outputs(fit.z, index).T, strict=True))
    still = np.zeros(len(piece.time))
    rows = parameter_rows(vehicle, piece.changes)
    motion = {c: np.nan_to_num(read.get(c, still)) for c in ("V", "alpha", "beta", "p", "q", "r")}
    if "V" not in read:
        motion["V"] = np.full(len(piece.time), float(piece.start.get("V", 1.0)))
    actual = vehicle.actual_rates
    rates = (motion["p"], motion["q"], motion["r"])
    made = terms.values(vehicle.value, actual, motion["V"], motion["alpha"], motion["beta"], rates)
    every = np.repeat(rows, len(piece.time), axis=1)
    return made | {c: commanded(vehicle, c, every, piece.inputs.T) for c in vehicle.controls}


def _strongest(found: Mapping[str, Term], vehicle: Vehicle, coefficient: str, usual: str) -> str:
    """Return the control that does most about an axis; the usual one where the model is without that axis."""
    of_axis = [t for t in found.values() if t.coefficient == coefficient and len(t.variables) == 1]
    power = {c: abs(t.value) for t in of_axis for c in t.variables if c in vehicle.file.controls}
    if power:
        return max(power, key=lambda c: power[c])
    return usual if usual in vehicle.file.controls else ""


def _power(vehicle: Vehicle) -> str:
    propulsion = vehicle.file.propulsion
    return "" if propulsion is None or propulsion.kind == "constant" else propulsion.channel


def _frequencies(result: Result) -> dict[str, float]:
    every = [mode for condition in result.modes for mode in condition.modes]
    return {mode.name: mode.frequency.estimate for mode in reversed(every)}

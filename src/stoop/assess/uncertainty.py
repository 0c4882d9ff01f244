"""The uncertainty of a result: intervals by method side by side, and what the data determine."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from stoop.assess.agreement import CORRECTED, CRAMER_RAO, method_agreement
from stoop.assess.covariance import correlation, intervals_95
from stoop.assess.error_bars import ErrorBars, Uncertainty
from stoop.assess.identifiability import (
    marginal_information,
    near_null_directions,
    partners,
    scaled_singular_values,
    worst_pairs,
)
from stoop.assess.maneuver_advice import FlownModel, advice, flown_model
from stoop.base.arrays import FloatArray
from stoop.estimate.fit import Fit
from stoop.results.result import Result
from stoop.results.uncertainty import (
    IdentifiabilityAnalysis,
    Interval,
    MethodIntervals,
    NearNullDirection,
    ParameterIdentifiability,
)

MOST_HIDDEN: Final = 5  #: parameters named that move along with one in a near-null direction


def with_uncertainty(result: Result, fit: Fit, bars: ErrorBars) -> Result:
    """Return the result with its two error bars side by side, which to trust, and what the data can tell."""
    methods = {CORRECTED: MethodIntervals(_intervals(result, bars, bars.std))}
    if not np.isnan(
        bars.cramer_rao_std
    ).all():  # a method that takes residuals as white has nothing to compare
        methods[CRAMER_RAO] = MethodIntervals(_intervals(result, bars, bars.cramer_rao_std))
    return replace(
        result,
        uncertainty=methods,
        trust=method_agreement(result.parameters, methods),
        identifiability=_analysis(result, fit, bars),
    )


def _intervals(result: Result, bars: ErrorBars, std: FloatArray) -> dict[str, Interval]:
    out = {}
    for i, (name, p) in enumerate(result.parameters.items()):
        low, high = intervals_95(np.array([p.estimate]), std[i : i + 1])[0]
        sure = p.identifiable and not p.at_bound
        ends = (float(low), float(high)) if sure else (np.nan, np.nan)
        out[name] = Interval(np.nan if bars.at_bound[i] else float(std[i]), *ends)
    return out


def _analysis(result: Result, fit: Fit, bars: ErrorBars) -> IdentifiabilityAnalysis:
    names = [p.name for p in fit.problem.layout.parameters]
    related = correlation(bars.covariance[: len(names), : len(names)])
    model = flown_model(result, fit)
    values, directions = _directions(fit, bars.uncertainty, bars, names)
    analyses = {}
    for i, name in enumerate(names):
        hidden = [n for d in directions if name in d.changes for n in d.changes if n != name]
        stand_ins = tuple(dict.fromkeys([*partners(names, related, i), *hidden[:MOST_HIDDEN]]))
        analyses[name] = _parameter(name, i, bars, stand_ins, model)
    return IdentifiabilityAnalysis(values, analyses, worst_pairs(names, related), directions)


def _parameter(
    name: str, index: int, bars: ErrorBars, stand_ins: tuple[str, ...], model: FlownModel
) -> ParameterIdentifiability:
    if bars.at_bound[index]:
        doubt = "it lies at its bound"
        return ParameterIdentifiability(
            np.nan, np.nan, np.nan, stand_ins, doubt, advice(name, stand_ins, model)
        )
    one = bars.identifiability[name]
    said = advice(name, stand_ins, model) if one.reason else ""
    return ParameterIdentifiability(
        one.conditional_std, one.marginal_std, one.multiple_correlation, stand_ins, one.reason, said
    )


def _directions(
    fit: Fit, found: Uncertainty | None, bars: ErrorBars, names: list[str]
) -> tuple[tuple[float, ...], tuple[NearNullDirection, ...]]:
    """Return singular values of all free unknowns, and the blind directions of the parameters, priors left out."""
    if found is None:
        return (), ()
    mine = bars.free[bars.free < len(names)]
    prior = np.array([fit.problem.layout.parameters[i].prior or np.inf for i in mine])
    data = marginal_information(found.information, len(mine)) - np.diag(prior**-2.0)
    values = tuple(float(v) for v in scaled_singular_values(found.information))
    sizes = np.abs(np.array([fit.estimates[names[i]] for i in mine]))
    return values, near_null_directions([names[i] for i in mine], _cleaned(data, found.information), sizes)


def _cleaned(data: FloatArray, whole: FloatArray) -> FloatArray:
    """Return information without what is rounding: a prior taken off again leaves some."""
    diagonal = np.diag(whole)[: len(data)]
    lost = np.diag(data) <= 1e-12 * diagonal
    out = data.copy()
    out[lost, :] = out[:, lost] = 0.0
    return out

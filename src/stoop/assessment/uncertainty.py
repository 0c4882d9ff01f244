r"""The uncertainty of a result: intervals by method, which to trust, what the data determine, whether maneuvers agree.

Repeatability: with estimates :math:`\theta_i` and standard errors :math:`s_i` of m maneuvers that were fitted alone,

.. math:: \bar\theta = \frac{\sum \theta_i / s_i^2}{\sum 1 / s_i^2}, \qquad
          \chi^2 = \sum \frac{(\theta_i - \bar\theta)^2}{s_i^2},

which is chi-square with m - 1 degrees of freedom if the error bars are right. Estimates that share a prior agree because of it;
without it, with the prior's share f, they are :math:`(\theta - f \theta_0) / (1 - f)`.

References
----------
R. T. Birge, "The calculation of errors by the method of least squares", *Physical Review* 40, 1932, pp. 207-227 (internal
against external consistency).
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 6 (repeated
maneuvers as the test of error bars).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np
from scipy.stats import chi2

from stoop.assessment.covariance import NORMAL_95, correlation
from stoop.assessment.error_bars import (
    GIVEN_MODEL,
    ErrorBars,
    marginal_information,
    near_null_directions,
    partners,
    scaled_singular_values,
    worst_pairs,
)
from stoop.assessment.flown_model import FlownModel
from stoop.assessment.verdict import CONFIRMED
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.packages import hooks
from stoop.base.text import enumerated, remaining
from stoop.errors import StoopError
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.flight import Flight
from stoop.problem.evidence import invert
from stoop.results.result import ParameterEstimate, Result
from stoop.results.uncertainty import (
    COMPONENTS,
    SCATTER_LEVEL,
    Components,
    IdentifiabilityAnalysis,
    Interval,
    JointTest,
    MethodIntervals,
    NearNullDirection,
    ParameterIdentifiability,
    ParameterRepeatability,
    Repeatability,
    SingleEstimate,
)

COLORED_RATIO: Final = 1.25  #: typical factor of the correction from which residuals count as colored
NO_REPEATABILITY: Final = Repeatability()
NO_COMPONENTS: Final = Components()
DISAGREEMENT: Final = 1.4  #: ratio of standard errors from which two methods disagree
SKEWNESS: Final = 1.5  #: ratio of the arms of an interval from which it is no longer normal
MAX_PRIOR_SHARE: Final = 0.5  #: of an estimate: beyond, the prior knows more than the maneuver


def with_uncertainty(result: Result, fit: Estimate, bars: ErrorBars, flown: FlownModel) -> Result:
    """Return the result with its two error bars side by side, which to trust, and what the data can tell."""
    errors = {"corrected": bars.std}
    if not {c.name for c in bars.components} <= {*GIVEN_MODEL}:
        errors["conditional"] = bars.conditional_std
    if not np.isnan(bars.cramer_rao_std).all():  # a method that takes residuals as white has none to compare
        errors["cramer_rao"] = bars.cramer_rao_std
    methods = {}
    for key, std in errors.items():
        intervals = {}
        for (name, p), error in zip(result.parameters.items(), std.tolist(), strict=False):
            reach = NORMAL_95 * error if p.identifiable and not p.at_bound else np.nan
            ends = p.estimate - reach, p.estimate + reach
            intervals[name] = Interval(np.nan if p.at_bound else error, *ends)
        methods[key] = MethodIntervals(intervals)
    names = [p.name for p in fit.problem.layout.parameters]
    parts = {c.name: np.diag(bars.part(c.name))[: len(names)].tolist() for c in bars.components}
    variances = {c: dict(zip(names, own, strict=True)) for c, own in parts.items()}
    components = Components(variances, tuple(n for n in COMPONENTS if n in bars.left_out))
    related = correlation(bars.covariance[: len(names), : len(names)])
    advisers = hooks("advice", list[Notice])
    singular, directions = _directions(fit, bars, names)
    analyses = {}
    for i, name in enumerate(names):
        hidden = [n for d in directions if name in d.changes for n in d.changes if n != name][:5]
        stand_ins = tuple(dict.fromkeys([*partners(names, related, i), *hidden]))
        doubt: Notice | None = notice("at-its-bound")
        numbers = (np.nan,) * 3
        if not bars.at_bound[i]:
            one = bars.identifiability[name]
            numbers, doubt = (one.conditional_std, one.marginal_std, one.multiple_correlation), one.reason
        advised = tuple(n for advice in advisers for n in advice(flown, name, stand_ins)) if doubt else ()
        analyses[name] = ParameterIdentifiability(*numbers, stand_ins, doubt, advised)
    return replace(
        result,
        uncertainty=methods,
        components=components,
        trust=method_agreement(result.parameters, methods, components=components),
        identifiability=IdentifiabilityAnalysis(singular, analyses, worst_pairs(names, related), directions),
    )


def _directions(
    fit: Estimate, bars: ErrorBars, names: list[str]
) -> tuple[tuple[float, ...], tuple[NearNullDirection, ...]]:
    """Return singular values of all free unknowns, and near-null directions of the parameters, priors left out."""
    whole = bars.uncertainty.information
    own = bars.free[bars.free < len(names)]
    priors = [fit.problem.layout.parameters[i].prior_about(fit.estimates[names[i]]) for i in own]
    prior = np.array([std for _, std in priors])
    data = marginal_information(whole, len(own)) - np.diag(prior**-2.0)
    rounding = np.diag(data) <= 1e-12 * np.diag(whole)[: len(data)]  # left of a prior that is taken off again
    data = np.where(rounding | rounding[:, None], 0.0, data)
    sizes = np.abs(np.array([fit.estimates[names[i]] for i in own]))
    singular = tuple(float(v) for v in scaled_singular_values(whole))
    return singular, near_null_directions([names[i] for i in own], data, sizes)


def with_repeatability(result: Result, found: Repeatability) -> Result:
    """Return the result with what its maneuvers say alone, and which error bars to trust after that."""
    agreement = method_agreement(result.parameters, result.uncertainty, found, result.components)
    return replace(result, repeatability=found, trust=agreement)


def method_agreement(
    parameters: Mapping[str, ParameterEstimate],
    methods: Mapping[str, MethodIntervals],
    repeated: Repeatability = NO_REPEATABILITY,
    components: Components = NO_COMPONENTS,
) -> tuple[Notice, ...]:
    """Return which method to trust for which parameters, and where they disagree; nothing without ``corrected``.

    Where maneuvers fitted alone scatter, over all parameters, by more than chance and the scatter that the corrected error
    bars contain, none is trusted.
    """
    if "corrected" not in methods:
        return ()
    sure = {name: p for name, p in parameters.items() if p.identifiable and not p.at_bound}
    given = "conditional" if "conditional" in methods else "corrected"  # like the bootstrap: given the model
    pairs = ((given, "cramer_rao"), ("bootstrap", given), ("posterior", "corrected"))
    color, bootstrap, posterior = (_ratios(sure, methods, *pair) for pair in pairs)
    apart = _by_maneuvers(sure, methods, components)
    contained = float(np.median(list(apart.values()))) if apart else 1.0
    out = [notice("agreement-maneuvers", ratio=contained) if apart else notice("agreement-one-maneuver")]
    out = [] if "maneuvers" in components.left_out else out
    color = {} if "color" in components.left_out else color
    typical = float(np.median(list(color.values()))) if color else 1.0
    scattered = repeated.scatter_ratio / contained
    degrees = sum(one.degrees for one in repeated.parameters.values() if one.verdict)
    if degrees and chi2.sf(scattered**2 * degrees, degrees) < SCATTER_LEVEL:
        code = "agreement-scatter" if typical < COLORED_RATIO else "agreement-scatter-colored"
        out.append(notice(code, ratio=scattered, plain=typical * repeated.scatter_ratio))
    elif color:
        code = "agreement-white" if typical < COLORED_RATIO else "agreement-colored"
        out.append(notice(code, ratio=typical))
    if "bootstrap" in methods and not bootstrap:
        out.append(notice("agreement-no-bootstrap"))
    elif bootstrap:
        wider = [name for name, ratio in bootstrap.items() if ratio > DISAGREEMENT]
        narrower = [name for name, ratio in bootstrap.items() if ratio < 1.0 / DISAGREEMENT]
        which = "".join(("-wider" if wider else "", "-narrower" if narrower else "")) or "-agrees"
        ratio = float(np.median(list(bootstrap.values())))
        out.append(notice(f"bootstrap{which}", ratio=ratio, wider=_listed(wider), narrower=_listed(narrower)))
    if "posterior" in methods and methods["posterior"].figures.get("rhat", np.inf) > MethodIntervals.MAX_RHAT:
        out.append(notice("agreement-no-posterior"))
    elif "posterior" in methods:
        skewed = _skewed(sure, methods["posterior"])
        close = {n for n, r in posterior.items() if 1.0 / DISAGREEMENT <= r <= DISAGREEMENT}
        far = [n for n in posterior if n not in close and n not in skewed]
        found = {"posterior-skewed": skewed, "posterior-disagrees": far}
        out += [notice(code, _listed(names)) for code, names in found.items() if names]
        out += [] if skewed or far else [notice("posterior-agrees")]
    if "profile" in methods:
        ends = {n: (s.ci95_lower, s.ci95_upper) for n, s in methods["profile"].parameters.items()}
        opened = [n for n, pair in ends.items() if not np.isfinite(pair).all()]
        found = {"profiles-open": opened, "profiles-skewed": _skewed(sure, methods["profile"])}
        out += [notice(code, _listed(names)) for code, names in found.items() if names]
    unsure = [name for name in parameters if name not in sure]
    return (*out, *([notice("no-interval-trusted", _listed(unsure))] if unsure else []))


def _by_maneuvers(
    names: Iterable[str], methods: Mapping[str, MethodIntervals], components: Components
) -> dict[str, float]:
    """Return by how much maneuvers widen the errors that noise alone explains; older results have no components."""
    if not components.variances:
        known = {n: one for n, one in methods.items() if n in ("corrected", "conditional")}
        if len(known) < 2:
            return {}
        pairs = {n: [known[m].parameters[n].std_error for m in ("corrected", "conditional")] for n in names}
        return {n: whole / given for n, (whole, given) in pairs.items() if given > 0.0}
    more, out = components.variances.get("maneuvers", {}), dict[str, float]()
    for name in (n for n in names if n in more):
        noise = math.fsum(components.variances[c][name] for c in GIVEN_MODEL if c in components.variances)
        out |= {name: math.sqrt(1.0 + more[name] / noise)} if noise > 0.0 else {}
    return out


def _ratios(
    sure: Mapping[str, ParameterEstimate], methods: Mapping[str, MethodIntervals], one: str, other: str
) -> dict[str, float]:
    """Return by how much the standard errors of one method exceed another's, where both have them."""
    a, b = (methods[name].parameters if name in methods else {} for name in (one, other))
    pairs = {n: (a[n].std_error, b[n].std_error) for n in sure if n in a and n in b}
    return {n: x / y for n, (x, y) in pairs.items() if np.isfinite([x, y]).all() and y > 0.0}


def _skewed(sure: Mapping[str, ParameterEstimate], method: MethodIntervals) -> list[str]:
    """Return the parameters whose closed interval is not symmetric about the estimate."""
    out = []
    for name, p in ((n, p) for n, p in sure.items() if n in method.parameters):
        one = method.parameters[name]
        arms = p.estimate - one.ci95_lower, one.ci95_upper - p.estimate
        if np.isfinite(arms).all() and not (min(arms) > 0.0 and max(arms) / min(arms) <= SKEWNESS):
            out.append(name)
    return out


def _listed(names: list[str]) -> str:
    return enumerated(names[:8] + ([f"{len(names) - 8} more"] if len(names) > 8 else []))


def without_prior(
    estimate: float, std_error: float, share: float, mean: float, prior: float
) -> SingleEstimate:
    """Return an estimate without its prior; `share` is the variance in the fit over that of the prior, 0 without one."""
    if not share > 0.0:
        return SingleEstimate(estimate, std_error, math.isfinite(std_error) and std_error > 0.0)
    if share > MAX_PRIOR_SHARE:
        return SingleEstimate(estimate, std_error, counted=False)
    rest = 1.0 - share
    variance = (std_error**2 - (share * prior) ** 2) / rest**2
    value = (estimate - share * mean) / rest
    return SingleEstimate(value, math.sqrt(max(variance, 0.0)), math.isfinite(variance) and variance > 0.0)


def scatter(singles: Sequence[SingleEstimate]) -> ParameterRepeatability:
    """Return whether the estimates that are counted agree."""
    counted = [one for one in singles if one.counted]
    if not counted:
        return ParameterRepeatability(tuple(singles))
    weights, degrees = np.array([one.std_error**-2.0 for one in counted]), len(counted) - 1
    values = np.array([one.estimate for one in counted])
    mean, error = float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)
    if not degrees:
        return ParameterRepeatability(tuple(singles), mean, error)
    square = float(weights @ (values - mean) ** 2)
    p_value = float(chi2.sf(square, degrees))
    verdict = "agree" if p_value >= SCATTER_LEVEL else "scatter"
    return ParameterRepeatability(tuple(singles), mean, error, square, degrees, p_value, verdict)


def repeatability(
    fit: Estimate, flights: Mapping[str, Flight], options: Options, watch: Callable[[str], None]
) -> Repeatability:
    """Fit every maneuver of a finished fit by itself, from the same start, within the same bounds and priors; compare them.

    What a maneuver does not determine is not counted. Ctrl-C ends the fit at hand, which `watch` receives, and the rest.
    """
    layout, windows = fit.problem.layout, fit.prepared.windows
    fitter, stopped, remarks = methods.find(options.method).fitter(), False, list[Notice]()
    nothing = SingleEstimate(math.nan, math.nan, counted=False)
    singles = {p.name: [nothing] * len(windows) for p in layout.parameters}
    began = time.perf_counter()
    for i, window in enumerate(windows):
        left = remaining(time.perf_counter() - began, i, len(windows))
        watch(f"repeatability: {window}, {i + 1} of {len(windows)}{left}")
        try:
            own = None if stopped else fitter(layout.vehicle, flights, [window], options, None, None)
            stopped = own is None or own.outcome.status == "interrupted"
            if own is None or stopped:
                remarks.append(notice("maneuver-stopped", str(window)))
                continue
            for name, one in _estimates(own, ErrorBars.of(own).without({"held"})).items():
                singles[name][i] = one
            if own.outcome.status not in CONFIRMED:
                remarks.append(notice("maneuver-no-optimum", str(window), advice=own.outcome.advice))
        except (StoopError, np.linalg.LinAlgError) as error:
            remarks.append(notice("maneuver-not-fitted", str(window), reason=str(error)))
    compared = {name: scatter(several) for name, several in singles.items()}
    return Repeatability(tuple(range(len(windows))), compared, tuple(remarks))


def agreement(results: Mapping[str, Result]) -> Repeatability:
    """Return whether results of flights or maneuvers that were fitted apart agree, in what all of them estimated.

    Each loses its own prior; what it does not determine, or has at a bound, is not counted. Errors of a result without maneuvers
    to compare are conditional on the model: they are widened as the maneuvers of the others disagree.

    Raises
    ------
    StoopError
        Two results share samples of a flight, or nothing that was estimated is in all.
    """
    for (name, one), (other, two) in combinations(results.items(), 2):
        pairs = [(a, b) for a in one.maneuvers for b in two.maneuvers if a.role == b.role == "fit"]
        shared = [(a, b) for a, b in pairs if a.flight == b.flight and a.start < b.stop and b.start < a.stop]
        if shared and _digests(one).items() & _digests(two).items():
            a, b = shared[0]
            raise StoopError(
                f"{name}, {other}: both were fitted to {a.window} (and {b.start:g}:{b.stop:g}): results that share samples agree "
                "because of it; fit other windows"
            )
    (first, *others), labels = results.values(), ", ".join(results)
    names = [n for n in first.parameters if all(n in r.parameters for r in others)]
    if not names:
        raise StoopError(f"{labels}: no parameter was estimated in all of them; free the same ones")
    units = {n: {r.parameters[n].unit for r in results.values()} for n in names}
    for mixed, several in units.items():
        if len(several) > 1:
            raise StoopError(f"{labels}: {mixed} has units {', '.join(sorted(several))}; use one")
    ended = {n: r.advice or r.status for n, r in results.items() if r.status not in CONFIRMED}
    remarks = [notice("maneuver-no-optimum", name, advice=advice) for name, advice in ended.items()]
    singles = {name: [_alone(r, name) for r in results.values()] for name in names}
    stretches = {name: _stretch(results.values(), name) for name in names}
    for i, (label, result) in enumerate(results.items()):
        shown = _by_maneuvers(names, result.uncertainty, result.components)
        if shown or max(stretches.values()) <= 1.0:
            continue
        remarks.append(notice("widened-as-others", label, ratio=float(np.median(list(stretches.values())))))
        for name, alone in singles.items():
            alone[i] = replace(alone[i], std_error=alone[i].std_error * stretches[name])
    compared = {name: scatter(alone) for name, alone in singles.items()}
    counted = {name: alone for name, alone in singles.items() if all(one.counted for one in alone)}
    joint = joint_test(tuple(results.values()), counted)
    return Repeatability(tuple(range(len(results))), compared, tuple(remarks), joint)


def joint_test(results: Sequence[Result], singles: Mapping[str, Sequence[SingleEstimate]]) -> JointTest:
    r"""Return whether the named parameters of results agree at once.

    With covariances :math:`C_i`, of the correlations of the results and the standard errors of `singles`,
    :math:`\chi^2 = \sum (\theta_i - \bar\theta)' C_i^{-1} (\theta_i - \bar\theta)` about the mean of these weights is
    chi-square with (m - 1) k degrees of freedom; of two results it is that of their difference. Directions that a result's
    correlations leave without variance are not compared.
    """
    variances = [dict(zip(r.covariance.names, np.diag(r.covariance.matrix), strict=True)) for r in results]
    names = [n for n in singles if all(0.0 < known.get(n, 0.0) < np.inf for known in variances)]
    if not names:
        return JointTest()
    estimates, weights = list[FloatArray](), list[FloatArray]()
    for i, result in enumerate(results):
        own, rows = [singles[n][i] for n in names], [result.covariance.names.index(n) for n in names]
        errors = np.array([one.std_error for one in own])
        related = correlation(result.covariance.matrix[np.ix_(rows, rows)])
        weights.append(invert(related).matrix / np.outer(errors, errors))  # the inverse of their covariance
        estimates.append(np.array([one.estimate for one in own]))
    pairs = list(zip(weights, estimates, strict=True))
    mean = invert(np.sum(weights, axis=0)).matrix @ np.sum([W @ x for W, x in pairs], axis=0)
    statistic = float(sum((x - mean) @ W @ (x - mean) for W, x in pairs))
    degrees = (len(results) - 1) * len(names)
    return JointTest(statistic, degrees, float(chi2.sf(statistic, degrees)))


def _stretch(results: Iterable[Result], name: str) -> float:
    """Return by how much the maneuvers of results widen the error of a parameter; at least 1."""
    counted = (r for r in results if _alone(r, name).counted)
    ratios = [_by_maneuvers([name], r.uncertainty, r.components).get(name, 1.0) for r in counted]
    return max([1.0, *ratios])


def _digests(result: Result) -> dict[str, str]:
    """Return the contents of the flights that were fitted, by name."""
    flights = {m.flight for m in result.maneuvers}
    return {Path(n).stem: digest for n, digest in result.inputs.items() if {n, Path(n).stem} & flights}


def _alone(result: Result, name: str, std_error: float | None = None) -> SingleEstimate:
    """Return an estimate of a result without its prior, with its corrected or another standard error."""
    p, plain = result.parameters[name], result.uncertainty.get("cramer_rao")
    std = plain.parameters[name].std_error if plain is not None else p.std_error
    ratio = std / p.prior_std
    share = float(np.nan_to_num(ratio * ratio))  # a power raises where a product is infinite
    error = p.std_error if std_error is None else std_error
    one = without_prior(p.estimate, error, share, p.prior_mean, p.prior_std)
    return replace(one, counted=one.counted and p.identifiable and not p.at_bound)


def _estimates(fit: Estimate, bars: ErrorBars) -> dict[str, SingleEstimate]:
    """Return the estimates by name, each without its own prior."""
    entry = dict(zip(bars.free.tolist(), np.diag(bars.uncertainty.cramer_rao).tolist(), strict=True))
    out = {}
    for i, p in enumerate(fit.problem.layout.parameters):
        mean, prior = p.prior_about(fit.estimates[p.name])
        share = float(np.nan_to_num(entry.get(i, np.nan) / prior**2))
        one = without_prior(fit.estimates[p.name], float(bars.std[i]), share, mean, prior)
        counted = one.counted and not bars.at_bound[i] and bars.identifiability[p.name].identifiable
        out[p.name] = replace(one, counted=bool(counted))
    return out

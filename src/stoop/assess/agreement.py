"""Agreement of methods: which estimate of uncertainty to use, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.results.result import ParameterEstimate
from stoop.results.uncertainty import Interval, MethodIntervals

CRAMER_RAO: Final = "cramer_rao"
CORRECTED: Final = "corrected"
BOOTSTRAP: Final = "bootstrap"
POSTERIOR: Final = "posterior"
PROFILE: Final = "profile"
COLORED: Final = 1.25  #: typical factor of the correction from which residuals count as colored
APART: Final = 1.4  #: ratio of standard errors from which two methods disagree
SKEWED: Final = 1.5  #: ratio of the arms of an interval from which it is no longer normal
RHAT: Final = 1.02  #: above it a posterior says nothing yet
NAMED: Final = 8


def method_agreement(
    parameters: Mapping[str, ParameterEstimate], methods: Mapping[str, MethodIntervals]
) -> tuple[str, ...]:
    """Return which method to trust for which parameters, and where the methods disagree.

    Parameters
    ----------
    parameters : mapping of str to ParameterEstimate
    methods : mapping of str to MethodIntervals
        ``corrected`` at least, without it nothing is said; nothing of color without ``cramer_rao``.
    """
    if CORRECTED not in methods:
        return ()
    sure = {name: p for name, p in parameters.items() if p.identifiable and not p.at_bound}
    said = [
        _color(sure, methods),
        _bootstrap(sure, methods),
        *_posterior(sure, methods),
        *_profile(sure, methods),
    ]
    untold = [name for name in parameters if name not in sure]
    if untold:
        said.append(
            f"{_listed(untold)}: the data cannot tell, so no interval is to be trusted as the flight's; "
            "a posterior or profile shows what prior and bounds leave."
        )
    return tuple(sentence for sentence in said if sentence)


def _color(sure: Mapping[str, ParameterEstimate], methods: Mapping[str, MethodIntervals]) -> str:
    ratios = _ratios(sure, methods[CORRECTED], methods[CRAMER_RAO]) if CRAMER_RAO in methods else {}
    if not ratios:
        return ""
    typical = float(np.median(list(ratios.values())))
    if typical < COLORED:
        return "The residuals are white or nearly so: plain Cramer-Rao and corrected errors agree, either may be used."
    return (
        f"The residuals are colored: plain Cramer-Rao errors are {typical:.1f} times too small (median) and are not to be "
        "used; trust the corrected ones."
    )


def _bootstrap(sure: Mapping[str, ParameterEstimate], methods: Mapping[str, MethodIntervals]) -> str:
    if BOOTSTRAP not in methods:
        return ""
    ratios = _ratios(sure, methods[BOOTSTRAP], methods[CORRECTED])
    if not ratios:
        return "The bootstrap has too few replicates to say anything."
    wider = [name for name, ratio in ratios.items() if ratio > APART]
    narrower = [name for name, ratio in ratios.items() if ratio < 1.0 / APART]
    typical = float(np.median(list(ratios.values())))
    begin = f"Bootstrap and corrected errors agree (median ratio {typical:.2f})"
    if not wider and not narrower:
        return f"{begin}: both may be trusted."
    said = [f"wider for {_listed(wider)}, where the model is curved: trust the bootstrap there" if wider else "",
            f"narrower for {_listed(narrower)}: trust the corrected ones there, the wider" if narrower else ""]  # fmt: skip
    return f"{begin} but not everywhere: the bootstrap is {'; and '.join(s for s in said if s)}."


def _posterior(sure: Mapping[str, ParameterEstimate], methods: Mapping[str, MethodIntervals]) -> list[str]:
    if POSTERIOR not in methods:
        return []
    found = methods[POSTERIOR]
    if found.figures.get("rhat", np.inf) > RHAT:
        return ["The posterior has not converged: do not use its intervals."]
    skewed = [
        n for n, p in sure.items() if n in found.parameters and _skewness(p, found.parameters[n]) > SKEWED
    ]
    ratios = _ratios(sure, found, methods[CORRECTED])
    apart = [n for n, ratio in ratios.items() if not 1.0 / APART <= ratio <= APART and n not in skewed]
    if not skewed and not apart:
        return ["The posterior is nearly normal and agrees with the corrected errors: both may be trusted."]
    said = []
    if skewed:
        said.append(
            f"The posterior of {_listed(skewed)} is not normal about the estimate (skewed, or cut off by a bound): trust its "
            "interval there."
        )
    if apart:
        said.append(
            f"Posterior and corrected errors disagree for {_listed(apart)}: the model is curved over the interval, "
            "or a prior holds it; trust the posterior."
        )
    return said


def _profile(sure: Mapping[str, ParameterEstimate], methods: Mapping[str, MethodIntervals]) -> list[str]:
    if PROFILE not in methods:
        return []
    found = methods[PROFILE].parameters
    opened = [n for n, s in found.items() if not (np.isfinite(s.ci95_lower) and np.isfinite(s.ci95_upper))]
    skewed = [n for n, p in sure.items() if n in found and n not in opened and _skewness(p, found[n]) > SKEWED]  # fmt: skip
    said = []
    if opened:
        said.append(
            f"The profile of {_listed(opened)} is open to one side or both: the data give no limit there, whatever "
            "other methods say."
        )
    if skewed:
        said.append(
            f"The profile of {_listed(skewed)} is lopsided: trust it rather than a symmetric interval."
        )
    return said


def _ratios(
    sure: Mapping[str, ParameterEstimate], one: MethodIntervals, other: MethodIntervals
) -> dict[str, float]:
    """Return by how much the standard errors of one method exceed another's, where both have them."""
    pairs = {
        n: (one.parameters[n].std_error, other.parameters[n].std_error)
        for n in sure
        if n in one.parameters and n in other.parameters
    }
    return {n: a / b for n, (a, b) in pairs.items() if np.isfinite([a, b]).all() and b > 0.0}


def _skewness(p: ParameterEstimate, spread: Interval) -> float:
    """Return the longer over the shorter arm of an interval about the estimate; 1 where it has an open end."""
    arms = sorted([p.estimate - spread.ci95_lower, spread.ci95_upper - p.estimate])
    if not np.isfinite(arms).all():
        return 1.0
    return arms[1] / arms[0] if arms[0] > 0.0 else np.inf


def _listed(names: list[str]) -> str:
    shown = names[:NAMED] + ([f"{len(names) - NAMED} more"] if len(names) > NAMED else [])
    return shown[0] if len(shown) == 1 else ", ".join(shown[:-1]) + " and " + shown[-1]

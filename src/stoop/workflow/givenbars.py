"""Error bars of methods that give a covariance with their estimates."""

from __future__ import annotations

import numpy as np

from stoop.assess.covariance import invert, standard_errors
from stoop.assess.identifiability import Identifiability, Yardstick, identifiability
from stoop.estimate.fit import Fit
from stoop.workflow.errorbars import ErrorBars

UNTOUCHED = "the method does not estimate it"
UNSEEN = "the data do not see it, alone or apart from others"


def error_bars(fit: Fit, _color: float) -> ErrorBars:
    """Return the error bars of a fit that has a covariance of its own.

    A regression looks at no box: nothing is held by a bound. What it did not estimate has zero variance; what the
    data do not see has an infinite one.
    """
    layout, covariance = fit.problem.layout, fit.covariance
    if covariance is None:
        raise ValueError("the method gave no covariance")
    d = layout.dimension
    own = covariance[:d, :d]
    seen = np.isfinite(np.diag(own))
    known = np.flatnonzero(seen & (np.diag(own) > 0.0))
    names = [p.name for p in layout.parameters]
    start = np.array([p.value for p in layout.parameters])
    estimate = np.array([fit.estimates[n] for n in names])
    nothing = np.full(d, np.inf)
    yardstick = Yardstick(nothing[known], layout.width[known], np.maximum(abs(start), abs(estimate))[known])
    block = own[np.ix_(known, known)]
    found = identifiability([names[i] for i in known], invert(block).matrix, block, yardstick)
    whys = {name: UNTOUCHED if s else UNSEEN for name, s in zip(names, seen, strict=True)}
    judged = {name: Identifiability(name, False, why, np.inf, np.inf, 0.0) for name, why in whys.items()}
    return ErrorBars(
        covariance=covariance,
        white=np.full(len(fit.z), np.nan) if fit.white is None else standard_errors(fit.white),
        held=np.zeros(len(fit.z), dtype=np.bool_),
        judged=judged | {j.name: j for j in found},
        leaning=(),
    )

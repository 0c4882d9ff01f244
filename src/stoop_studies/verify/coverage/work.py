"""One flight of a campaign: fly, identify as users do, keep estimates and error bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stoop.assess.error_bars import error_bars
from stoop.base.arrays import FloatArray
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop_studies.verify.coverage.cases import CASES


def cover(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[dict[str, Any]]:
    """Return one flight's estimates; see `stoop.parallel.Run`.

    Parameters
    ----------
    arguments : mapping
        ``case`` and ``seed``.
    stops : sequence
        One: nothing is shared.

    Returns
    -------
    list of dict
        ``errors`` (estimate less truth), ``sigma`` and ``cramer_rao`` (standard errors; None where a bound holds the
        parameter) by the order of ``names``, and ``status`` of the search.
    """
    case, seed = CASES[arguments["case"]], int(arguments["seed"])
    scene, options = case.fly(seed), Options(seed=seed, method=case.method)
    fit = methods.find(case.method).fitter()(scene.start, scene.flights, scene.windows, options, None, None)
    bars, count = error_bars(fit), len(scene.truth)
    held = bars.at_bound[:count]
    found = {
        "names": list(scene.truth),
        "errors": [fit.estimates[name] - value for name, value in scene.truth.items()],
        "sigma": _told(bars.std[:count], held),
        "cramer_rao": _told(bars.cramer_rao_std[:count], held),
        "status": fit.outcome.status,
    }
    return [found for _ in stops]


def _told(sigma: FloatArray, held: Any) -> list[float | None]:
    return [None if h or not np.isfinite(s) else float(s) for s, h in zip(sigma, held, strict=True)]

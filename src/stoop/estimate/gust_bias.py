"""By how much gusts bias estimates of a method that knows of none, without another fit.

A few steps of Fisher's scoring of filter error, from those estimates on and with gusts in the model, go most of the way to its
maximum; the way of each parameter is its bias with the sign changed, and the inverse of the information its standard error.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.base.blas import on_one_blas_thread
from stoop.base.notices import Notice, notice
from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate
from stoop.estimate.filter_gains import Noise, Steady, first_guess
from stoop.estimate.filter_likelihood import SCORING, Likelihood
from stoop.estimate.fit import DEFAULTS, estimation_problem
from stoop.estimate.fitted_filter import with_gusts
from stoop.estimate.gusts import with_turbulence
from stoop.estimate.linearization import undelayed
from stoop.estimate.scoring import ScoringModel
from stoop.flight import Flight
from stoop.optimize.levenberg_marquardt import Stages, TenfoldDamping
from stoop.problem import Nuisance
from stoop.problem.evidence import invert

STEPS: Final = 3  #: of scoring; in a flight where they go wrong, eight do no better
MIN_BIAS: Final = 2.0  #: standard errors of filter error, from which a parameter is named
SHOWN: Final = 6  #: parameters that are named


def gust_bias(fit: Estimate, flights: Mapping[str, Flight]) -> tuple[Notice, ...]:
    """Return which parameters gusts bias in a fit that ignores them, and by how much."""
    biases = gust_biases(fit, flights)
    named = sorted(
        (n for n, (_, size) in biases.items() if abs(size) > MIN_BIAS), key=lambda n: -abs(biases[n][1])
    )
    shown = tuple(f"{n} {biases[n][0]:+.3g} ({biases[n][1]:+.1f})" for n in named[:SHOWN])
    return (notice("gusts-bias", parameters=shown, count=len(named)),) if named else ()


@on_one_blas_thread
def gust_biases(fit: Estimate, flights: Mapping[str, Flight]) -> dict[str, tuple[float, float]]:
    """Return the bias of each parameter, SI and in standard errors of filter error; none where no filter applies."""
    own, vehicle = fit.problem.layout, with_turbulence(fit.problem.layout.vehicle)
    try:
        problem = with_gusts(estimation_problem(vehicle, flights, fit.prepared.windows, DEFAULTS)[0])
        shifted = undelayed(problem)
    except IdentificationError:  # a free delay of a sensor
        return {}
    layout, names = problem.layout, [p.name for p in own.parameters]
    # slow motion is nearer the truth by the weights of white noise
    begun = dict(zip([*names, *map(_key, own.nuisances)], fit.white.tolist(), strict=True))
    start = [begun.get(p.name, float(x)) for p, x in zip(layout.parameters, layout.start, strict=True)]
    noise = Noise(vehicle, first_guess(vehicle, problem.pieces))
    z = np.array([*start, *(begun.get(_key(n), 0.0) for n in layout.nuisances), *noise.start])
    model = ScoringModel(Likelihood.of(shifted, noise, Steady(), z), z, 0.0)
    if not np.isfinite(model.cost):
        return {}
    Stages(SCORING, 1.0).search(model, TenfoldDamping(1e-6, growth=4.0, smallest=1e-9), STEPS)
    model.linearize()
    errors = np.full(len(z), np.nan)
    errors[model.free] = np.sqrt(np.diag(invert(model.information).matrix))
    found = dict(zip(names, fit.z.tolist(), strict=False))
    rows = [(p.name, i) for i, p in enumerate(layout.parameters) if p.name in found]
    away = [(n, i, found[n] - model.z[i]) for n, i in rows]
    return {n: (float(x * layout.scales[i]), float(x / errors[i])) for n, i, x in away}


def _key(n: Nuisance) -> tuple[str, int, int | None]:
    return n.name, n.maneuver, n.piece

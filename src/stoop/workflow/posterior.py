"""The posterior of a fit: sampled, summarized, and as a file for ArviZ."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop.assess.ensemble import ESS, RHAT, Chains, libraries, sample
from stoop.assess.estimate import Uncertainty
from stoop.assess.optimum import linearize
from stoop.assess.posterior import Target, reference, stretch
from stoop.base.arrays import FloatArray
from stoop.results.uncertainty import Interval, MethodIntervals
from stoop.workflow.case import Case, Finding, Watch

FILE: Final = "posterior.nc"
KEPT: Final = 250  #: draws of each walker in the file, at most
CHECKED: Final = 16  #: draws at which the marginalization is checked
FAR: Final = 0.5  #: of the log density, by which it may be off


@dataclass(frozen=True)
class Posterior:
    """Sample the posterior of the parameters; initial states and biases are marginalized."""

    name: str = field(default="posterior", init=False)

    def __call__(self, case: Case, watch: Watch) -> Finding:
        """Return standard deviations and equal-tailed intervals, and the draws as ``posterior.nc``."""
        libraries()
        with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
            target = _target(case)
            chains = sample(
                target, reference(target), case.seed, lambda n: watch(f"posterior: {n} steps of every walker")
            )
            every = chains.draws.reshape(-1, target.size)
            checked = every[np.linspace(0, len(every) - 1, CHECKED).astype(int)]
            error = float(np.max(np.abs(target.error(checked))))
        chains = Chains(chains.draws, chains.density, {**chains.figures, "marginalization_error": error})
        return Finding(_spread(case, chains), {FILE: _file(case, chains)})


def _target(case: Case) -> Target:
    """Return the posterior; its likelihood is stretched to the covariance corrected for color, where there is one."""
    fit = case.fit
    optimum = linearize(fit.problem, fit.z, np.arange(len(fit.z)))
    plain = Target(optimum, np.eye(optimum.shared))
    covariance = _corrected(case, case.found, plain)
    return plain if covariance is None else Target(optimum, stretch(plain.information, covariance))


def _corrected(case: Case, found: Uncertainty, plain: Target) -> FloatArray | None:
    """Return the corrected covariance of the parameters in the unit box; None where something is not determined.

    Parameters at a bound keep the variance that the weights give them.
    """
    k, width = plain.size, case.fit.problem.layout.width
    free = case.free[case.free < k]
    corrected = found.corrected[: len(free), : len(free)] / np.outer(width[free], width[free])
    if not (np.isfinite(corrected).all() and np.all(np.linalg.eigvalsh(plain.information) > 0.0)):
        return None
    covariance = np.linalg.inv(plain.information)
    held = np.setdiff1d(np.arange(k), free)
    out = np.zeros((k, k))
    out[np.ix_(free, free)] = corrected
    out[np.ix_(held, held)] = covariance[np.ix_(held, held)]
    return out


def _spread(case: Case, chains: Chains) -> MethodIntervals:
    layout = case.fit.problem.layout
    values = layout.physical(chains.draws.reshape(-1, layout.dimension))
    lower, upper = np.quantile(values, [0.025, 0.975], axis=0)
    parameters = {
        name: Interval(float(s), float(a), float(b))
        for name, s, a, b in zip(case.names, values.std(axis=0), lower, upper, strict=True)
    }
    return MethodIntervals(parameters, chains.figures, tuple(_notes(chains)))


def _notes(chains: Chains) -> list[str]:
    f, notes = chains.figures, []
    if not chains.converged:
        notes.append(
            f"The walkers have not converged (R-hat {f['rhat']:.3f}, wanted {RHAT}; effective sample size "
            f"{min(f['ess_bulk'], f['ess_tail']):.0f}, wanted {ESS:.0f}): the posterior's ends are approximate."
        )
    if f["marginalization_error"] > FAR:
        notes.append(
            "Initial states and biases do not enter linearly over the width of the posterior (log density off by up to "
            f"{f['marginalization_error']:.1f}): its ends are approximate."
        )
    return notes


def _file(case: Case, chains: Chains) -> bytes:
    """Return an ArviZ InferenceData as NetCDF, SI units, thinned."""
    _, arviz = libraries()
    layout = case.fit.problem.layout
    thin = max(1, chains.draws.shape[1] // KEPT)
    draws = chains.draws[:, ::thin]
    values = layout.lower + draws * layout.width
    data = arviz.from_dict(
        posterior={p.name: values[:, :, i] for i, p in enumerate(layout.parameters)},
        sample_stats={"lp": chains.density[:, ::thin]},
        attrs={"inference_library": "emcee", "seed": case.seed, **chains.figures, "thin": thin},
    )
    for p in layout.parameters:
        data.posterior[p.name].attrs["units"] = p.unit
    with tempfile.TemporaryDirectory(prefix="stoop-") as folder:
        path = Path(folder) / FILE
        data.to_netcdf(str(path), engine="h5netcdf")
        return path.read_bytes()

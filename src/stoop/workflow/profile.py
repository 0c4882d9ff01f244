"""Profile likelihoods of doubtful parameters, one parameter a run of a campaign."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_limits

from stoop.assess.covariance import NORMAL_95
from stoop.assess.optimum import Optimum, linearize
from stoop.assess.profile import profile
from stoop.base.text import nearest
from stoop.errors import IdentificationError
from stoop.parallel import Json, LocalProcesses, Plan, Pool, Run, Tally, execute
from stoop.results.uncertainty import Interval, MethodIntervals
from stoop.workflow.case import Case, Finding, Watch
from stoop.workflow.posed import pack, unpack

WORK: Final = "stoop.workflow.profile:profiles"
DOUBTFUL: Final = "doubtful"
ONLY: Final = (
    "only the doubtful parameters, or those that were named, were profiled; the others have no entry."
)
BETTER: Final = 0.1  #: statistic by which a refit must fall below the fit's optimum for it to be said


@dataclass(frozen=True)
class Profile:
    """Hold one parameter after the other on a row of values and refit the others.

    Attributes
    ----------
    parameters : tuple of str
        Names; ``doubtful`` stands for all whose identifiability is in doubt, or that lie at a bound.
    pool : Pool
    store : Path, optional
        What is done is kept there, and not done again; in a temporary folder when absent.
    """

    parameters: tuple[str, ...] = (DOUBTFUL,)
    pool: Pool = field(default_factory=LocalProcesses)
    store: Path | None = None

    name: str = field(default="profile", init=False)

    def __call__(self, case: Case, watch: Watch) -> Finding:
        """Return likelihood-ratio intervals; NaN for an end that the data leave open."""
        names = chosen(case, self.parameters)
        plan = profile_plan(case, names)

        def tell(done: Tally) -> None:
            watch(f"profile: {done.done} of {done.total} parameters {done.note}".rstrip())

        if self.store is not None:
            return Finding(_spread(case, execute(plan, self.store, self.pool, tell)))
        with tempfile.TemporaryDirectory(prefix="stoop-") as folder:
            return Finding(_spread(case, execute(plan, Path(folder) / "profile.sqlite", self.pool, tell)))


def chosen(case: Case, wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters that are profiled.

    Raises
    ------
    IdentificationError
        A name that is not free.
    """
    check_names(case.names, wanted)
    doubtful = [
        name
        for name, held in zip(case.names, case.bars.held, strict=False)
        if held or case.bars.judged[name].reason
    ]
    asked = [name for one in wanted for name in (doubtful if one == DOUBTFUL else [one])]
    return tuple(dict.fromkeys(asked))


def check_names(free: Sequence[str], wanted: Sequence[str]) -> None:
    """Refuse a name that is not among the free parameters.

    Raises
    ------
    IdentificationError
    """
    for name in wanted:
        if name != DOUBTFUL and name not in free:
            raise IdentificationError(f"profile '{name}': no free parameter; {nearest(name, free)}")


def profile_plan(case: Case, names: Sequence[str]) -> Plan:
    """Return the campaign: one run a parameter."""
    problem = pack(case.fit.problem, {"z": case.fit.z, "free": case.free})
    digest = hashlib.sha256(problem.encode()).hexdigest()
    factors = dict(zip(case.free.tolist(), case.found.coloring_factor.tolist(), strict=True))
    runs = []
    for name in names:
        entry = case.names.index(name)
        factor = factors.get(entry, np.nan)
        told = {"problem": problem, "entry": entry, "factor": factor if np.isfinite(factor) else 1.0}
        runs.append(Run(name, WORK, told))
    return Plan("profile likelihoods of a fit", {"problem": digest}, tuple(runs))


def profiles(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Return the profile of one parameter, in the unit box: the work of a run."""
    given: Any = arguments
    with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
        found = profile(_ready(str(given["problem"])), int(given["entry"]), float(given["factor"]))
    told: dict[str, Json] = {
        "ends": [found.lower, found.upper],
        "points": found.points.tolist(),
        "better": found.better,
    }
    return [told for _ in stops]


@lru_cache(maxsize=1)
def _ready(text: str) -> Optimum:
    problem, arrays = unpack(text)
    return linearize(problem, arrays["z"], arrays["free"].astype(np.intp))


def _spread(case: Case, results: Mapping[str, Any]) -> MethodIntervals:
    layout, parameters, notes = case.fit.problem.layout, {}, []
    for name, told in results.items():
        entry = case.names.index(name)
        low, high = (layout.lower[entry] + layout.width[entry] * float(end) for end in told["ends"])
        parameters[name] = Interval(float(high - low) / (2.0 * NORMAL_95), float(low), float(high))
        notes += _open(name, layout.parameters[entry].lower, layout.parameters[entry].upper, low, high)
        if told["better"] > BETTER:
            notes.append(
                f"{name}: holding it led to a better fit than the search had found; run the search again from "
                "other starts."
            )
    if len(parameters) < len(case.names):
        notes.insert(0, ONLY)
    refits = sum(len(told["points"]) - 1 for told in results.values())
    return MethodIntervals(parameters, {"refits": float(refits)}, tuple(notes))


def _open(name: str, lowest: float, highest: float, low: float, high: float) -> list[str]:
    """Say which ends are open."""
    below = [f"no lower limit down to its bound {lowest:g}"] if not np.isfinite(low) else []
    above = [f"no upper limit up to its bound {highest:g}"] if not np.isfinite(high) else []
    return [f"{name}: the data give {' and '.join([*below, *above])}."] if below or above else []

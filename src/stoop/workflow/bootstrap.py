"""The bootstrap of a fit as a campaign: replicates in chunks, on any pool, into a store that survives kills."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from stoop.assess.blocks import Blocks, blocks
from stoop.assess.bootstrap import FEWEST, percentiles, replicates, tally
from stoop.assess.noise import ColoredNoise
from stoop.assess.optimum import Optimum, linearize
from stoop.base.arrays import FloatArray
from stoop.parallel import Json, LocalProcesses, Plan, Pool, Run, Tally, execute
from stoop.results.uncertainty import MethodIntervals
from stoop.workflow.case import Case, Finding, Watch, spreads
from stoop.workflow.posed import pack, unpack

CHUNK: Final = 25  #: replicates of one run: what a kill may cost
WORK: Final = "stoop.workflow.bootstrap:refits"
OFTEN_LOST: Final = 0.02  #: share of replicates without an optimum from which it is said


@dataclass(frozen=True)
class Bootstrap:
    """Refit the fit to its own curves with noise like its residuals, many times.

    Attributes
    ----------
    replicates : int
    pool : Pool
        Where they are refitted.
    store : Path, optional
        What is done is kept there, and not done again; in a temporary folder when absent.
    """

    replicates: int = 1000
    pool: Pool = field(default_factory=LocalProcesses)
    store: Path | None = None

    name: str = field(default="bootstrap", init=False)

    def __call__(self, case: Case, watch: Watch) -> Finding:
        """Return standard errors and bias-corrected percentile intervals."""
        plan = bootstrap_plan(case, self.replicates)

        def tell(done: Tally) -> None:
            watch(f"bootstrap: {done.done * CHUNK} of {done.total * CHUNK} replicates {done.note}".rstrip())

        if self.store is not None:
            return Finding(_spread(case, execute(plan, self.store, self.pool, tell)))
        with tempfile.TemporaryDirectory(prefix="stoop-") as folder:
            return Finding(_spread(case, execute(plan, Path(folder) / "bootstrap.sqlite", self.pool, tell)))


def bootstrap_plan(case: Case, count: int) -> Plan:
    """Return the campaign: `count` replicates, rounded up to whole chunks."""
    noise = case.found.noise
    optimum = {"z": case.fit.z, "free": case.free}
    problem = pack(case.fit.problem, {**optimum, "color": noise.coefficients, "innovation": noise.innovation})
    digest = hashlib.sha256(problem.encode()).hexdigest()
    runs = tuple(
        Run(f"{first:06d}", WORK, {"problem": problem, "seed": case.seed, "first": first, "count": CHUNK})
        for first in range(0, count, CHUNK)
    )
    return Plan("bootstrap of a fit", {"problem": digest, "seed": case.seed}, runs)


def refits(arguments: Mapping[str, Json], stops: Sequence[int | None]) -> list[Json]:
    """Refit one chunk of replicates: the work of a run.

    Parameters
    ----------
    arguments : mapping
        ``problem``: see :func:`stoop.workflow.posed.pack`; ``seed``; ``first``, ``count``: which replicates.
    stops : sequence of None

    Returns
    -------
    list of dict, one per stop
        ``values``: parameters of each replicate, SI; ``endings``.
    """
    first, count, seed = (int(_number(arguments[name])) for name in ("first", "count", "seed"))
    with threadpool_limits(limits=1, user_api="blas"):  # more threads would round differently
        optimum, noise, present = _ready(str(arguments["problem"]))
        found = replicates(optimum, noise, present, range(first, first + count), seed)
    values = _physical(optimum, found.z)  # NaN for those that were lost
    told: dict[str, Json] = {"values": values.tolist(), "endings": list(found.endings)}
    return [told for _ in stops]


def _physical(optimum: Optimum, z: FloatArray) -> FloatArray:
    problem: Any = optimum.problem
    return np.asarray(problem.layout.physical(z))


def _number(value: Json) -> float:
    if not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return value


@lru_cache(maxsize=1)
def _ready(text: str) -> tuple[Optimum, Blocks, list[NDArray[np.bool_]]]:
    """Return the optimum, what draws its noise, and where something was measured."""
    problem, arrays = unpack(text)
    optimum = linearize(problem, arrays["z"], arrays["free"].astype(np.intp))
    present = [np.asarray(np.isfinite(piece.measured)) for piece in problem.pieces]
    residuals, first = [], 0
    for mask in present:
        block = -optimum.residual[first : first + mask.size].reshape(mask.shape)
        residuals.append(np.where(mask, block, np.nan))
        first += mask.size
    return optimum, blocks(ColoredNoise(arrays["color"], arrays["innovation"]), residuals), present


def _spread(case: Case, results: Mapping[str, Json]) -> MethodIntervals:
    parts: list[Any] = list(results.values())
    values = np.concatenate([np.array(part["values"], dtype=np.float64) for part in parts])
    endings = [ending for part in parts for ending in part["endings"]]
    arrived = np.isfinite(values).all(axis=1)
    estimate = np.array(list(case.fit.estimates.values()))
    found = percentiles(estimate, values[arrived])
    figures = tally(endings)
    notes = []
    if arrived.sum() < FEWEST:
        notes.append(f"{arrived.sum()} replicates have an optimum; {FEWEST} are needed for intervals.")
    if figures["lost"] > OFTEN_LOST * figures["replicates"]:
        notes.append(
            f"{figures['lost']:.0f} of {figures['replicates']:.0f} replicates found no optimum and are left out: the intervals "
            "are those of the others, and too narrow."
        )
    return MethodIntervals(spreads(case, found.std, found.lower, found.upper), figures, tuple(notes))

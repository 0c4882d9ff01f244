"""Many runs of one plan on any executor, into one store, resumable after whatever stopped them.

A `Plan` is a tuple of runs; a `Run` names a function and its arguments. `execute` does what is not yet done::

    runs = tuple(Run(f"{seed:04d}", "my_module:fly", {"seed": seed}) for seed in range(1000))
    results = execute(Plan("gusts", {"version": 1}, runs), Path("gusts.sqlite"), LocalProcesses())

This room knows nothing of aircraft or optimizers.
"""

from stoop.errors import CampaignError
from stoop.parallel.canonical import Json
from stoop.parallel.cluster import Dask
from stoop.parallel.environment import environment, source_digest
from stoop.parallel.loop import Tally, execute
from stoop.parallel.plan import Plan, Run
from stoop.parallel.pool import Given, Hands, Pool
from stoop.parallel.processes import LocalProcesses

__all__ = [
    "CampaignError",
    "Dask",
    "Given",
    "Hands",
    "Json",
    "LocalProcesses",
    "Plan",
    "Pool",
    "Run",
    "Tally",
    "environment",
    "execute",
    "source_digest",
]

"""Many runs of one plan on any executor, into one store, resumable after any interruption.

A `Plan` is a tuple of runs; a `Run` names a function and its arguments. `execute` computes what is not yet done::

    runs = tuple(Run(f"{seed:04d}", "my_module:fly", {"seed": seed}) for seed in range(1000))
    results = execute(Plan("gusts", {"version": 1}, runs), Path("gusts.sqlite"), LocalProcesses())

This room is independent of aircraft and optimizers.
"""

from stoop.errors import CampaignError
from stoop.parallel.loop import Tally, execute
from stoop.parallel.plan import Json, Plan, Run
from stoop.parallel.pools import Dask, Given, LocalProcesses, Pool
from stoop.parallel.worker import environment, source_digest

__all__ = [
    "CampaignError", "Dask", "Given", "Json", "LocalProcesses", "Plan", "Pool", "Run", "Tally", "environment", "execute",
    "source_digest",
]  # fmt: skip

"""The campaign of test_campaign_kills, as a command of its own: ``campaign_case.py STORE TABLE [--workers N ...]``.

Each task is a search by differential evolution, of some 20 ms, whose state after the first stop is carried on to the second.
"""

from __future__ import annotations

import argparse
import csv
import io
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

LOG = "STOOP_TEST_LOG"
TASKS, STOPS = 400, (20, 60)


class Decay:
    """Two exponentials, fitted to their own sum at 40 moments: y(t) = a exp(-b t) + c exp(-d t), all in [0, 1]."""

    dimension, extra, prices = 4, 0, (1.0,)

    def __init__(self, seed: int) -> None:
        import numpy as np

        self.t = np.linspace(0.0, 5.0, 40)
        self.y = self.values(np.random.default_rng(seed).uniform(0.1, 0.9, (1, 4)))

    def values(self, X: Any) -> Any:
        import numpy as np

        a, b, c, d = X.T[:, :, None]
        return a * np.exp(-b * self.t) + c * np.exp(-d * self.t)

    def costs(self, X: Any, rung: int) -> Any:
        return ((self.values(X) - self.y) ** 2).sum(axis=1)

    def reference(self, rung: int) -> float:
        return float((self.y**2).sum())


def search(arguments: Mapping[str, Any], stops: Sequence[int]) -> list[Any]:
    """Write down that this is executed, then search."""
    from stoop import optimize

    with Path(os.environ[LOG]).open("a") as log:
        log.write(f"{arguments['seed']}\n")
    problem, optimizer, state, results = Decay(arguments["seed"]), optimize.create("de-rand-1-bin"), None, []
    for stop in stops:
        outcome = optimize.minimize(
            optimizer, problem, seed=arguments["seed"], stop=optimize.Stop(generations=stop), state=state
        )
        state = outcome.state
        results.append({"cost": outcome.cost, "z": outcome.z.tolist(), "generation": outcome.generation})
    return results


def main() -> int:
    from stoop.base.files import write_text_atomic
    from stoop.base.verbs import shared_options
    from stoop.cli.options import add_options
    from stoop.cli.progress import run_campaign
    from stoop.errors import StoopError
    from stoop.parallel import Plan, Run

    parser = argparse.ArgumentParser()
    parser.add_argument("store", type=Path)
    parser.add_argument("table", type=Path)
    add_options(parser, (shared_options()["workers"], shared_options()["scheduler"]))
    arguments = parser.parse_args()
    runs = tuple(
        Run(f"{seed:03d}/{stop}", "campaign_case:search", {"seed": seed}, stop)
        for seed in range(TASKS)
        for stop in STOPS
    )
    try:
        results = run_campaign(arguments, Plan("decay", {}, runs), arguments.store)
    except StoopError as error:
        print(f"stoop: error: {error}", file=sys.stderr)
        return 2
    table = io.StringIO()
    csv.writer(table).writerows([key, r["generation"], r["cost"], *r["z"]] for key, r in results.items())
    write_text_atomic(arguments.table, table.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""The campaign of test_campaign_kills, as a command of its own: ``campaign_case.py STORE TABLE [--workers N ...]``.

Each task walks a logistic map for some 20 ms, as far as the first stop and on to the second.
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

LOG, TASKS, STOPS = "STOOP_TEST_LOG", 400, (100_000, 200_000)


def walk(arguments: Mapping[str, Any], stops: Sequence[int]) -> list[Any]:
    with Path(os.environ[LOG]).open("a") as log:
        log.write(f"{arguments['seed']}\n")
    x, step, results = 0.1 + arguments["seed"] / 1000.0, 0, []
    for stop in stops:
        for _ in range(step, stop):
            x = 3.9 * x * (1.0 - x)
        step = stop
        results.append({"x": x, "step": step})
    return results


def main() -> int:
    from stoop.base.files import write_file
    from stoop.base.verbs import add_options, shared_options
    from stoop.cli.progress import run_campaign
    from stoop.parallel import Plan, Run

    parser = argparse.ArgumentParser()
    parser.add_argument("store", type=Path)
    parser.add_argument("table", type=Path)
    add_options(parser, (shared_options()["workers"], shared_options()["scheduler"]))
    arguments, cases = parser.parse_args(), ((seed, stop) for seed in range(TASKS) for stop in STOPS)
    runs = tuple(Run(f"{n:03d}/{stop}", "campaign_case:walk", {"seed": n}, stop) for n, stop in cases)
    results = run_campaign(arguments, Plan("walks", {}, runs), arguments.store)
    write_file(arguments.table, "".join(f"{key},{r['x']!r}\n" for key, r in results.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())

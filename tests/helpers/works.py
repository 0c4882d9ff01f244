"""What the campaigns of these tests do."""

import os
import signal
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np  # so that there is a BLAS to ask

from stoop.errors import IdentificationError
from stoop.parallel import Plan, Run

HERE = "helpers.works"


def note(arguments: Mapping[str, Any], text: str) -> None:
    with Path(arguments["log"]).open("a") as log:
        log.write(f"{text}\n")


def walk(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Walk a logistic map from a seed; return where it is at each stop."""
    note(arguments, f"{arguments['seed']} {list(stops)}")
    x, step, found = 0.1 + arguments["seed"] / 1000.0, 0, []
    for stop in stops:
        while step < (100 if stop is None else stop):
            x, step = 3.9 * x * (1.0 - x), step + 1
        found.append({"x": x, "step": step})
    return found


def fail(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Fail in the way that is asked for, or die, or come back with the wrong thing."""
    how, advice = arguments["how"], "elevator: does not move; choose another\nattached"
    errors = {
        "stoop": IdentificationError(advice),
        "plain": ValueError("first\nsecond"),
        "leave": SystemExit(3),
    }
    if how in errors:
        raise errors[how]
    if how == "die once" and not Path(arguments["log"]).exists():
        note(arguments, "died")
        how = "die"
    if how == "die":
        os._exit(7)
    return {"array": [np.zeros(2)], "short": []}.get(how, [how])


def threads(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Return how many threads kernels and linear algebra may use, and this process."""
    import threadpoolctl

    from stoop.kernels.kernel import thread_count

    blas = [pool["num_threads"] for pool in threadpoolctl.threadpool_info()]
    env = os.environ.get("OMP_NUM_THREADS")
    return [{"kernels": thread_count(), "blas": blas, "pid": os.getpid(), "env": env}]


def walks(log: Path, seeds: int, stops: Sequence[int | None] = (None,)) -> Plan:
    keys = [{"seed": seed, "log": str(log)} for seed in range(seeds)]
    runs = [Run(f"{key['seed']:03d}/{stop}", f"{HERE}:walk", key, stop) for stop in stops for key in keys]
    return Plan("walks", {"map": "logistic"}, tuple(runs))


def failing(how: str, log: Path, others: int = 0) -> Plan:
    bad = Run("bad", f"{HERE}:fail", {"how": how, "log": str(log)})
    return Plan("walks", {"map": "logistic"}, (*walks(log, others).runs, bad))


def sleep(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    time.sleep(arguments["seconds"])
    return [None for _ in stops]


def sockets(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Return the internet sockets of this process, and the named ones that listen."""
    own = []
    for entry in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            own.append(str(entry.readlink()))
    inodes = {name[8:-1] for name in own if name.startswith("socket:[")}
    found = []
    for kind in ("tcp", "tcp6", "udp", "udp6", "raw"):
        table = Path(f"/proc/net/{kind}")
        lines = table.read_text().splitlines()[1:] if table.exists() else []
        found += [kind for line in lines if line.split()[9] in inodes]
    for line in Path("/proc/net/unix").read_text().splitlines()[1:]:
        parts = line.split()
        if parts[6] in inodes and parts[3] == "00010000":  # __SO_ACCEPTCON
            found.append("unix")
    return [found for _ in stops]


def interrupted(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[Any]:
    """Get a signal and answer it with the best so far, as a search does."""
    try:
        signal.raise_signal(arguments["signal"])
    except KeyboardInterrupt:
        return ["best so far" for _ in stops]
    return ["whole" for _ in stops]

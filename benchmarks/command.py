"""A command of stoop as a process of its own: wall time and processor time."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Run:
    """One run of the command: wall time to the last awaited line and to the end, processor time, s."""

    shown: float
    ended: float
    processor: float


def timed(
    words: Sequence[str],
    cache: Path,
    awaited: Sequence[str] = (),
    variables: Mapping[str, str] | None = None,
    cores: int | None = None,
) -> Run:
    """Run stoop; note when every awaited name has begun a printed line.

    Parameters
    ----------
    words : sequence of str
        Arguments of stoop.
    cache : path
        Folder of compiled kernels.
    awaited : sequence of str
        First words of lines.
    variables : mapping, optional
        Further environment variables.
    cores : int, optional
        Processors that the process may use; all by default.
    """
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    before, begun, shown = _processor(), time.perf_counter(), 0.0
    missing = set(awaited)
    with subprocess.Popen(
        [sys.executable, "-m", "stoop", *words],
        env=os.environ | {"STOOP_CACHE_DIR": str(cache), **(variables or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        preexec_fn=lambda: os.sched_setaffinity(0, allowed),
    ) as child:
        for line in child.stdout or ():
            missing.discard(next(iter(line.split()), ""))
            if awaited and not missing and not shown:
                shown = time.perf_counter() - begun
    ended = time.perf_counter() - begun
    if child.returncode or missing:
        raise RuntimeError(
            f"stoop {words[0]}: exit code {child.returncode}, not printed: {missing or 'none'}"
        )
    return Run(shown, ended, _processor() - before)


def _processor() -> float:
    """Return the processor time of finished children, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime

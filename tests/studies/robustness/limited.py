"""Commands as processes of their own, under limits of the system."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from studies.robustness.trials import READ, REFUSED, Ended

MEMORY: Final = 1_500_000_000  #: bytes of address space
WALL: Final = 120.0  #: s
SCRIPT: Final = """
import atexit, re, resource, sys
def note():
    own = int(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1])
    others = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    with open({memory!r}, "r+") as file:
        file.write(str(1024 * max(own, others)))
atexit.register(note)
from stoop.cli.main import main
for what, most in {limits!r}.items():
    resource.setrlimit(what, (most, most))
sys.argv[0] = "stoop"
sys.exit(main())
"""  #: runs a command, and leaves the largest memory of itself and its children (of the latter with what they began with)


class Run(NamedTuple):
    """A command that has ended: its code (negative: a signal), its errors, and the largest memory of its processes, bytes."""

    code: int
    errors: str
    memory: int

    @property
    def ended(self) -> Ended:
        complaints = [line for line in self.errors.splitlines() if line.startswith("stoop: error: ")]
        if self.code in (0, 2) and len(complaints) == self.code // 2 and "Traceback" not in self.errors:
            return Ended(REFUSED, complaints[0]) if complaints else Ended(READ)
        return Ended("crash" if self.code < 0 else "fault", f"code {self.code}: {self.errors[-600:]}")


def run(words: Sequence[str], folder: Path, limits: Mapping[int, int] | None = None) -> Run:
    """Run a command in a folder under limits (of `resource`), 1.5 GB of memory unless others are given."""
    bounds = {resource.RLIMIT_AS: MEMORY} if limits is None else limits
    errors, memory = (folder.parent / f"{folder.name}.{name}" for name in ("err", "memory"))
    memory.write_text("0")
    script = SCRIPT.format(limits=dict(bounds), memory=str(memory))
    with errors.open("wb") as said:
        child = subprocess.Popen(
            [sys.executable, "-c", script, *words], cwd=folder, stdout=subprocess.DEVNULL, stderr=said, stdin=subprocess.DEVNULL,
            env={**os.environ, "STOOP_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
        ended = threading.Timer(WALL, child.kill)
        ended.start()
        child.wait()
        ended.cancel()
    return Run(child.returncode, errors.read_bytes().decode("utf-8", "replace"), int(memory.read_text()))

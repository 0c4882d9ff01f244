"""Freed memory is kept: the next arrays of the same size take no fresh pages."""

from __future__ import annotations

import subprocess
import sys

import pytest

CODE = """
import resource
import numpy as np
from stoop.base.memory import keep_freed_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(10):
        arrays = [np.ones(600_000) for _ in range(4)]
        del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

apart = faults()
keep_freed_memory()
faults()
print(apart, faults())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc alone is told")
def test_arrays_that_are_made_again_take_no_fresh_pages() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, check=True, text=True)
    apart, kept = map(int, done.stdout.split())
    assert apart > 10_000  # pages of 4 kB
    assert kept < 0.1 * apart

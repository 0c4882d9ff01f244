from __future__ import annotations

import subprocess
import sys

HEAVY = {"numba", "llvmlite", "xarray", "pandas", "sympy", "pydantic", "matplotlib", "rich"}


def test_optimizers_load_nothing_but_numpy_and_scipy() -> None:
    code = "import sys, stoop.optimize; print(*{name.partition('.')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout
    assert not HEAVY & set(loaded.split())

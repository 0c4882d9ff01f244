"""The one door: heavy libraries are left alone until they are needed."""

from __future__ import annotations

import subprocess
import sys


def test_import_is_light() -> None:
    heavy = {"pandas", "xarray", "pyulog", "scipy", "numba", "sympy"}
    code = f"import sys, stoop.logs; print(*({heavy} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""

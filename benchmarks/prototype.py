"""The prototype's kernel, run beside ours where the shared folder is there; nothing of it enters the package."""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

STEPS = 3000
SHARED = Path(os.environ.get("STOOP_SHARED", Path(__file__).resolve().parents[2] / "shared"))


def kernels() -> Path | None:
    """Return the folder of the kernel prototypes, or None."""
    folder = SHARED / "prototypes" / "kernels"
    return folder if (folder / "k10_sympy_lanes.py").exists() else None


def calls(counts: tuple[int, ...]) -> dict[int, Callable[[], object]]:
    """Return one call of the prototype's cost kernel for each number of candidates; empty where it is not.

    It writes its generated module beside itself, so it works in a copy that is thrown away.
    """
    folder = kernels()
    if folder is None:
        return {}
    with tempfile.TemporaryDirectory(prefix="stoop-prototype-") as scratch:
        for script in folder.glob("*.py"):
            shutil.copy(script, scratch)
        for script_name in ("ref.py", "k10_sympy_lanes.py"):
            subprocess.run([sys.executable, script_name], cwd=scratch, check=True, capture_output=True)
        sys.path.insert(0, scratch)
        try:
            model, module = importlib.import_module("model"), importlib.import_module("k10_module")
            return {count: _call(model, module, count) for count in counts}
        finally:
            sys.path.remove(scratch)


def _call(model: Any, module: Any, count: int) -> Callable[[], object]:
    problem = model.problem(count)
    module.run(*problem, model.DT)  # compiles while the folder is there
    return lambda: module.run(*problem, model.DT)

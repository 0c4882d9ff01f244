"""Modules whose names are imported at their first use: those that the stub beside them imports for editors and type checkers."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

_LINE: Final = re.compile(r"^from (\S+) import (\w+) as \2$", re.MULTILINE)


def places(stub: Path) -> dict[str, str]:
    """Return the module of each name that a stub imports."""
    return {name: place for place, name in _LINE.findall(stub.read_text("utf-8"))}


def attach(module: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a module, whose stub has lines ``from place import name as name``."""
    known = places(Path(file).with_suffix(".pyi"))

    def imported(name: str) -> Any:
        if name not in known:
            raise AttributeError(f"module '{module}' has no attribute '{name}'")
        value = getattr(__import__(known[name], fromlist=[name]), name)
        setattr(sys.modules[module], name, value)
        return value

    return imported, lambda: sorted(known), sorted(known)

"""The interface for packages: names that they may build on, in groups, each a module that imports them at the first use.

A package imports `stoop`, these groups, and packages below it. The stub of a group (``.pyi``) lists its names.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType

__all__ = sorted(path.stem for path in Path(__file__).parent.glob("*.pyi"))


def __getattr__(name: str) -> ModuleType:
    if name not in __all__:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return import_module(f"{__name__}.{name}")


def __dir__() -> list[str]:
    return __all__

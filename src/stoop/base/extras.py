"""The advice to install a package that not every installation has."""

from __future__ import annotations


def install(extra: str) -> str:
    """Return the command that installs an extra; from a clone, as README does, until the package is on an index."""
    return f"pip install '.[{extra}]' in a clone of stoop"

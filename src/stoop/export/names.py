"""Names of files and functions made from a vehicle's name."""

from __future__ import annotations

import re


def file_name(name: str) -> str:
    """Return a name for files and folders that any system takes."""
    out = re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:60].strip("-")
    return out or "vehicle"


def identifier(name: str) -> str:
    """Return a name that a MATLAB function may have."""
    out = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_").lower()[:40].strip("_")
    return out if out[:1].isalpha() else f"vehicle_{out}".strip("_")

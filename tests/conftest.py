"""Where the shared flights, check cases and certified problems lie; CI insists that they are there."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("STOOP_SHARED", Path(__file__).parents[2] / "shared"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of shared data; skip without it, unless in CI, where its absence is a failure."""
    folder = SHARED / "data"
    if not folder.is_dir():
        if os.environ.get("CI"):
            pytest.fail(f"{folder} is missing: in CI the tests on real data must run")
        pytest.skip(f"{folder} is missing: set STOOP_SHARED to the folder that holds data/")
    return folder

"""A small flight file that the verbs can read, flown once."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.cli.main import main

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="session")
def examples() -> Path:
    return EXAMPLES


@pytest.fixture(scope="session")
def flight_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the 3-2-1-1 of the twin-boom aircraft, written by the command line itself."""
    path = tmp_path_factory.mktemp("flights") / "flight.nc"
    maneuver = str(EXAMPLES / "maneuver_3211.toml")
    assert main(["simulate", "twin-boom", "--maneuver", maneuver, "-o", str(path)]) == 0
    return path

"""The flight of the V-tail, read once by each worker."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.flight import Flight, load


@pytest.fixture(scope="session")
def vtail_flight(shared_data: Path) -> Flight:
    return load(shared_data / "altlnt-vtail-8kg-px4" / "flight2")

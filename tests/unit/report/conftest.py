"""The made-up identification, for every test of a report."""

from __future__ import annotations

from types import ModuleType

import pytest
from naive import identification


@pytest.fixture(scope="session")
def examples() -> ModuleType:
    """Return the module that makes identifications."""
    return identification

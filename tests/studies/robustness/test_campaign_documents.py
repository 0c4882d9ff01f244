"""Hostile documents, and verbs on a machine that fails, as the campaign tries them."""

from __future__ import annotations

import pytest
from studies.robustness.campaign import check_surface, surfaces


@pytest.mark.slow
@pytest.mark.parametrize("surface", surfaces("documents", "kills", "full disks"))
def test_hostile_inputs_end_well(surface: str) -> None:
    check_surface(surface)

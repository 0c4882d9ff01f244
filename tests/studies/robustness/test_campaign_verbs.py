"""Complete commands on hostile inputs, as the campaign tries them."""

from __future__ import annotations

import pytest
from studies.robustness.campaign import check_surface, surfaces


@pytest.mark.slow
@pytest.mark.parametrize("surface", surfaces("verbs"))
def test_hostile_inputs_end_well(surface: str) -> None:
    check_surface(surface, slices=0.2)

"""What tests of multiple shooting have in common."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from stoop.errors import IdentificationError
from stoop.estimate.estimate import Estimate


@pytest.fixture(scope="session")
def ends_well() -> Callable[[Callable[[], Estimate]], None]:
    """Return a check that a fit ends in a value with its advice, or in one line."""

    def check(fit: Callable[[], Estimate]) -> None:
        found, error = None, ""
        try:
            found = fit()
        except IdentificationError as problem:
            error = str(problem)
        assert "\n" not in error
        if found is not None:
            assert np.isfinite(found.z).all()
            assert found.outcome.status == "converged" or found.outcome.advice

    return check

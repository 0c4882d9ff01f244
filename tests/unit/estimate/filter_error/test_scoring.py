"""The end of Fisher's scoring."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stoop.estimate.scoring import UNREACHED, ScoringModel

TOLERANCE = 1e-4


class Kinked(SimpleNamespace):
    """Twice a negative logarithm with its least at zero, whose gradient there promises a gain that no step finds."""

    size, known, bounds = 1, 1, (np.array([-1.0]), np.array([1.0]))

    def cost(self, z: np.ndarray) -> float:
        return float(np.abs(z[0]))

    def score(self, z: np.ndarray) -> Any:
        gradient = np.array([np.sqrt(2.0 * self.left)])
        return SimpleNamespace(gradient=gradient, information=np.eye(1))


@pytest.mark.parametrize(
    ("left", "ending"), [(0.5 * UNREACHED * TOLERANCE, "converged"), (2.0 * UNREACHED * TOLERANCE, "stalled")]
)
def test_a_search_that_no_step_improves_has_converged_where_little_seems_left(
    left: float, ending: str
) -> None:
    model = ScoringModel(Kinked(left=left), np.zeros(1), TOLERANCE)  # type: ignore[arg-type]
    assert not model.optimal
    assert model.settled() == ending

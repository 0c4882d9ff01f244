"""Fits that are interrupted and resumed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop import optimize
from stoop.estimate.estimate import Estimate


@pytest.fixture
def resumed(tmp_path: Path) -> Callable[..., Estimate]:
    def check(fit: Callable[..., Estimate], *arguments: Any) -> Estimate:
        trials: list[optimize.Progress] = []
        whole = fit(*arguments, trials.append, None)
        for count in sorted({1, len(trials) // 2, len(trials)}):
            left: list[optimize.Progress] = []

            def stop(progress: optimize.Progress, at: int = count, seen: list[Any] = left) -> None:
                seen.append(progress)
                if len(seen) == at:
                    raise KeyboardInterrupt

            cut = fit(*arguments, stop, None)
            assert cut.outcome.status == "interrupted"
            assert cut.outcome.state is not None
            optimize.save_state(tmp_path / "search.npz", cut.outcome.state)
            left.clear()
            again = fit(*arguments, left.append, optimize.load_tagged(tmp_path / "search.npz")[0])
            assert len(left) == len(trials) - count  # no trial twice
            np.testing.assert_array_equal(again.z, whole.z)
            assert (again.cost, again.trajectories) == (whole.cost, whole.trajectories)
            assert again.outcome.status == whole.outcome.status
            np.testing.assert_array_equal(again.outcome.history, whole.outcome.history)
            np.testing.assert_array_equal(again.measurement_noise, whole.measurement_noise)
            for one, other in zip(again.evidence.pieces, whole.evidence.pieces, strict=True):
                np.testing.assert_array_equal(one.residual, other.residual)
        return whole

    return check

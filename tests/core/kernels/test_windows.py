"""Windows side by side against one call per window."""

import numpy as np
import pytest

from stoop.kernels.windows import windows
from stoop.simulation import trim
from stoop.vehicle.builtin import load_vehicle

DT = 0.02


def test_a_lane_reads_its_own_rows_and_rows_beyond_the_record_are_refused() -> None:
    """Lanes with parameters, starts, rows and lengths of their own, in two records of 60 rows."""
    vehicle = load_vehicle("twin-boom").reduced("longitudinal")
    point, rng = trim(vehicle), np.random.default_rng(4)
    record = point.inputs + 0.02 * rng.standard_normal((120, len(point.inputs)))
    rows = vehicle.parameter_rows(point.changes, 11)
    rows[vehicle.rows["CLalpha"]] *= rng.uniform(0.8, 1.2, 11)
    start = point.start | {"q": 0.1 * rng.standard_normal(11)}
    x = vehicle.initial_states(start, rows, point.inputs[:, None])
    first = np.array([0, 3, 10, 25, 50, 58, 60, 61, 80, 100, 118])
    end = np.where(first < 60, 60, 120)
    steps = np.array([20, 0, 7, 20, 20, 1, 20, 3, 20, 19, 1])
    kernel = vehicle.kernel()
    readings, last = windows(kernel, rows, x, record, first, end, steps, DT)
    assert readings.shape == (11, 21, kernel.sizes[3])
    for b, (a, e, many) in enumerate(zip(first, end, steps, strict=True)):
        one, own = np.ascontiguousarray(rows[:, b : b + 1]), np.ascontiguousarray(x[:, b : b + 1])
        there = min(21, e - a)
        alone = kernel.trajectories(one, own, record[a:e], DT, there)[0]
        assert np.allclose(readings[b, :there], alone, rtol=1e-12, atol=1e-12)
        for k in range(many):
            now, after = (record[[min(a + k + i, e - 1)]].T for i in (0, 1))
            own, _ = kernel.step(one, own, now, after, DT)
        assert np.allclose(last[:, b], own[:, 0], rtol=1e-12, atol=1e-12)
    for before, after in ((0, 1), (1, 0)):
        with pytest.raises(ValueError, match="rows that the record does not have"):
            windows(kernel, rows, x, record, first - before, end + after, steps, DT)
    with pytest.raises(ValueError, match="steps: shape"):
        windows(kernel, rows, x, record, first, end, steps[1:], DT)

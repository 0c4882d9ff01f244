"""Time on a log's own clock: as many samples kept as can be, in order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.logs import recording
from stoop.logs.recording import clean_stream, increasing

STAMPS = st.floats(-5.0, 5.0) | st.integers(-5, 5).map(float) | st.sampled_from([np.nan, np.inf])


def longest_naively(time: list[float]) -> int:
    finite = [t if np.isfinite(t) else float("inf") for t in time]
    best: list[int] = []
    for i, t in enumerate(finite):
        before = [n for n, earlier in zip(best, finite[:i], strict=True) if earlier < t]
        best.append(max(before, default=0) + 1 if np.isfinite(t) else 0)
    return max(best, default=0)


@given(st.lists(STAMPS, max_size=14))
def test_keeps_a_longest_increasing_run(time: list[float]) -> None:
    kept = increasing(np.array(time))
    values = np.array(time)[kept]
    assert np.all(np.diff(kept) > 0)
    assert np.all(np.isfinite(values))
    assert np.all(np.diff(values) > 0.0)
    assert kept.size == longest_naively(time)
    with pytest.MonkeyPatch.context() as patch:  # of a huge log, without memory
        patch.setattr(recording, "MAX_SORTED", 0)
        values = np.array(time)[increasing(np.array(time))]
    assert np.all(np.diff(values) > 0.0)
    assert values.size == 0 or values.max() == max(t for t in time if np.isfinite(t))


def test_one_wild_stamp_costs_one_sample() -> None:
    for wild in (-1e9, 1e9, 0.0, np.nan):
        time = np.arange(100.0)
        time[50] = wild
        stream, defects = clean_stream("gyro", time, {"p": np.arange(100.0)})
        assert (stream.time.size, stream.period) == (99, 1.0)
        assert 50.0 not in stream.columns["p"]
        assert "1 of 100" in str(defects[0])

"""How true the Runge-Kutta steps are: against DOP853 at rtol 1e-13, whose equations are printed apart."""

from __future__ import annotations

import numpy as np

from benchmarks import plain
from benchmarks.case import RATE, Case, full
from benchmarks.clock import FloatArray
from benchmarks.table import Row

PART = "accuracy"


def run() -> list[Row]:
    """Measure the error at 100 Hz, and how it falls when the step is halved."""
    case = full()
    p = plain.plain(case)
    truth = plain.readings(p, plain.exact(p))
    errors = [_error(case, truth, parts) for parts in (1, 2, 4)]
    worst = case.vehicle.outputs[int(errors[0].argmax())]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    return [
        Row(
            PART, "largest error at 100 Hz, of the channel's maximum", float(errors[0].max()),
            at_most=1e-6, note=f"in {worst}, over 30 s; all 12 channels",
        ),
        Row(
            PART, "order of convergence, 200 to 400 Hz", float(np.median(orders[1])), at_least=3.9, at_most=4.1,
            note=f"median of channels; they lie between {orders[1].min():.2f} and {orders[1].max():.2f}",
        ),
        Row(PART, "order of convergence, 100 to 200 Hz", float(np.median(orders[0])), note="median of channels"),
    ]  # fmt: skip


def _error(case: Case, truth: FloatArray, parts: int) -> FloatArray:
    """Return the largest error of each channel in its maximum, with each sample cut into so many steps."""
    flown, rows = case.flown, case.rows(1)
    count = len(flown.time)
    fine = np.arange((count - 1) * parts + 1) / parts
    inputs = np.stack([np.interp(fine, np.arange(count), column) for column in flown.inputs.T], axis=1)
    y = case.kernel.trajectories(rows, case.start(rows), inputs, 1.0 / RATE / parts)[0, ::parts]
    return np.asarray(np.abs(y - truth).max(axis=0) / np.abs(truth).max(axis=0))

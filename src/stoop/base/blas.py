"""Linear algebra whose numbers do not depend on the machine's number of cores."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Given = ParamSpec("Given")
Found = TypeVar("Found")


def on_one_blas_thread(work: Callable[Given, Found]) -> Callable[Given, Found]:
    """Return a function that runs on one BLAS thread: more would round differently, and wait for each other."""
    limited: Callable[Given, Found] = threadpool_limits.wrap(limits=1, user_api="blas")(work)
    return limited

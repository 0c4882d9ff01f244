"""The made-up identification, of a few channels, for tests of a report."""

from dataclasses import replace
from typing import Any

import pytest
from naive.identification import example


def fewer(shown: Any) -> Any:
    """Return an identification with its first and last maneuvers and a few channels of them: a page that is drawn sooner."""
    few, ends = ("V", "p", "q", "az"), ((a[0], a[-1]) for a in (shown.traces, shown.result.maneuvers))
    traces, maneuvers = (tuple(replace(m, channels={n: m.channels[n] for n in few}) for m in a) for a in ends)
    return replace(shown, traces=traces, result=replace(shown.result, maneuvers=maneuvers))


@pytest.fixture(scope="session")
def whole() -> Any:
    return fewer(example())

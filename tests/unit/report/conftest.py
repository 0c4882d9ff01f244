"""The made-up identification, whole and of a few channels, for every test of a report."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest
from naive import identification

FEW = ("V", "p", "q", "az")


@pytest.fixture(scope="session")
def examples() -> ModuleType:
    """Return the module that makes identifications."""
    return identification


def _fewer(shown: Any) -> Any:
    """Return an identification with its first and last maneuvers and a few channels of them: a page that is drawn sooner."""
    traces = tuple(
        dataclasses.replace(t, channels={n: t.channels[n] for n in FEW})
        for t in (shown.traces[0], shown.traces[-1])
    )
    maneuvers = tuple(
        dataclasses.replace(m, channels={n: m.channels[n] for n in FEW})
        for m in (shown.result.maneuvers[0], shown.result.maneuvers[-1])
    )
    return dataclasses.replace(
        shown, traces=traces, result=dataclasses.replace(shown.result, maneuvers=maneuvers)
    )


@pytest.fixture(scope="session")
def fewer() -> Callable[[Any], Any]:
    """Return what leaves out maneuvers and channels of an identification."""
    return _fewer


@pytest.fixture(scope="session")
def whole() -> Any:
    return _fewer(identification.example())

"""What a worker does with one task, wherever it runs."""

from __future__ import annotations

import functools
import importlib
import os
import socket
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict

from stoop.errors import CampaignError, StoopError
from stoop.parallel.canonical import from_text, to_text
from stoop.parallel.environment import environment
from stoop.parallel.sources import work_sources


class Report(TypedDict):
    """What comes back; built-in types only, so that it can be read whatever the worker is."""

    worker: str  #: which one
    environment: dict[str, str]
    results: list[str]  #: canonical texts, one per stop
    failure: str  #: why there are none
    trace: str


def perform(work: str, text: str, stops: Sequence[int | None]) -> Report:
    """Do one task and report; an exception is a failure in the report.

    Parameters
    ----------
    work : str
        "package.module:function"
    text : str
        The arguments.
    stops : sequence of int or None
    """
    me = f"process {os.getpid()} on {socket.gethostname()}"
    report = Report(
        worker=me, environment={**environment(), **_sources(work)}, results=[], failure="", trace=""
    )
    try:
        report["results"] = _results(work, text, stops)
    except StoopError as error:
        report["failure"] = _first_line(error) or type(error).__name__
    except (Exception, SystemExit) as error:
        report["failure"] = f"{type(error).__name__}: {_first_line(error)}"
        report["trace"] = traceback.format_exc()
    return report


@functools.cache
def _sources(work: str) -> Mapping[str, str]:
    """Hash the sources of a function once, before its module is imported: those are the ones that this process runs."""
    return work_sources([work])


def _results(work: str, text: str, stops: Sequence[int | None]) -> list[str]:
    results = _function(work)(from_text(text), list(stops))
    if not isinstance(results, list) or len(results) != len(stops):
        raise CampaignError(f"{work} must return a list of {len(stops)} results, one for each stop")
    return [to_text(result, f"result {i}") for i, result in enumerate(results)]


def _first_line(error: BaseException) -> str:
    return "".join(map(str, error.args[:1])).partition("\n")[0]


def _function(work: str) -> Callable[[Any, list[int | None]], Any]:
    module, _, name = work.partition(":")
    found: Callable[[Any, list[int | None]], Any] = getattr(importlib.import_module(module), name)
    return found

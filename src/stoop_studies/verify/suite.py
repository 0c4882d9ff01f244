"""What the pages of stoop's own claims share, and how an experiment is found by its name."""

from __future__ import annotations

import importlib
import shlex
from typing import Final, cast

from stoop.errors import StoopError
from stoop_studies.findings import Experiment, Setting
from stoop_studies.outputs import Suite
from stoop_studies.verify.registry import EXPERIMENTS


def _options(setting: Setting) -> str:
    return "" if setting.data is None else f" --data {shlex.quote(str(setting.data))}"


SUITE: Final = Suite(
    "verify",
    "What stoop claims, measured",
    "What the documentation says of stoop's own accuracy, with the runs that bear it out.",
    _options,
)


def load_experiment(name: str) -> Experiment:
    """Return an experiment.

    Raises
    ------
    StoopError
        A package that it needs is not installed.
    """
    module, _, kind = EXPERIMENTS[name].place.partition(":")
    try:
        return cast("Experiment", getattr(importlib.import_module(module), kind)())
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in ("", "stoop"):
            raise
        raise StoopError(
            f"{name}: needs the package {missing}, which is not installed; pip install {missing}"
        ) from None

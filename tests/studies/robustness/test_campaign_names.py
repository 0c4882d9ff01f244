"""Drawn names through every export and every verb that writes; drawn results through the verbs that read one."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from studies.robustness import documents, test_hostile_names
from studies.robustness.campaign import cases, check
from studies.robustness.commands import try_command
from studies.robustness.hostile_names import DRAWN
from studies.robustness.small_runs import COMMANDS, OUT, inputs
from studies.robustness.test_hostile_names import exported, outputs, plain, same_code
from studies.robustness.trials import Bounds, Child

from stoop.exporters.targets import TARGETS

QUICK = {"jsbsim": 40, "state-space": 40, "ardupilot-jsbsim": 15, "simulink": 8, "px4-jsbsim": 2}
"""Target -> names, of others one for two."""
SHORT = {
    "vehicle": 20, "linearize": 15, "derivatives": 15, "flight": 5, "log": 5, "table": 5, "map": 1, "columns": 1,
}  # fmt: skip  #: verb -> names, of others one for ten
BOUNDS = Bounds(seconds=30, wall=300.0, memory=2**29)


@pytest.mark.parametrize("target", TARGETS)
def test_no_drawn_name_becomes_code_of_an_export(target: str) -> None:
    plain(exported, target)
    with closing(Child(same_code, BOUNDS)) as child:

        @cases(QUICK.get(target, 0.5))
        @given(DRAWN)
        def stays_text(name: str) -> None:
            check("drawn names", f"export to {target}", child(exported, target, name))

        stays_text()


@pytest.mark.parametrize("command", test_hostile_names.COMMANDS)
def test_no_drawn_name_becomes_code_of_an_output(command: str) -> None:
    plain(outputs, command)
    with closing(Child(same_code, BOUNDS)) as child:

        @cases(SHORT.get(command, 0.1))
        @given(DRAWN)
        def stays_text(name: str) -> None:
            check("drawn names", command, child(outputs, command, name))

        stays_text()


def _validate(folder: Path, content: bytes) -> str:
    files = {**inputs(), "model/result.json": content}
    (folder / OUT).mkdir()
    return try_command(folder, list(COMMANDS["validate"]), files, (f"{OUT}/validation.html",))


def test_drawn_results_are_loaded_or_refused() -> None:
    documents.prepare("identification")
    with closing(Child(documents.try_document)) as child:

        @cases(20)
        @given(documents.documents("identification"), st.integers(0, 99))
        def ends_well(content: bytes, number: int) -> None:
            check("drawn results", "load", child("identification", content, number))

        ends_well()


def test_drawn_results_are_validated_or_refused() -> None:
    inputs()
    with closing(Child(_validate, BOUNDS)) as child:

        @cases(4)
        @given(documents.documents("identification"))
        def ends_well(content: bytes) -> None:
            check("drawn results", "stoop validate", child(content))

        ends_well()

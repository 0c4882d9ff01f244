"""Complete commands on hostile inputs."""

from __future__ import annotations

from contextlib import closing

import pytest
from hypothesis import given
from studies.robustness import commands
from studies.robustness.campaign import cases, check
from studies.robustness.commands import BOUNDS, VERBS
from studies.robustness.trials import Child


@pytest.mark.parametrize("name", VERBS)
def test_hostile_commands_end_well(name: str) -> None:
    """They do their work and write whole files, or end in an error of one line; no control characters are printed."""
    commands.prepare(name, VERBS[name].count)
    with closing(Child(commands.try_command, BOUNDS)) as child:

        @cases(VERBS[name].count)
        @given(commands.commands(name))
        def ends_well(command) -> None:
            check("verbs", f"stoop {name}", child(*command, VERBS[name].written))

        ends_well()

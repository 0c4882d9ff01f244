"""Commands under limits of memory, on files that unfold to very much."""

from __future__ import annotations

from pathlib import Path

import pytest
from studies.robustness import limited
from studies.robustness.bombs import BOMBS
from studies.robustness.campaign import check
from studies.robustness.limited import MEMORY
from studies.robustness.trials import LIMIT, REFUSED

MOST = (
    700_000_000  #: bytes that a command may take on a bomb: the text of the largest table, and its libraries
)


@pytest.mark.parametrize("kind", BOMBS)
def test_a_bomb_is_refused_in_one_line(kind: str, tmp_path: Path) -> None:
    """Within 1.5 GB of addresses, and without taking them where the file shows how much it is."""
    name, made = BOMBS[kind]
    (folder := tmp_path / "here").mkdir()
    (folder / name).write_bytes(made())
    run = limited.run(["info", name], folder)
    check("bombs", kind.partition(":")[0], run.ended)
    assert run.ended.outcome in (REFUSED, LIMIT)
    assert run.memory < MEMORY
    if not kind.startswith("MATLAB 5"):  # which SciPy unpacks whole, in a child
        assert run.ended.outcome == REFUSED
        assert run.memory < MOST

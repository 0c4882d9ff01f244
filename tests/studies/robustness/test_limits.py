"""Commands under limits of the system, on small inputs and on files that unfold to very much."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest
from crossed import crossed
from studies.robustness import limited
from studies.robustness.bombs import BOMBS
from studies.robustness.campaign import check
from studies.robustness.disk_full import check_rest
from studies.robustness.limited import MEMORY
from studies.robustness.small_runs import COMMANDS, OUT, inputs, undisturbed
from studies.robustness.trials import LIMIT, REFUSED, lay_out
from studies.robustness.verb_outputs import check_file

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
    stated = "that state" in kind  # SciPy asks for the memory that a tag states, and takes none of it
    assert run.ended.outcome == (LIMIT if stated else REFUSED)
    assert run.memory < MOST


LIMITS = {
    "files of 4 kB": {resource.RLIMIT_FSIZE: 2**12},
    "files of 64 kB": {resource.RLIMIT_FSIZE: 2**16},
    "a stack of 256 kB": {resource.RLIMIT_STACK: 2**18},
    "a stack of 1 MB": {resource.RLIMIT_STACK: 2**20},
    "1.5 GB of memory": {resource.RLIMIT_AS: MEMORY},
    "0.75 GB of memory": {resource.RLIMIT_AS: MEMORY // 2},
}  #: kind -> limits of a process


@pytest.mark.parametrize(("name", "kind"), crossed(COMMANDS, LIMITS))
def test_a_command_under_a_limit_ends_in_all_of_its_files_or_in_one_line(
    name: str, kind: str, tmp_path: Path
) -> None:
    """Nothing half-written is left, and no input is lost."""
    folder = tmp_path / "here"
    lay_out(folder, inputs())
    (folder / OUT).mkdir()
    run = limited.run(COMMANDS[name], folder, LIMITS[kind])
    check("limits", kind, run.ended)
    assert all((folder / place).read_bytes() == content for place, content in inputs().items())
    if run.code:
        check_rest({}, folder)
        return
    assert all((folder / OUT / place).is_file() for place in undisturbed(COMMANDS[name]))
    for path in filter(Path.is_file, (folder / OUT).rglob("*")):
        check_file(path)

"""Each file of the corpus ends as it did: in an error of one line, in a list of defects, or in what it promises."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from studies.robustness import readers
from studies.robustness.corpus import cases
from studies.robustness.documents import ASKS, read_document
from studies.robustness.readers import GUARDED, OURS, read_case
from studies.robustness.small_runs import command
from studies.robustness.trials import BAD, READ, REFUSED, Bounds, Child, try_case


def check_all(work: Callable[..., str], folder: Path, kind: str) -> None:
    assert len(cases(kind)) >= 6
    ended = [(case, try_case(work, folder, case)) for case in cases(kind)]
    assert [(case.case, case.outcome, end) for case, end in ended if end.outcome != case.outcome] == []


@pytest.mark.parametrize("form", [*OURS, "hdf5", "netcdf", "netcdf-3"])  # libraries that stay alive
def test_hostile_logs_end_as_they_did(form: str, tmp_path: Path) -> None:
    check_all(read_case, tmp_path, form)


@pytest.mark.parametrize("kind", ASKS)
def test_hostile_documents_end_as_they_did(kind: str, tmp_path: Path) -> None:
    check_all(read_document, tmp_path, f"document:{kind}")


@pytest.mark.parametrize("form", GUARDED)
def test_hostile_logs_that_libraries_read_end_well(form: str) -> None:
    """In an error, or they are read, with little time and memory; a sound log is read."""
    readers.prepare()
    with closing(Child(read_case)) as child:
        for case in cases(form):
            ended = child(case)
            assert ended.outcome not in BAD, f"{case.case}: {ended.message}"
            assert ended.outcome == case.outcome or not case.case.startswith("sound"), ended.message


@pytest.mark.parametrize("case", range(16))
def test_a_bomb_is_refused_in_one_line(case: int) -> None:
    """Within a GiB of addresses, and without taking them where the file shows how much it is."""
    readers.prepare()
    assert len(cases("bomb")) == 16
    bomb = cases("bomb")[case]

    def info(folder: Path) -> str:
        command(bomb.write(folder)[0].parent, ["info", bomb.entry])
        return READ

    with closing(Child(info, Bounds(seconds=60, memory=570 << 20))) as child:  # the text of the largest table
        ended = child()
    assert ended.outcome == REFUSED, ended.message

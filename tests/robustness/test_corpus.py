"""Each file of the corpus ends as it did: in an error of one line, in a list of defects, or in what it promises."""

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from robustness import readers
from robustness.corpus import cases
from robustness.documents import ASKS, read_document
from robustness.readers import GUARDED, OURS, read_case
from robustness.trials import BAD, Child, try_case

#: prints the bytes that `stoop info` or a child of it took, within 1.5 GB of addresses
LIMITED = """
import re, resource, sys
from stoop.cli.main import main
resource.setrlimit(resource.RLIMIT_AS, (1_500_000_000,) * 2)
code = main(["info", sys.argv[1]])
own = int(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1])
print(1024 * max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))
sys.exit(code)
"""


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
def test_a_bomb_is_refused_in_one_line(case: int, tmp_path: Path) -> None:
    """Within 1.5 GB of addresses, and without taking them where the file shows how much it is."""
    assert len(cases("bomb")) == 16
    bomb = cases("bomb")[case]
    folder = bomb.write(tmp_path)[0].parent
    few = os.environ | {"STOOP_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, bomb.entry], cwd=folder, env=few, capture_output=True, text=True, check=False
    )  # fmt: skip
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith("stoop: error: ")
    assert int(done.stdout.split()[-1]) < 700_000_000  # the text of the largest table, and its libraries

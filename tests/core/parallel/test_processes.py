"""Worker processes: one thread each, replaced when they die, gone when the campaign ends."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from helpers.works import HERE, failing, walks

from stoop.parallel import CampaignError, LocalProcesses, Plan, Run, execute

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}


def test_one_thread_each_and_the_driver_keeps_its_own(tmp_path: Path) -> None:
    before = dict(os.environ)
    runs = tuple(Run(str(i), f"{HERE}:threads", {"i": i}) for i in range(4))
    found = execute(Plan("t", {}, runs), tmp_path / "s", LocalProcesses(2))
    for each in found.values():
        assert (each["kernels"], {*each["blas"]}, each["env"]) == (1, {1}, "1")  # type: ignore[call-overload,index]
        assert each["pid"] != os.getpid()  # type: ignore[call-overload,index]
    assert dict(os.environ) == before
    assert not multiprocessing.active_children()


def test_a_worker_that_dies_is_replaced_and_its_task_done_again(tmp_path: Path) -> None:
    found = execute(failing("die once", tmp_path / "log"), tmp_path / "s", LocalProcesses(1))
    assert found == {"bad": "die once"}


def test_workers_that_die_again_and_again(tmp_path: Path) -> None:
    log = tmp_path / "log"
    with pytest.raises(CampaignError, match=r"^run bad: its worker died 5 times \(exit code 7\)"):
        execute(failing("die", log, 3), tmp_path / "s", LocalProcesses(1))
    assert len(execute(walks(log, 3), tmp_path / "s", LocalProcesses(1))) == 3
    assert len(log.read_text().splitlines()) == 3


def test_a_failure_ends_the_workers_at_once(tmp_path: Path) -> None:
    bad = Run("bad", f"{HERE}:fail", {"how": "plain"})
    runs = (Run("long", f"{HERE}:sleep", {"seconds": 3600.0}), bad)  # longer than a test may take
    with pytest.raises(CampaignError, match="run bad: ValueError"):
        execute(Plan("t", {}, runs), tmp_path / "s", LocalProcesses(2))
    assert not multiprocessing.active_children()
    assert not [t for t in threading.enumerate() if t.name == "stoop-campaign"]


SCRIPT = """
from pathlib import Path
from stoop.parallel import LocalProcesses, Plan, Run, execute
execute(Plan("t", {}, (Run("a", "helpers.works:sleep", {"seconds": 0.2}),)), Path("s"), LocalProcesses(2))
"""


def test_a_script_without_a_guard_is_told(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 1
    assert "__name__ == '__main__'" in done.stderr.splitlines()[-1]


COMMAND = """
import argparse, sys
from pathlib import Path
from stoop.parallel import Plan, Run
from stoop.base.verbs import add_options, shared_options
from stoop.cli.progress import run_campaign
parser = argparse.ArgumentParser()
add_options(parser, (shared_options()["workers"], shared_options()["scheduler"]))
runs = tuple(Run(str(i), "helpers.works:sleep", {"seconds": 0.1, "i": i}) for i in range(200))
run_campaign(parser.parse_args(["--workers", "2"]), Plan("naps", {}, runs), Path(sys.argv[1]))
"""


def test_ctrl_c_of_a_whole_group_says_one_line_and_leaves(tmp_path: Path) -> None:
    """As a terminal does it: driver and workers get the signal."""
    store = tmp_path / "s"
    command = [sys.executable, "-c", COMMAND, str(store)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=ENVIRONMENT, stderr=pipe, text=True, start_new_session=True) as driver:
        assert driver.stderr is not None
        assert driver.stderr.readline() == "naps: 0 of 200 runs\n"
        while not store.exists() or store.stat().st_size == 0:
            assert driver.poll() is None
            time.sleep(0.01)
        while (said := driver.stderr.readline()).startswith("naps: 0 "):
            pass  # no run is done yet, on a busy machine
        assert said.startswith("naps: ")
        os.killpg(driver.pid, signal.SIGINT)
        *progress, line = driver.stderr.read().splitlines()
        assert driver.wait() == 130
    assert line.startswith("stoop: interrupted; ")
    assert "give the same command to " in line
    assert all(p.startswith("naps: ") for p in progress), "no tracebacks of workers"
    with suppress(ProcessLookupError):
        while True:  # until no process of the group lives
            os.killpg(driver.pid, 0)
            time.sleep(0.01)

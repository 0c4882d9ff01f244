"""What goes wrong is said in words, on the page or in one line, and nothing is lost."""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from stoop.app.fit_view import FitView
from stoop.app.folder import Project
from stoop.cli.main import main


def test_logs_that_cannot_be_read(app, tab, tmp_path: Path) -> None:
    bad = tmp_path / "<img src=x onerror=alert(1)>.ulg"
    bad.write_bytes(b"junk" * 100)
    large = tmp_path / "large.ulg"
    with large.open("wb") as file:  # sparse: the disk holds none of the zeros
        file.write(b"ULog\x01\x12\x35\x01" + bytes(8))
        file.truncate(2_100_000_000)
    running = app("--max-upload", "2")
    page = tab(running)
    label = "or the path of a log on this machine"
    page.fill(label, str(tmp_path / "none.ulg"))
    page.click("Open")
    page.wait("there is no such log")
    page.page.locator("input[type=file]").first.set_input_files(large)
    page.wait("the log holds 2.1 GB, more than the limit of 2 GB; give its path instead")
    assert not list(running.folder.rglob("large*"))
    page.fill(label, str(large))
    page.click("Open")
    page.wait("no topic holds data")
    status = Path(f"/proc/{running.process.pid}/status")
    if status.exists():
        peak = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        assert int(peak.split()[1]) < 1_000_000, "kB; a log is read by another process, and sent in pieces"
    page.fill(label, str(bad))
    page.click("Open")
    page.wait("its first bytes are wrong")
    page.wait("<img src=x onerror=alert(1)>.ulg")
    assert page.page.locator("img").count() == 0
    page.picture("bad_log")
    # A table needs a mapping, whose unsure lines are asked.
    time = np.arange(0.0, 20.0, 0.02)
    columns = np.column_stack([time, np.sin(time), 20.0 + np.cos(time), 9.8 + 0.0 * time])
    np.savetxt(
        tmp_path / "t.csv", columns, delimiter=",", header="time_s,roll_rate,airspeed,accel_z", comments=""
    )
    page.fill(label, str(tmp_path / "t.csv"))
    page.click("Open")
    page.click("Next: the columns")
    page.wait("0 without a variable, 2 unsure")
    page.page.locator('.tabulator-cell[tabulator-field="unit"]').get_by_text("m/s", exact=True).first.click()
    page.page.locator(".tabulator-edit-list-item").get_by_text("kt", exact=True).click()
    page.wait("1 edit not saved")
    page.picture("mapping")
    page.click("Use these columns")
    page.wait("Next: the vehicle")
    folder = next(tmp_path.glob("project"))
    assert 'unit = "kt"' in (folder / "mapping.toml").read_text("utf-8")
    assert Project(folder).info["channels"]
    # One that cannot be read leaves it in place, and says so.
    page.click("Another log")
    page.fill(label, str(bad))
    page.click("Open")
    page.wait("was not taken, ")
    page.wait("Next: the vehicle")
    page.picture("refused")
    assert Project(folder).log == str(tmp_path / "t.csv")
    assert 'unit = "kt"' in (folder / "mapping.toml").read_text("utf-8")


def test_a_port_in_use(app, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        words = ["-m", "stoop", "app", "--folder", str(tmp_path / "p"), "--no-browser", "--port", str(port)]
        done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == f"stoop: error: app: port {port} is in use; give another with --port N\n"
    first, second = app(folder=tmp_path / "a"), app(folder=tmp_path / "b")
    assert first.port != second.port, "without --port the next free one is taken"


def test_without_its_packages_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "panel", None)
    assert main(["app", "--folder", str(tmp_path)]) == 2
    assert (
        capsys.readouterr().err
        == "stoop: error: app: the package panel is not installed; pip install '.[app]' in a clone of stoop\n"
    )


@pytest.mark.filterwarnings(
    "ignore::PendingDeprecationWarning"
)  # of Panel: names of options in its next version
def test_a_full_disk_is_said_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from stoop.base import files
    from stoop.vehicle.builtin import builtin_text

    project = Project(tmp_path)
    project.take_vehicle(builtin_text("quad-x"))
    before = project.vehicle

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files, "_write_through", full)
    view = FitView(project, lambda title: None)
    view.act(lambda: project.save_vehicle("other", None))()
    assert "No space left on device" in view.said.object
    assert project.vehicle == before


def test_a_folder_that_cannot_be_made(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["app", "--folder", str(tmp_path / "file"), "--no-browser"]) == 2
    assert "is a file" in capsys.readouterr().err

"""A folder of logs in the app: read in the background, with its tables; its page is shown, and what is no such folder is told."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from stoop.app.fleet_view import FleetView
from stoop.app.folder import Project, fleet_logs, store_of
from stoop.app.steps import Step
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.fleet.store import PAGE
from stoop.vehicle.builtin import builtin_text

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of Panel


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the logs of two quadrotors, two flights of 8 s each."""
    folder = tmp_path_factory.mktemp("fleet")
    (folder / "m.toml").write_text("duration = 8.0\nrate = 50.0\n")
    (folder / "fleet.toml").write_text("vehicles = 2\nflights = 2\n")
    words = [
        "--fleet",
        str(folder / "fleet.toml"),
        "--maneuver",
        str(folder / "m.toml"),
        "-o",
        str(folder / "logs"),
    ]
    assert main(["simulate", "quad-x", *words]) == 0
    return folder / "logs"


def shown(view: FleetView) -> str:
    view.refresh()
    return "".join(str(getattr(one, "object", "")) for one in view.body)


def ended(step: Step) -> Step:
    while step.running:
        time.sleep(0.05)
    return step


def test_a_folder_of_logs_is_read_and_its_page_is_shown(logs: Path, tmp_path: Path) -> None:
    project = Project(tmp_path / "project")
    view = FleetView(project, lambda title: None)
    assert "No vehicle is chosen yet" in shown(view)
    project.save_vehicle(builtin_text("quad-x"), None)
    step = project.open_fleet(logs)
    words = step.words
    assert words[2:6] == [str(logs / f"V{v}-00{i}.ulg") for v in (1, 2) for i in (1, 2)]
    assert words[6:] == [
        "--parts",
        str(logs / "parts.csv"),
        "--vehicle",
        "vehicle.toml",
        "-o",
        store_of(logs),
    ]
    assert ended(step).state == "done"
    assert (project.root / store_of(logs) / PAGE).exists()
    page = shown(view)
    assert "2 vehicles, 4 flights" in page
    assert f"{store_of(logs)}/{PAGE}" in page
    assert store_of(logs) != store_of(tmp_path / "logs"), "folders of one name have stores of their own"


def test_what_is_no_folder_of_logs_is_told(logs: Path, tmp_path: Path) -> None:
    project = Project(tmp_path / "project")
    (tmp_path / "bag").mkdir()
    for name in ("metadata.yaml", "bag_0.mcap"):
        (tmp_path / "bag" / name).write_text("")
    for place in (tmp_path / "none", logs / "V1-001.ulg", tmp_path / "bag", tmp_path):
        assert fleet_logs(place) == []
        with pytest.raises(StoopError, match="is no folder of logs"):
            project.open_fleet(place)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "a.ulg").write_bytes(b"")
    assert ended(project.open_fleet(tmp_path / "broken")).state == "failed"
    assert "no log gave a figure" in shown(FleetView(project, lambda title: None))

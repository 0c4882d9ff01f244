"""Gains in the app: judged from a log, proposed by two sliders, written; what is refused is one line, and nothing is written."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from tune.test_tune import FLOWN, moved_by_commands

from app.conftest import ended
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.results.verdict import Verdict
from stoop_app import steps
from stoop_app.folder import Project
from stoop_app.gains_view import GainsView
from stoop_plan.flight_logs import save_flight_as
from stoop_tune.gain_search import DAMPING

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # of Panel


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder: logs of the demonstration with parameters of PX4 and without, and of an app with its model as a run."""
    folder = tmp_path_factory.mktemp("gains")
    assert main(["demo", "-o", str(folder / "demo")]) == 0
    model = moved_by_commands(folder / "demo", "lag = 0.05\ndelay = 0.03\n")
    doubtful = replace(model, result=replace(model.result, verdict=Verdict()))
    for name, one in (("001", doubtful), ("002", model)):
        one.save(folder / "project" / "runs" / name)
        (folder / "project" / "runs" / name / steps.COMMAND).write_text("stoop identify\n")
    flight = model.flights[0]
    save_flight_as(flight, folder / "bare.ulg")
    save_flight_as(replace(flight, parameters=FLOWN), folder / "flight.ulg")
    return folder


@pytest.fixture
def project(flown: Path, tmp_path: Path) -> Project:
    return Project(Path(shutil.copytree(flown / "project", tmp_path / "project")))


def write(project: Project, name: str, values: dict[str, float]) -> None:
    (project.root / name).write_text("".join(f"{n} {x}\n" for n, x in values.items()), "utf-8")


def view_of(project: Project) -> GainsView:
    view = GainsView(project, lambda title: None)
    view.refresh()
    return view


def text_of(view: GainsView) -> str:
    return "\n".join(str(pane.object) for pane in view.panel.select() if hasattr(pane, "object"))


def test_a_log_without_parameters_takes_those_of_a_file(project: Project, flown: Path) -> None:
    project.open_log(flown / "bare.ulg")
    ended(project.latest("info"))
    view = view_of(project)
    assert view._judge.disabled
    assert "The log holds no parameters of an autopilot whose law is known. Send a file" in text_of(view)
    with pytest.raises(StoopError, match=r"gains\.txt: a file of parameters ends in \.config, \.param, "):
        view._take("gains.txt", b"")
    assert "gains.txt" not in {p.name for p in project.root.iterdir()}
    view._take("../-o.params", b"FW_RR_P 0.1\n")
    view._take("-o.params", b"FW_RR_P 0.2\n")
    assert not view._judge.disabled
    assert view._gains.value == "./-o.params", "no option of the command"
    assert view_of(project)._gains.options == {"-o-1.params": "./-o-1.params", "-o.params": "./-o.params"}
    (project.root / "elsewhere.params").symlink_to(flown / "flight.ulg")
    assert "elsewhere.params" not in view_of(project)._gains.options


def test_a_model_not_for_control_writes_if_told_to(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    write(project, "own.params", FLOWN)
    view = view_of(project)
    view._model.value = "runs/001"
    view._start(False)
    assert ended(project.latest("gains")).state == "done"
    view.refresh()
    assert "Gains that flew" in text_of(view)
    write(project, "own.params", FLOWN | {"FW_PR_P": 0.7})
    view.refresh()
    assert "Gains that flew" not in text_of(view), "of another file of the same name"
    write(project, "own.params", FLOWN)
    view.refresh()
    view._start(True)
    assert ended(project.latest("gains")).state == "failed"
    view.refresh()
    shown = text_of(view)
    assert shown.count('class="error"') == 1
    assert "No file of gains was written." in shown
    assert "anyway" not in shown.partition("<details")[0]
    written = [p.name for step in project.steps("gains") for p in step.files]
    assert written == ["tuning.html"], "of the gains that flew"
    given: list[str] = []
    monkeypatch.setattr(Project, "start", lambda self, kind, words: given.extend(words("gains/003")))
    view.refresh()  # the button of the refusal takes the next start
    view._damping.value = DAMPING["ArduCopter"]  # moved after the refusal
    (button,) = (b for b in view._stage if getattr(b, "label", "") == "Write them all the same")
    button.clicks += 1
    asked = "--gain-margin 6 --phase-margin 45 --disk-margin 4 --noise 5 -o gains/003 --anyway"
    assert " ".join(given[3:]) == asked

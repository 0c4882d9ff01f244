"""One row of the table of targets is all that command line, Python, app and completion need of an exporter."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

import stoop
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.exporters.exporter import Exported, Exporter
from stoop.exporters.targets import TARGETS, Target


class MassCard(Exporter):
    def files(self) -> Exported:
        text = f"{self.vehicle.value('mass.mass')!r} kg\n"
        return Exported({"card.txt": text.encode()}, "card.txt", ("a card",))

    def lacks(self) -> list[str]:
        return ["no aerodynamics"]

    def fly(self, made: Exported) -> Exported:
        return made.with_notes(["cards fly badly"])


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> str:
    module = ModuleType("stoop.exporters.mass_card")
    module.MassCard = MassCard  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(TARGETS, "mass-card", Target("a card", "mass_card", "MassCard"))
    return "mass-card"


def test_every_row_names_an_exporter() -> None:
    found = {target.load() for target in TARGETS.values()}
    assert all(issubclass(one, Exporter) and one is not Exporter for one in found)
    assert len(found) == len(TARGETS)


def test_a_row_is_seen_by_the_command_line(card: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert stoop.export("twin-boom", card).files == {"card.txt": b"189.4 kg\n"}
    assert main(["export", "--help"]) == 0
    assert "mass-card (a card)" in " ".join(capsys.readouterr().out.split())
    assert main(["export", "twin-boom", "--to", card, "-o", str(tmp_path)]) == 0
    assert (tmp_path / "card.txt").read_text() == "189.4 kg\n"
    said = capsys.readouterr().out
    assert said.index("a card") < said.index("no aerodynamics") < said.index("cards fly badly")
    with pytest.raises(StoopError, match=r"no target 'gazeboo' of an export; did you mean gazebo\?"):
        stoop.export("twin-boom", "gazeboo")

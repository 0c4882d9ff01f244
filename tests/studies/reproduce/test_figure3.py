"""Figure 3, and the index of the pages."""

from __future__ import annotations

from pathlib import Path

from stoop_studies.findings import Findings, Setting
from stoop_studies.outputs import write_index
from stoop_studies.reproduce.figure3 import Figure3
from stoop_studies.reproduce.suite import SUITE


def verdicts(found: Findings) -> list[str]:
    return [claim.verdict for claim in found.claims]


def test_figure_3_flies_the_printed_trim_and_excites_both_modes() -> None:
    found = Figure3().findings(Setting(runs=1), {})
    assert verdicts(found) == ["reproduces", "reproduces", "reproduces", "holds"]
    rows = found.csv.splitlines()
    assert rows[0] == "time_s,elevator_deg,V_m_per_s,alpha_deg,q_deg_per_s,theta_deg"
    assert len(rows) == 1501


def test_the_index_leads_to_every_page(tmp_path: Path) -> None:
    found = {"figure3": Figure3().findings(Setting(runs=3), {})}
    write_index(SUITE, found, [Setting(runs=3)], tmp_path)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.count('<a href="figure3.html">figure3.html</a>') == page.count("figure3.html</a>") == 1
    assert "stoop reproduce figure3 --runs 3 --seed 0 --box N" in page

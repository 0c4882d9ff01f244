from stoop_studies.findings import Setting
from stoop_studies.reproduce.figure3 import Figure3


def test_figure_3_flies_the_printed_trim_and_excites_both_modes() -> None:
    found = Figure3().findings(Setting(runs=1), {})
    assert [claim.verdict for claim in found.claims] == ["reproduces", "reproduces", "reproduces", "holds"]
    rows = found.csv.splitlines()
    assert rows[0] == "time_s,elevator_deg,V_m_per_s,alpha_deg,q_deg_per_s,theta_deg"
    assert len(rows) == 1501

"""Cut propellers of real quadrotors: what `stoop verify propellers` says, and what it rests on."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.errors import StoopError
from stoop_studies.findings import Setting
from stoop_studies.verify.propellers import EXPERIMENT, read_flights

COMMITTED = Path(__file__).parents[2] / "docs" / "verify"


def test_the_committed_tables_are_made_again(shared_data: Path, tmp_path: Path) -> None:
    findings = EXPERIMENT.findings(Setting(1, data=shared_data), {})
    for part, name in (("", "propellers.csv"), ("conditions", "propellers-conditions.csv")):
        written = (COMMITTED / name).read_text(encoding="utf-8").splitlines()
        made = (findings.part(part) if part else findings.csv).splitlines()
        for one, other in zip(written, made, strict=True):
            for a, b in zip(one.split(","), other.split(","), strict=True):
                assert a == b or abs(float(a) - float(b)) < 0.02 + 0.02 * abs(float(a))
    verdicts = {claim.statement: claim.verdict for claim in findings.claims}
    assert verdicts["The rotor that was cut is the one that explains most, after every cut"] == "holds"
    assert verdicts["No normal flight is accused, each compared with the others"] == "holds"
    assert verdicts["Of every weight near M3 it is said: propeller or mass near M3"] == "holds"
    with pytest.raises(StoopError, match="holds none of its flights"):
        read_flights(tmp_path)

"""What every experiment has, by the name that it had here; it lives in `stoop.study.findings` now."""

from __future__ import annotations

from stoop.study.findings import (
    CLAIMS_HEAD,
    Claim,
    Experiment,
    Findings,
    FloatArray,
    Numbers,
    Results,
    Setting,
    claim_rows,
    counted,
    holds,
    number,
    reproduces,
)

__all__ = [
    "CLAIMS_HEAD", "Claim", "Experiment", "Findings", "FloatArray", "Numbers", "Results", "Setting", "claim_rows", "counted",
    "holds", "number", "reproduces",
]  # fmt: skip

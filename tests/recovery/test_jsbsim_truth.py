"""An independent simulator as truth: one stock aircraft of JSBSim, flown and identified from its noisy readings."""

from __future__ import annotations

import numpy as np

from stoop_studies.verify.jsbsim import SHARE, SIGMAS, flown_case


def test_a_trainer_is_found_from_its_outputs() -> None:
    """Every derivative within three standard errors or 2 %; together they scatter as they say."""
    trainer = flown_case("T37")
    told = trainer.estimates(trainer.flight(seed=0))
    truth, found, sigma = (
        np.array([told[k][n] for n in trainer.truth]) for k in ("truth", "estimate", "sigma")
    )
    off = np.abs(found - truth)
    agree = off <= np.maximum(SIGMAS * sigma, SHARE * np.abs(truth))
    names = np.array(list(trainer.truth))
    assert agree.all(), names[~agree]
    assert 0.4 < np.mean((off / sigma) ** 2) < 2.0, "36 normal squares are within that, were they independent"

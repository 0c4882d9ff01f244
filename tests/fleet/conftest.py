"""Few simulated sequences for the threshold of alarms: the rate of false alarms has tests of its own."""

import pytest

from stoop_fleet import analysis


@pytest.fixture(autouse=True)
def _few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(analysis, "DRAWS", 800)

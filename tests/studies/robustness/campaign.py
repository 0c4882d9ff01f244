"""The campaign in little, in parts that run side by side: half a slice of inputs and kills, a fifth of one of commands."""

from __future__ import annotations

from stoop_studies.robustness.trials import BAD
from stoop_studies.verify.robustness import SURFACES

SEED = 78


def surfaces(*families: str) -> list[str]:
    """Return the names of the surfaces of some families."""
    return [name for name, surface in SURFACES.items() if surface.family in families]


def check_surface(name: str, slices: float = 0.5) -> None:
    """Try what some slices of the campaign try of a surface; none of it may fail."""
    surface = SURFACES[name]
    count = max(1, round(slices * surface.count))
    tried = list(surface.trials(SEED, count, ""))
    assert [t.number for t in tried] == list(range(count))
    assert [t for t in tried if t.outcome in BAD] == []

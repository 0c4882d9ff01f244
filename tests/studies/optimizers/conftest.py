"""The oscillation on which the optimizers of the product are tested, for those of the studies."""

from __future__ import annotations

from unit.optimize.conftest import least, near, oscillation

__all__ = ["least", "near", "oscillation"]

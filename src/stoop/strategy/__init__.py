"""Decisions that a fit takes by itself, each with a switch."""

from stoop.strategy.run import fit
from stoop.strategy.strategy import DECISIONS, Strategy

__all__ = ["DECISIONS", "Strategy", "fit"]

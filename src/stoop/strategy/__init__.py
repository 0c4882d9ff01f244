"""Decisions that a fit takes by itself, each with a switch."""

from stoop.strategy.run import Decided, run
from stoop.strategy.strategy import DECISIONS, Strategy

__all__ = ["DECISIONS", "Decided", "Strategy", "run"]

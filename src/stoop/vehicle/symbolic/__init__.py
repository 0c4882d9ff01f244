"""The equations, written once: SymPy expressions from which kernel, derivatives and LaTeX come."""

from stoop.vehicle.symbolic.assemble import build_model

__all__ = ["build_model"]

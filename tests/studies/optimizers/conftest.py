from unit.optimize.conftest import least, near, oscillation

__all__ = ["least", "near", "oscillation"]

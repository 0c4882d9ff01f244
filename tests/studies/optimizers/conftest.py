from core.optimize.conftest import least, near, oscillation

__all__ = ["least", "near", "oscillation"]

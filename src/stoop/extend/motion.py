"""How a vehicle moves: trim, steady flight, linear models, simulated maneuvers, forces, actuators and rotors.

Many conditions are computed at a time, as lanes of an array.
"""

from stoop.base.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)

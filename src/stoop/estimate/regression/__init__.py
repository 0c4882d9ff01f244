"""Equation error: regression rows from measured accelerations, least squares in time or frequency domain, structure."""

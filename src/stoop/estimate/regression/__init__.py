"""Equation error: aerodynamic coefficients measured sample by sample, and terms fitted to them by linear regression."""

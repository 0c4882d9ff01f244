"""Whole optimizers, one a file, each composed from :mod:`stoop.optimize.pieces`."""

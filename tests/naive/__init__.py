"""Slow, plain twins of what the package compiles: written from the formulas, sharing none of its code."""

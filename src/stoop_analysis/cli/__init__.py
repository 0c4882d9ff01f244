"""Verbs of the analyses of models and flights."""

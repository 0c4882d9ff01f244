"""Analyses of fitted models and flights, in one call each."""

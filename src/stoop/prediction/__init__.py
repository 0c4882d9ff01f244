"""Prediction of windows with a fitted model, from an initial state that the record before them gives."""

"""Analyses of a fitted model or a flight: frequency responses, propagation, handling qualities, posterior, polar."""

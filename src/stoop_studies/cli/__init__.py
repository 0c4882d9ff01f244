"""Verbs of the studies: compare, reproduce, verify."""

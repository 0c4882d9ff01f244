"""Experiment design: inputs that make the error bars small within limits, and windows of flights worth fitting."""

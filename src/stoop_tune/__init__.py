"""Stability margins of an autopilot's loops around an identified model, with their spread over draws of the model."""

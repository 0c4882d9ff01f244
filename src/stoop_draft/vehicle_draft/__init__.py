"""A vehicle file from mass, dimensions and a log: geometry, a priori derivatives, and the set-up of the autopilot."""

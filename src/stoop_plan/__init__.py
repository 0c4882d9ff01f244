"""Maneuvers, the files with which a pilot or an autopilot flies them, and logs of simulated flights."""

"""A fitted vehicle for other programs: JSBSim aircraft, linear models."""

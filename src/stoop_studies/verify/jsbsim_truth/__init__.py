"""Stock aircraft of the JSBSim package: flown, and their aerodynamic derivatives read off by finite differences."""

"""Exported aircraft flown by JSBSim beside our own simulation."""

"""Figures of many flights of many vehicles: what changed, since which flight, which part explains it, and how sure that is."""

"""Recursive estimates in real time against those of the whole record."""

"""Loops over the bytes of a log: plain Python for small files, the same code compiled for large ones."""

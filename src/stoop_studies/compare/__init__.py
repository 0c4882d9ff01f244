"""Optimizers on the same problems, counted the same way: success, running time, and who is ahead where."""

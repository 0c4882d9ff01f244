"""Optimizers that only comparisons and the paper use, registered with `stoop.optimize` by an entry point."""

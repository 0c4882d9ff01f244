"""Optimizers that only comparisons and the paper use, registered with `stoop.optimize` by ``stoop.toml``."""

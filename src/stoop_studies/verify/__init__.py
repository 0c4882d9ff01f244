"""stoop's own claims, measured: one file or room per experiment, by name in `registry`."""

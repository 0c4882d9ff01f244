"""stoop's own claims, measured: one file or folder per experiment, by name in `suite`."""

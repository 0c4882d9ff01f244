"""Hostile inputs and failing machines: generators of bad files, and the trials that count what comes of them."""

"""What stoop promises to reach, measured: ``python -m benchmarks [engine|paper|startup|accuracy ...]``.

Nothing here is part of the package. Ratios are between things timed within one run, in turn, so that a
machine that speeds up or slows down changes both sides.
"""

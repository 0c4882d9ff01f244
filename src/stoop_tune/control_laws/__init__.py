"""Control laws of autopilots, discrete as their firmware computes them: rate and attitude loops, filters, limits."""

"""How well the estimates are known: covariance, its correction for colored residuals, identifiability."""

"""Assessment of a fit: error bars, identifiability, bootstrap, posterior, profile, goodness of fit, modes, validation."""

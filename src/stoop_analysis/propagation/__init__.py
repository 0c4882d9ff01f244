"""What the uncertainty of a model means: draws of its parameters carried into trims, modes, limits and expressions."""

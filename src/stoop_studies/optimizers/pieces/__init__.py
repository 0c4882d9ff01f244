"""Components of these optimizers."""

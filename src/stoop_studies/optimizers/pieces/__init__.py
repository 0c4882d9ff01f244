"""What these optimizers are composed of."""

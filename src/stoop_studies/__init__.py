"""Studies of the optimizers: the paper's experiments (`stoop reproduce`) and comparisons (`stoop compare`)."""

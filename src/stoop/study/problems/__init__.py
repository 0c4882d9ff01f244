"""Problems that optimizers are compared on: the paper's, a real flight, BBOB functions."""

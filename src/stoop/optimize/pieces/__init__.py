"""What optimizers are composed of: initialization, mutation, crossover, bounds, selection, adaptation, local dives."""

"""How well delays of inputs and outputs are recovered, fractions of a sample included."""

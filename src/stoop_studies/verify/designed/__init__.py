"""Whether a designed input keeps its promise: predicted and achieved error bars against the textbook's."""

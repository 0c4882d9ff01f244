"""Aircraft of JSBSim as truth: identified from their outputs, compared with its own tables."""

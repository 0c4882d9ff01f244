"""How often nominal 95 % intervals hold the truth: simulated flights, estimated as users do."""

"""How far a model can be trusted: figures of merit, and the trivial model that it has to beat."""

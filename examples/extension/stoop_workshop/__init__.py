"""A package that extends stoop by a verb, a target of exports, an estimator, a decision and an optimizer."""

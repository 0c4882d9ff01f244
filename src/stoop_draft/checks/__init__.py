"""Which line of a mapping or of a vehicle file contradicts the data: one hypothesis test over all residuals."""

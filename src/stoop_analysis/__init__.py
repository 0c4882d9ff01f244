"""What is asked of a model or a flight beside the fit: frequency responses, propagation, handling qualities, posterior."""

"""Structure determination: whether the true set of terms is found."""

"""Many runs of one plan on any executor, into one store, resumable after whatever stopped them."""

"""Pages of results and flights: verdict, estimates, curves, and where everything came from."""

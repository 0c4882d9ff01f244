"""Which propeller is cut: real flights of two Crazyflies, held against what was done to them."""

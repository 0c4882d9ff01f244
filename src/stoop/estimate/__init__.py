"""The one junction of cost and optimizer: windows of flights in, an optimum with its residuals out."""

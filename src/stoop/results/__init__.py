"""What a fit returns: estimates, intervals, goodness of fit, modes and traces; imported by every room above."""

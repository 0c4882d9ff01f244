"""The nonlinear problems of NIST's Statistical Reference Datasets: certified values, standard deviations, two starts."""

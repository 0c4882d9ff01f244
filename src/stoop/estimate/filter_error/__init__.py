"""Filter error: a Kalman filter corrects the model with every measurement, so that gusts do not count as its errors.

Composed of linear models along the flight (`linearization`), process and measurement noise (`noise`), filter gains
(`gains`), their likelihood (`likelihood`), and its maximization (`method`).

References
----------
R. E. Maine and K. W. Iliff, "Formulation and implementation of a practical algorithm for parameter estimation with
process and measurement noise", *SIAM Journal on Applied Mathematics* 41(3), 1981, pp. 558-579.
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, chapter 5.
"""

"""Filter error: the model is corrected by a Kalman filter as it flies, so that gusts do not count as its faults.

Composed of: points of linearization (`points`), what disturbs and what measures (`noise`), gains (`steady`,
`varying`), their likelihood (`likelihood`), and the ascent of it (`scoring`).

References
----------
R. E. Maine and K. W. Iliff, "Formulation and implementation of a practical algorithm for parameter estimation with
process and measurement noise", *SIAM Journal on Applied Mathematics* 41(3), 1981, pp. 558-579.
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, chapter 5.
"""

"""Parts of vehicle files that several tests put together."""

V_TAIL_MIXERS = """\
[controls.elevator]
mix = { pwm_3 = 0.0007, pwm_4 = 0.0008 }
center = { pwm_3 = 1480.0, pwm_4 = 1510.0 }
offset = -0.01
lag = 0.06
[controls.rudder]
mix = { pwm_3 = 0.0009, pwm_4 = -0.0008 }
center = { pwm_3 = 1480.0, pwm_4 = 1510.0 }
"""
V_TAIL_LATERAL = """\
[aerodynamics.CQ]
CQbeta = -0.4
CQrudder = 0.1
[aerodynamics.Cl]
Clbeta = -0.06
Clp = -0.5
Clr = 0.12
Claileron = 0.2
[aerodynamics.Cn]
Cnbeta = 0.06
Cnp = -0.04
Cnr = -0.12
Cnrudder = -0.08
"""

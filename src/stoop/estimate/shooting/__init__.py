"""Multiple shooting: short windows with states of their own, which meet as the fit converges.

An unstable vehicle cannot be flown open loop from a wrong start, and in the long run not even from the right one:
the simulation runs away long before its end, and there is nothing to follow downhill. Over a window of a second it
cannot run far. Each window begins in a state of its own, first as measured; that each ends where the next begins is
demanded ever more strictly. The states of the windows couple to their neighbors and to the parameters only, so they
are eliminated one after the other (a Schur complement), and a step costs in proportion to the number of windows. The
end is that of output error: windows that meet are one flight.

References
----------
H. G. Bock, "Recent advances in parameter identification techniques for ordinary differential equations", in
P. Deuflhard and E. Hairer (eds.), *Numerical Treatment of Inverse Problems in Differential and Integral Equations*,
Birkhaeuser, 1983, pp. 95-121.
R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., AIAA, 2015, section 9 (unstable aircraft).
"""

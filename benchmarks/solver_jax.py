"""JAX: ``diffrax.diffeqsolve`` at fixed steps, mapped over maneuvers, and Optimistix' Levenberg-Marquardt on its residuals."""

from __future__ import annotations

from typing import Any, ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix

from benchmarks.solver_case import Case, Found, Solver

jax.config.update("jax_enable_x64", True)


class RungeKutta4(diffrax.AbstractERK):
    """The classical method of order four, which Diffrax lacks."""

    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        c=np.array([0.5, 0.5, 1.0]),
        a_lower=(np.array([0.5]), np.array([0.0, 0.5]), np.array([0.0, 0.0, 1.0])),
        b_sol=np.array([1.0, 2.0, 2.0, 1.0]) / 6.0,
        b_error=np.zeros(4),
    )
    interpolation_cls: ClassVar[Any] = diffrax.ThirdOrderHermitePolynomialInterpolation.from_k

    def order(self, terms: Any) -> int:
        """Return the order, whatever the terms."""
        return 4


def prepare(case: Case) -> Solver:
    """Compile the simulation and the fit."""
    rates, readings, beginning = (case.printed(e, "jax") for e in (case.rates, case.readings, case.beginning))
    center, scale, index = jnp.asarray(case.center), jnp.asarray(case.scale), jnp.asarray(case.index)
    inputs, measured, sigma = map(jnp.asarray, (case.inputs, case.measured, case.sigma))
    count = case.inputs.shape[1]
    ts = case.dt * jnp.arange(count)

    def maneuver(q: Any, u: Any) -> Any:
        path = diffrax.LinearInterpolation(ts, u)

        def side(t: Any, x: Any, args: Any) -> Any:
            return jnp.stack(rates(x, path.evaluate(t), q))

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(side),
            RungeKutta4(),
            ts[0],
            ts[-1],
            None,
            jnp.stack(beginning(None, u[0], q)),
            saveat=diffrax.SaveAt(ts=ts),
            stepsize_controller=diffrax.StepTo(ts),
            adjoint=diffrax.ForwardMode(),
            max_steps=count,
        )
        return jax.vmap(lambda x, now: jnp.stack(readings(x, now, q)))(solution.ys, u)

    def simulated(z: Any) -> Any:
        return jax.vmap(maneuver)(center + scale * z[index], inputs)

    def residuals(z: Any, args: Any) -> Any:
        misfit = (simulated(z) - measured) / sigma
        return jnp.concatenate([misfit.ravel(), z[case.coefficients :]])

    solver = optimistix.LevenbergMarquardt(rtol=1e-5, atol=1e-5)

    @jax.jit
    def search(z: Any) -> Any:
        end = optimistix.least_squares(residuals, solver, z, options={"jac": "fwd"})
        return end.value, end.stats["num_steps"]

    simulate = jax.jit(simulated)

    def fit() -> Found:
        z, steps = search(jnp.asarray(case.start))
        return Found(np.asarray(z), int(steps), int(steps))

    return Solver(lambda z: np.asarray(simulate(jnp.asarray(z))), fit)

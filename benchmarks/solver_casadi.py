"""CasADi: multiple shooting by Runge-Kutta steps that are mapped over segments, Gauss-Newton's Hessian, IPOPT."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from benchmarks.solver_case import Case, Found, Solver
from stoop.base.arrays import FloatArray

QUIET: Final = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
COMPILED: Final = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O2"]}}


@dataclass(frozen=True)
class Maneuver:
    """Functions of one maneuver: its initial state; states after each step of segments; readings of all samples."""

    begin: Any
    march: Any
    read: Any

    def flown(self, nodes: Any, u: Any, q: Any) -> Any:
        """Return states (n_x, n - 1) from the first states (n_x, segments), inputs (n_u, n) and numbers (n_q,)."""
        return self.march(nodes, u[:, :-1], u[:, 1:], ca.repmat(q, 1, u.shape[1] - 1))


def prepare(case: Case, stride: int = 1, compiled: bool = False) -> Solver:
    """Write the nonlinear program: unknowns, and states every `stride` samples that must be continuous."""
    one = _maneuver(case, stride)
    maneuvers, samples, _ = case.inputs.shape
    segments = (samples - 1) // stride
    order = [k // stride if k % stride == 0 and k < samples - 1 else segments + k - 1 for k in range(samples)]
    z = ca.MX.sym("z", len(case.start))
    variables, gaps, misfits = [z], [], []
    for w in range(maneuvers):
        q = case.center[w] + case.scale[w] * z[case.index[w].tolist()]
        u = ca.DM(case.inputs[w].T)
        nodes = ca.MX.sym(f"nodes{w}", len(case.rates), segments - 1)
        first = one.begin(q)
        x = one.flown(ca.horzcat(first, nodes), u, q)
        variables.append(ca.vec(nodes))
        gaps.append(ca.vec(x[:, stride - 1 : -1 : stride] - nodes))
        known = ca.horzcat(first, nodes, x)[:, order]
        read = one.read(known, u, ca.repmat(q, 1, samples))
        misfits.append(ca.vec((read - case.measured[w].T) / case.sigma))
    residuals = ca.vertcat(*misfits, z[case.coefficients :])
    solver = _gauss_newton(ca.vertcat(*variables), residuals, ca.vertcat(*gaps), compiled)
    whole = _maneuver(case, samples - 1)

    def states(q: FloatArray, u: FloatArray) -> FloatArray:
        return np.array(whole.flown(whole.begin(q), u.T, ca.DM(q)))

    def simulate(unknowns: FloatArray) -> FloatArray:
        pairs = zip(case.numbers(unknowns), case.inputs, strict=True)
        return np.stack([
            np.array(one.read(ca.horzcat(one.begin(q), states(q, u)), u.T, ca.repmat(q, 1, samples))).T
            for q, u in pairs
        ])  # fmt: skip

    def fit() -> Found:
        pairs = zip(case.numbers(case.start), case.inputs, strict=True)
        guess = [states(q, u)[:, stride - 1 : -1 : stride].ravel(order="F") for q, u in pairs]
        end = solver(x0=np.concatenate([case.start, *guess]), lbg=0.0, ubg=0.0)
        if not solver.stats()["success"]:
            raise RuntimeError(f"IPOPT: {solver.stats()['return_status']}")
        iterations = solver.stats()["iter_count"]
        return Found(
            np.array(end["x"]).ravel()[: len(case.start)], iterations, solver.stats()["n_call_nlp_g"]
        )

    return Solver(simulate, fit)


def _maneuver(case: Case, stride: int) -> Maneuver:
    x, q = ca.SX.sym("x", len(case.rates)), ca.SX.sym("q", case.index.shape[1])
    now, end = (ca.SX.sym(name, case.inputs.shape[2]) for name in ("now", "end"))
    rates, readings, beginning = (case.printed(e, ca) for e in (case.rates, case.readings, case.beginning))
    rhs = ca.Function("rhs", [x, now, q], [ca.vertcat(*rates(x, now, q))])
    middle, dt, samples = (now + end) / 2.0, case.dt, case.inputs.shape[1]
    k1 = rhs(x, now, q)
    k2 = rhs(x + dt / 2.0 * k1, middle, q)
    k3 = rhs(x + dt / 2.0 * k2, middle, q)
    k4 = rhs(x + dt * k3, end, q)
    step = ca.Function("step", [x, now, end, q], [x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)])
    segment = step if stride == 1 else step.mapaccum(stride)
    segments = (samples - 1) // stride
    return Maneuver(
        ca.Function("begin", [q], [ca.vertcat(*beginning(x, now, q))]),
        segment if segments == 1 else segment.map(segments),
        ca.Function("read", [x, now, q], [ca.vertcat(*readings(x, now, q))]).map(samples),
    )


def _gauss_newton(v: Any, residuals: Any, gaps: Any, compiled: bool) -> Any:
    """Return IPOPT on half the sum of squares, whose Hessian is J'J: constraints are left out of it."""
    jacobian, factor = ca.jacobian(residuals, v), ca.MX.sym("factor")
    inputs = {"x": v, "lam_f": factor, "hess_gamma_x_x": ca.triu(factor * (jacobian.T @ jacobian))}
    hessian = ca.Function("nlp_hess_l", inputs, ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"])
    options = {**QUIET, **(COMPILED if compiled else {}), "hess_lag": hessian}
    problem = {"x": v, "f": 0.5 * ca.dot(residuals, residuals), "g": gaps}
    return ca.nlpsol("solver", "ipopt", problem, options)

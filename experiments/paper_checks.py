"""Measured figures of ``paper_notes.md``: the places where the paper does not hold as printed, and by how much.

    python -m experiments.paper_checks [CHECK ...]

Without arguments all checks run, in about a minute. Those in this file need no simulation.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from coopmm_jax import runtime
from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.control import chain
from coopmm_jax.control.backstepping import backstepping_errors, reference_velocity
from coopmm_jax.control.reference import Desired
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.rollout import as_scalars
from coopmm_jax.loop.start import initial_state
from coopmm_jax.mechanics import robot_kinematics
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.robot_kinematics import chained_rates
from coopmm_jax.parameters import PAPER_START, Geometry, Parameters, Structure
from experiments import paper_runs

Figures = dict[str, Any]  # name, with its unit -> one value or several


def reference() -> Figures:
    """Reference x_1d = 2.4 cos t, y_1d = 4.0 sin t, th_1d = t: its side slip, and the gap that arm I must bridge."""
    t = np.linspace(0.0, 2.0 * np.pi, 100_001)
    s, c = np.sin(t), np.cos(t)

    def slip(y: float) -> float:
        return np.abs(-2.4 * s * c + y * c * s).max()

    def distance(y: float) -> float:
        return np.hypot((2.4 - 1.7) * c, (y - 1.7) * s).max()

    g = Geometry()
    return {
        "side slip with y_1d = 4.0 sin t, 2.4 sin t [m/s]": [slip(4.0), slip(2.4)],
        "the same with forward = (cos th, sin th) [m/s]": [np.hypot(2.4 * s * s, y * c * c).max() for y in (4.0, 2.4)],
        "platform I to the object at the farthest, with 4.0, 2.4 [m]": [distance(4.0), distance(2.4)],
        "reach of the arm [m]": 2.0 * (g.l2 + g.l3),
        "side slip at the start, xdot_1 = 0.5 at th = 0 [m/s]": 0.5 * np.cos(PAPER_START[0].th),
    }


def start() -> Figures:
    """Start angles as printed, those that meet the constraints, and the constraint forces there."""
    with jax.enable_x64(True):
        parameters, structure = as_scalars(Parameters(), float), Structure()
        model = build_model(parameters)
        printed = kinematics(model, structure.rows, tuple(map(robot_kinematics.chained, PAPER_START)), (0.0,) * 6)
        state, residual, *_ = initial_state(structure, model, parameters)
        _, signals = closed_loop(structure, model, parameters.gains.k0 * 0.0, state)
    return {
        "phi at the printed angles [m]": printed.reduction.rows.phi,
        "a2, a3 of robot I, II that meet the constraints [rad]": [angle for p in state.position for angle in p[4:]],
        "|phi| there [m]": residual,
        "lambda(0) there, printed as 0 [N]": signals.constraint_force,
    }


def coriolis() -> Figures:
    """C_i1 below (5) for the platform alone (m_p, d ahead of the axle), at the speed of the reference."""
    m, d, th, speed, yaw_rate = 5.0, 0.5, 0.3, 2.4, 1.0
    s, c = np.sin(th), np.cos(th)
    R = np.array([[-s, 0.0], [c, 0.0], [0.0, 1.0]])
    R_rate = yaw_rate * np.array([[-c, 0.0], [-s, 0.0], [0.0, 0.0]])
    M = m * np.array([[1.0, 0.0, -d * c], [0.0, 1.0, -d * s], [-d * c, -d * s, d * d]])
    C = m * d * yaw_rate * np.array([[0.0, 0.0, s], [0.0, 0.0, -c], [0.0, 0.0, 0.0]])
    v = np.array([speed, yaw_rate])
    # R^T M R does not change as the platform turns, so the power v^T C_i1 v must vanish.
    return {
        "v^T C_i1 v as printed [W]": v @ (R.T @ C @ R + R_rate.T @ C @ R) @ v,
        "v^T C_i1 v with R^T (M Rdot + C R) [W]": v @ R.T @ (M @ R_rate + C @ R) @ v,
    }


def backstepping() -> Figures:
    """Equations (26) and (27) by differentiation along (8), at u_d1 = 1.5: readings of (12), (14), (27) that agree."""
    gains, u_d1, eta, utilde = Gains(), 1.5, 0.05, (0.1, 0.2)
    position, target = (
        robot_kinematics.Position(0.2, 2.5, 0.1, 0.0, 0.0, 0.0),
        Desired(0.0, 2.4, 0.0, u_d1, 0.0, 0.0, (), ()),
    )
    z = reference_velocity(gains, target, position, (), eta)
    moved = robot_kinematics.Position(*chained_rates(position, z[0] + utilde[0], z[1] + utilde[1]), 0.0, 0.0, 0.0)
    target_moved = Desired(u_d1, 0.0, 0.0, 0.0, 0.0, 0.0, (), ())
    with jax.enable_x64(True):
        along = jax.tree.map(np.float64, ((target, position), (target_moved, moved)))
        s, s_rate = jax.tree.map(float, jax.jvp(lambda *at: backstepping_errors(gains, *at), *along))
    w = eta + utilde[0]
    s2_rate = w * position.z3 + s.s3 * u_d1 - gains.k2 * s.s2 * u_d1**2  # (26)
    s3_rate = -gains.k3 * s.s3 - s.s2 * u_d1 + utilde[1]  # (27) without its sum
    term = w * gains.k2 * u_d1 * position.z3
    without_factor = s_rate.s3 + gains.k2 * s.e3 * (u_d1**2 - u_d1)
    return {
        "(26) with (14) as read here": s_rate.s2 - s2_rate,
        "(26) with s_(n_v-2) in s_3, as (14) prints": s_rate.s2 - (s2_rate + s.s1 * u_d1),
        "(27) with + and the limit n_v - 1": s_rate.s3 - (s3_rate + term),
        "(27) with - and the limit n_v - 1": s_rate.s3 - (s3_rate - term),
        "(27) as printed (an empty sum)": s_rate.s3 - s3_rate,
        "(27) with (12) as printed, no u_d1 in its last sum": without_factor - (s3_rate + term),
    }


def longer_chain() -> Figures:
    """Equations (26) and (32) at n_v = 4 by differentiation along (8), at u_d1 = 1.5: which power of u_d1 agrees."""
    k, k0, eta, utilde = (2.0, 0.7, 1.1, 0.9), 1.3, 0.05, (0.1, 0.2)
    zeta, target = (0.1, 0.5, 0.9, -0.3), (0.3, 0.2, -0.4, 0.6)

    def along(t: Any, zeta: Any, target: Any) -> chain.Chain:
        u_d1 = derivatives(lambda t: 1.5 + 0.6 * t - 0.1 * t * t, t, 2)
        return chain.Chain(zeta, tuple(x - y for x, y in zip(zeta, target, strict=True)), u_d1, 0.25)

    def energy(eta: Any, *at: Any) -> Any:
        return chain.stored(k, along(*at)) + 0.5 * eta * eta

    with jax.enable_x64(True):
        now = along(0.0, zeta, target)
        (z1, z2), Lambda = chain.platform_velocity(k, now, eta), chain.signal(k, now)
        eta_rate, w, u_d1 = -k0 * eta - Lambda[0], eta + utilde[0], now.u1[0]
        u, u_d = (z1 + utilde[0], z2 + utilde[1]), (u_d1, now.u2)
        moved = [(v[0], v[0] * x[2], v[0] * x[3], v[1]) for v, x in ((u, zeta), (u_d, target))]
        at, moving = jax.tree.map(np.float64, ((eta, 0.0, zeta, target), (eta_rate, 1.0, *moved)))
        s, s_rate = jax.jvp(lambda *at: chain.errors(k, along(*at)), at[1:], moving[1:])
        V1_rate = jax.jvp(energy, at, moving)[1]
        s, s_rate, V1_rate, Lambda, w, u_d1 = jax.tree.map(float, (s, s_rate, V1_rate, Lambda, w, u_d1))
    s2_rate, crossing = w * zeta[2] + s[2] * u_d1, utilde[0] * Lambda[0] + utilde[1] * Lambda[1]
    middle, ends = 0.7 * s[1] ** 2 + 1.1 * s[2] ** 2, 0.9 * s[3] ** 2 + k0 * eta**2

    def off(power: int) -> list[float]:
        factor = u_d1**power
        return [s_rate[1] - (s2_rate - 0.7 * s[1] * factor), V1_rate - crossing + middle * factor + ends]

    return {
        "(26) and (32) with u_d1^(2 l), as (40)": off(2 * (len(zeta) - 2)),
        "(26) and (32) with u_d1^2, as printed": off(2),
    }


def robust_term() -> Figures:
    """Left less right side of (34) in one dimension: Mr = beta = lam_min = 1, c = 0, chat 2, f |sigma| 10, delta 1."""
    c_hat, delta, push = 2.0, 1.0, 10.0  # push = f |sigma|

    def excess(robust: float) -> float:
        return c_hat * push - robust - delta  # the terms in alpha are the same on both sides

    return {
        "chat in the denominator (proof)": excess((c_hat * push) ** 2 / (c_hat * push + delta)),
        "chat outside (printed)": excess(c_hat * push**2 / (push + delta)),
    }


def u26() -> Figures:
    """Bound (39) at |Lambda| = 100, delta_6 = 0.01, Mr = beta = 1, utilde_b = sigma along Lambda."""
    Lambda, delta = 100.0, 0.01
    sigma = np.geomspace(1e-6, 1e2, 200_001)
    counterexample = np.sqrt(delta / Lambda)

    def printed(sigma: Any) -> Any:
        return sigma * Lambda - sigma * Lambda**2 * sigma**2 / (Lambda * sigma**2 + delta)

    corrected = sigma * Lambda - Lambda**2 * sigma**2 / (Lambda * sigma + delta)
    return {
        "right side, delta_6": delta,
        "left side as printed at |sigma|^2 = delta_6 / |Lambda|": printed(counterexample),
        "largest left side, printed and corrected": [printed(sigma).max(), corrected.max()],
    }


CHECKS: dict[str, Callable[[], Figures]] = {
    check.__name__: check
    for check in (reference, start, coriolis, backstepping, longer_chain, robust_term, u26, *paper_runs.CHECKS)
}


def main(names: Sequence[str]) -> int:
    """Print the named checks, or all; exit code 2 for a name that is none."""
    unknown = [name for name in names if name not in CHECKS]
    if unknown:
        print(f"paper_checks: check: must be one of {', '.join(CHECKS)}, was {unknown[0]}", file=sys.stderr)
        return 2
    runtime.use_fast_compilation()
    runtime.use_compilation_cache()
    for name in names or CHECKS:
        check = CHECKS[name]
        print(f"\n{name}: {check.__doc__}")
        for what, value in check().items():
            print(f"  {what}: {_shown(value)}", flush=True)
    return 0


def _shown(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, list | tuple | np.ndarray):
        return ", ".join(map(_shown, value))
    return f"{float(value):.4g}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

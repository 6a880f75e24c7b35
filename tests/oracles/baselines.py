"""The controllers that the paper's is compared with, on numpy arrays, from their equations; all four rows in force.

Every law gives F on all joints (10,) at q (2, 6), an admissible u (10,) and a state; circles are the reference.

>>> joint_errors(2.0, Reference(), 0.0, np.zeros((2, 4)), np.zeros((2, 4)))[0].round(2).tolist()
[0.0, -4.8, -1.05, 0.0, -2.0, -1.57]
"""

from __future__ import annotations

from typing import Any

import numpy as np

from coopmm_jax.parameters import ALL_ROWS, Gains, Parameters, Reference, Structure
from tests.oracles import control_law, lagrangian

INDEPENDENT = control_law.INDEPENDENT


def chained(q: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(z1, z2, z3, a1) of each robot (2, 4), and their rates."""
    zeta = np.array([[*lagrangian.chained_position(q_i), q_i[3]] for q_i in q])
    rates = np.array([[u[i], u[i] * z[2], u[i + 1], u[i + 2]] for i, z in zip((0, 5), zeta, strict=True)])
    return zeta, rates


def joint_errors(
    k2: float, reference: Reference, t: float, zeta: np.ndarray, zeta_rate: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """p, r and rdot (6,) of both robots on their circles, where u_d1 is constant and u_d2 = z_d3 = 0."""
    w, swing = reference.rate, np.array(reference.arm_swing)
    angle, one = reference.arm_rate * t, np.ones(2)
    desired_arm = np.array(reference.arm_centre) - swing * np.cos(angle)
    lateral, forward = zeta[:, 1] - np.array(reference.radius), zeta[:, 2]
    p = np.stack([zeta[:, 0] - w * t, forward + k2 * w * lateral, zeta[:, 3] - desired_arm], axis=1)
    r = np.stack([w * one, -k2 * w**2 * forward, swing * reference.arm_rate * np.sin(angle)], axis=1)
    arm_acceleration = swing * reference.arm_rate**2 * np.cos(angle)
    r_rate = np.stack([0 * one, -k2 * w**2 * zeta_rate[:, 2], arm_acceleration], axis=1)
    return p.ravel(), r.ravel(), r_rate.ravel()


class Nominal:
    """The nominal model at one state, and how it turns an acceleration or a reduced force into F (10,)."""

    def __init__(self, structure: Structure, parameters: Parameters, q: np.ndarray, u: np.ndarray):
        plant = parameters.plant._replace(inertia=parameters.nominal)
        terms = lagrangian.coupled_terms(plant, ALL_ROWS, q, u)
        self.full = structure.feedforward == "full"
        self.M, self.h, self.B = terms.M, terms.h, terms.B
        self.L, self.L_dot_u1 = lagrangian.velocity_basis(ALL_ROWS, terms)
        self.weight = lagrangian.coupled_terms(plant, ALL_ROWS, q, 0 * u).h
        self.spread = np.linalg.pinv(self.L.T)

    def force(self, acceleration: np.ndarray) -> np.ndarray:
        """F (10,) that gives du^1/dt (6,) where this model is right."""
        whole = self.M @ (self.L @ acceleration + self.L_dot_u1) + self.h
        return whole if self.full else self.spread @ self.L.T @ whole


def paper_gains(gains: Any) -> Gains:
    """Gains of the paper's law that agree with those of another law on sigma where it has them."""
    return Gains(**{name: value for name, value in gains._asdict().items() if name in Gains._fields})


def on_sigma(
    structure: Structure, parameters: Parameters, t: float, q: np.ndarray, u: np.ndarray, state: Any
) -> control_law.Law:
    """The paper's law with c in the place of chat, and the kinematics and the feedback of sigma of these gains."""
    gains = parameters.gains
    c = np.array(getattr(gains, "c", (1.0,) * 5))
    controller = control_law.ControllerState(np.array(state.integral), np.array(state.eta), c, np.zeros(4))
    return control_law.motion_control(structure, parameters._replace(gains=paper_gains(gains)), t, q, u, controller)


def model_based(structure: Structure, parameters: Parameters, t: float, q: Any, u: Any, state: Any) -> np.ndarray:
    """(17), F (10,)."""
    law = on_sigma(structure, parameters, t, q, u, state)
    acceleration = law.nu_rate - np.array(parameters.gains.K_sigma) * law.sigma
    return Nominal(structure, parameters, q, u).force(acceleration)


def robust_fixed(structure: Structure, parameters: Parameters, t: float, q: Any, u: Any, state: Any) -> np.ndarray:
    """(18) and (19) with bounds that are given, F (10,)."""
    return on_sigma(structure, parameters, t, q, u, state).force


def sliding_mode(structure: Structure, parameters: Parameters, t: float, q: Any, u: Any, state: Any) -> np.ndarray:
    """Constant and proportional reaching rate in a boundary layer, F (10,)."""
    gains, law = parameters.gains, on_sigma(structure, parameters, t, q, u, state)
    reaching = np.array(gains.K_sigma) * law.sigma + np.array(gains.K_switch) * np.tanh(law.sigma / gains.layer)
    return Nominal(structure, parameters, q, u).force(law.nu_rate - reaching)


def computed_torque_pi(
    structure: Structure, parameters: Parameters, t: float, q: np.ndarray, u: np.ndarray, state: Any
) -> np.ndarray:
    """PD on the joints through the inverse dynamics, F (10,)."""
    gains = parameters.gains
    p, r, r_rate = joint_errors(gains.k2, parameters.reference, t, *chained(q, u))
    acceleration = r_rate - np.array(gains.K_d) * (u[INDEPENDENT] - r) - np.array(gains.K_p) * p
    return Nominal(structure, parameters, q, u).force(acceleration)


def pid(structure: Structure, parameters: Parameters, t: float, q: np.ndarray, u: np.ndarray, state: Any) -> np.ndarray:
    """PID of wheels and arm yaws, with the arms' weight held, F (10,)."""
    gains, nominal = parameters.gains, Nominal(structure, parameters, q, u)
    p, r, _ = joint_errors(gains.k2, parameters.reference, t, *chained(q, u))
    angle, rate = (nominal.B[INDEPENDENT].T @ error for error in (p, u[INDEPENDENT] - r))
    torque = np.zeros(10)
    torque[INDEPENDENT] = -(
        np.array(gains.K_p) * angle[INDEPENDENT]
        + np.array(gains.K_int) * np.array(state.error_integral)
        + np.array(gains.K_d) * rate[INDEPENDENT]
    )
    return nominal.weight + nominal.B @ torque

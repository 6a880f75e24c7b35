"""One robot against two independent derivations: inertia, bias forces, chained form, actuators, tip."""

import jax
import numpy as np
import pytest

from coopmm_jax.algebra.matrix import dot
from coopmm_jax.mechanics import robot_dynamics, robot_kinematics
from coopmm_jax.parameters import Pose
from tests.oracles import lagrangian, mujoco_tree
from tests.samples import GRAVITY, assert_close, linear_map, random_robot, vector

SEEDS = range(12)


def sample(seed):
    """A random robot; every third one carries no object, every fourth has its arm on the axle."""
    rng = np.random.default_rng(seed)
    geometry, inertia, q, u = random_robot(rng)
    if seed % 3 == 0:
        inertia = inertia._replace(m_obj=0.0)
    if seed % 4 == 0:
        geometry = geometry._replace(mount_offset=0.0)
    return geometry, inertia, q, u


def equation_of_motion(geometry, inertia, q, u):
    """M_i2 (5, 5) and C_i2 u + G_i2 (5,) of (9), as the simulator's inverse dynamics has them."""
    position = robot_kinematics.chained(Pose(*q.tolist()))
    arm, T = robot_kinematics.posture(geometry, position), robot_kinematics.body_map(geometry, position)
    velocity = tuple(u.tolist())
    factors = robot_dynamics.factors(geometry, GRAVITY, arm, T @ velocity)
    T_rate = robot_kinematics.body_map_rate(geometry, position, velocity)
    terms = robot_dynamics.dynamics(robot_dynamics.lump(geometry, inertia), factors, T, T_rate)

    def force(acceleration):
        return robot_dynamics.inverse_dynamics(terms, acceleration)

    at_rest = (0.0,) * 5
    return np.array(jax.jacfwd(force)(at_rest), dtype=float), vector(force(at_rest))


@pytest.mark.parametrize("seed", SEEDS)
def test_equation_of_motion_is_the_lagrangian(seed):
    geometry, inertia, q, u = sample(seed)
    M, h = equation_of_motion(geometry, inertia, q, u)
    M_energy, h_energy = lagrangian.chained_terms(geometry, inertia, GRAVITY, q, u)
    assert_close(M, M_energy, 3e-15)
    assert_close(h, h_energy, 8e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_equation_of_motion_is_mujocos(seed):
    geometry, inertia, q, u = sample(seed)
    M, h = equation_of_motion(geometry, inertia, q, u)
    T = np.asarray(lagrangian.chained_velocity_map(q))
    q_dot = np.asarray(lagrangian.chained_basis(q)) @ u
    _, T_dot_u = jax.jvp(lambda q: lagrangian.chained_velocity_map(q) @ u, (q,), (q_dot,))
    M_v, h_v = mujoco_tree.quasi_velocity_terms(geometry, inertia, GRAVITY, q, T @ u)
    assert_close(M, T.T @ M_v @ T, 1e-13)
    assert_close(h, T.T @ (M_v @ T_dot_u + h_v), 1e-13)


@pytest.mark.parametrize("seed", SEEDS[:5])
def test_inertia_is_symmetric_and_positive_definite(seed):
    M, _ = equation_of_motion(*sample(seed))
    assert_close(M, M.T, 1e-16)
    assert np.linalg.eigvalsh(M).min() > 0


@pytest.mark.parametrize("seed", SEEDS[:5])
def test_chained_form_and_back(seed):
    *_, q, _ = sample(seed)
    position = robot_kinematics.chained(Pose(*q.tolist()))
    assert_close(vector(position)[:3], lagrangian.chained_position(q), 1e-15)
    assert_close(vector(robot_kinematics.unchained(position)), q, 1e-15)


@pytest.mark.parametrize("seed", SEEDS[:5])
def test_actuators_and_back(seed):
    geometry, _, q, u = sample(seed)
    position = robot_kinematics.chained(Pose(*q.tolist()))
    B = linear_map(lambda torque: vector(robot_kinematics.actuator_force(geometry, position, torque)), 5)
    assert_close(B, lagrangian.input_matrix(geometry, q), 1e-15)
    torque = tuple(u.tolist())
    force = robot_kinematics.actuator_force(geometry, position, torque)
    assert_close(vector(robot_kinematics.actuator_torque(geometry, position, force)), u, 1e-15)


@pytest.mark.parametrize("seed", SEEDS[:5])
def test_tip_position_and_velocity(seed):
    geometry, _, q, u = sample(seed)
    position = robot_kinematics.chained(Pose(*q.tolist()))
    arm = robot_kinematics.posture(geometry, position)
    q_dot = np.asarray(lagrangian.chained_basis(q)) @ u
    tip, speed = jax.jvp(lambda q: lagrangian.bodies(geometry, q).tip, (q,), (q_dot,))

    def turned(v, angle):
        """A vector of space along axes turned by angle: (lateral, forward, up)."""
        s, c = np.sin(angle), np.cos(angle)
        return np.array([v[0] * c + v[1] * s, -v[0] * s + v[1] * c, v[2]])

    lateral, forward, up = turned(speed, q[2] + q[3])
    rates = robot_kinematics.body_map(geometry, position) @ tuple(u.tolist())
    assert_close(vector(robot_kinematics.tip_in_platform(geometry, position, arm)), turned(tip, q[2]), 1e-15)
    rows = robot_kinematics.tip_rows(geometry, arm)
    assert_close(vector(dot(row, rates) for row in rows), np.array([forward, -lateral, up]), 1e-14)

"""The oracles agree with each other and with mechanics, so the other tests may lean on them."""

import jax
import numpy as np
import pytest

from coopmm_jax.parameters import ALL_ROWS, PAPER_START, Plant
from tests.oracles import lagrangian, mujoco_tree
from tests.samples import GRAVITY, ROW_SETS, admissible, assert_close, random_pair, random_robot


def power(geometry, inertia, q, u, u_dot):
    """d(T + U)/dt along qdot = R T u."""
    along = (np.asarray(lagrangian.chained_basis(q) @ u), u_dot)
    return jax.jvp(lambda q, u: lagrangian.energy(geometry, inertia, GRAVITY, q, u), (q, u), along)[1]


@pytest.mark.parametrize("seed", range(30))
def test_lagrangian_agrees_with_mujoco(seed):
    robot = random_robot(np.random.default_rng(seed))
    if seed % 3 == 0:
        robot = (robot[0], robot[1]._replace(m_obj=0.0), *robot[2:])
    geometry, inertia, q, v = robot
    M, h = lagrangian.quasi_velocity_terms(geometry, inertia, GRAVITY, q, v)
    M_tree, h_tree = mujoco_tree.quasi_velocity_terms(geometry, inertia, GRAVITY, q, v)
    assert_close(M, M_tree, 1e-13)
    assert_close(h, h_tree, 5e-14)


@pytest.mark.parametrize("seed", range(5))
def test_inertia_is_symmetric_and_positive_definite(seed):
    geometry, inertia, q, u = random_robot(np.random.default_rng(seed))
    M, _ = lagrangian.chained_terms(geometry, inertia, GRAVITY, q, u)
    assert_close(M, M.T, 1e-15)
    assert np.linalg.eigvalsh(M).min() > 0


@pytest.mark.parametrize("seed", range(5))
def test_forces_deliver_the_rate_of_energy(seed):
    rng = np.random.default_rng(seed)
    geometry, inertia, q, u = random_robot(rng)
    u_dot = rng.uniform(-3, 3, 5)
    M, h = lagrangian.chained_terms(geometry, inertia, GRAVITY, q, u)
    assert float(u @ (M @ u_dot + h)) == pytest.approx(float(power(geometry, inertia, q, u, u_dot)), rel=1e-14)


def test_chained_form_follows_from_the_velocity_map():
    rng = np.random.default_rng(0)
    _, _, q, u = random_robot(rng)
    q_dot = np.asarray(lagrangian.chained_basis(q) @ u)
    z, z_dot = jax.jvp(lagrangian.chained_position, (q,), (q_dot,))
    assert_close(z_dot, [u[0], u[0] * z[2], u[1]], 1e-15)
    assert abs(q_dot[0] * np.cos(q[2]) + q_dot[1] * np.sin(q[2])) < 1e-15


def test_actuators_push_as_the_model_page_says():
    rng = np.random.default_rng(0)
    geometry, _, q, u = random_robot(rng)
    tau = rng.uniform(-1, 1, 5)
    right, left = tau[:2]
    on_quasi_velocities = [(right + left) / geometry.r, (right - left) * geometry.l / geometry.r, *tau[2:]]
    v = np.asarray(lagrangian.chained_velocity_map(q) @ u)
    B = lagrangian.input_matrix(geometry, q)
    assert float(u @ B @ tau) == pytest.approx(float(v @ np.array(on_quasi_velocities)), rel=1e-14)


def test_paper_start_nearly_satisfies_the_constraints():
    start = np.array([pose[:4] for pose in PAPER_START])
    printed_joints = [[-0.731919, 1.463837], [2.094395, 2.094395]]
    phi, *_ = lagrangian.constraint_terms(Plant(), ALL_ROWS, np.hstack([start, printed_joints]), np.zeros(10))
    assert np.abs(phi).max() < 1e-6


def test_contact_depends_on_relative_motion_only():
    plant, q = random_pair(np.random.default_rng(0))
    turn, shift = 0.7, np.array([0.3, -0.4])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = q.copy()
    moved[:, :2] = q[:, :2] @ rotation.T + shift
    moved[:, 2] += turn
    before, after = (lagrangian.constraint_terms(plant, ALL_ROWS, x, np.zeros(10))[0] for x in (q, moved))
    assert_close(after[:2], before[:2], 3e-15)
    assert abs(after[2] - before[2]) > 1e-2
    assert after[3] == before[3]


def test_guide_holds_robot_two_alone():
    plant, q = random_pair(np.random.default_rng(0))
    _, J, _ = lagrangian.constraint_terms(plant, ALL_ROWS, q, np.zeros(10))
    assert np.all(J[2:, :5] == 0)
    assert np.all(np.any(J[:2, :5] != 0, axis=1))


def test_constraint_derivatives_match_differences():
    rng = np.random.default_rng(0)
    plant, q = random_pair(rng)
    u, step = rng.uniform(-1, 1, 10), 1e-5
    q_dot = np.stack([lagrangian.chained_basis(q[i]) @ u[5 * i : 5 * i + 5] for i in range(2)])
    _, J, J_dot_u = lagrangian.constraint_terms(plant, ALL_ROWS, q, u)
    ahead, behind = (lagrangian.constraint_terms(plant, ALL_ROWS, q + sign * step * q_dot, u) for sign in (1, -1))
    assert_close(J @ u, (ahead[0] - behind[0]) / (2 * step), 1e-9)
    assert_close(J_dot_u, (ahead[1] - behind[1]) @ u / (2 * step), 1e-9)


@pytest.mark.parametrize("rows", ROW_SETS)
def test_reduced_dynamics_agree_with_the_multipliers(rows):
    rng = np.random.default_rng(len(rows))
    plant, q = random_pair(rng)
    terms, _ = admissible(rows, plant, q, rng)
    force = terms.B @ rng.uniform(-5, 5, 10)
    u_dot, multipliers = lagrangian.multiplier_solution(terms, force)
    L, L_dot_u1 = lagrangian.velocity_basis(rows, terms)
    M_r, bias = lagrangian.reduced_terms(rows, terms)

    assert L.shape == (10, 10 - len(rows))
    assert np.abs(terms.J @ L).max() < 3e-15
    assert_close(L @ np.linalg.solve(M_r, L.T @ force - bias) + L_dot_u1, u_dot, 3e-14)
    J = terms.J
    from_forces = np.linalg.solve(J @ J.T, J @ (terms.M @ u_dot + terms.h - force))
    assert_close(from_forces, multipliers, 5e-15)


@pytest.mark.parametrize("rows", ROW_SETS)
def test_constraint_forces_do_no_work(rows):
    rng = np.random.default_rng(len(rows))
    plant, q = random_pair(rng)
    terms, u = admissible(rows, plant, q, rng)
    force = terms.B @ rng.uniform(-5, 5, 10)
    u_dot, _ = lagrangian.multiplier_solution(terms, force)
    robots = [slice(0, 5), slice(5, 10)]
    gained = sum(power(plant.geometry[i], plant.inertia[i], q[i], u[own], u_dot[own]) for i, own in enumerate(robots))
    assert float(gained) == pytest.approx(float(u @ force), rel=1e-14)


@pytest.mark.parametrize(
    ("rows", "joints"),
    [
        (ALL_ROWS, [3, 4, 8, 9]),
        (("contact_normal", "contact_height"), [3, 4]),
        (("contact_normal",), [4]),
        (("contact_normal", "guide_radial", "guide_height"), [4, 8, 9]),
    ],
)
def test_each_row_determines_one_joint(rows, joints):
    assert lagrangian.dependent_joints(rows) == joints

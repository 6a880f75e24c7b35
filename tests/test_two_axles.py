"""Platforms on two axles against energies and MuJoCo: inertia, bias, actuators, chained form, coupling, sensors."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.mechanics import robot_dynamics, robot_kinematics, two_axles
from coopmm_jax.mechanics.coordinates import LongPosition, Position
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.partitioning import dependent_solution
from coopmm_jax.mechanics.plant import plant_kinematics, respond
from coopmm_jax.parameters import Car, FrontInertia, LogPolar, Parameters, Plant, Pose, Structure, Trailer
from tests.oracles import lagrangian
from tests.oracles import two_axles as oracle
from tests.samples import GRAVITY, assert_close, linear_map, pair, random_geometry, random_inertia, vector

SEEDS = range(14)
POLAR = range(10, 14)  # of those in the chart about the origin


def robot(seed):
    """A random robot, a trailer if its seed is even and else a car: geometry, inertia, q (7,), u (5,)."""
    rng = np.random.default_rng(seed)
    front = (Car if seed % 2 else Trailer)(*rng.uniform(0.3, 1.0, 4).tolist(), unit=rng.uniform(0.5, 4.0))
    if seed in POLAR:
        front = front._replace(unit=None, chart=LogPolar())
    geometry = random_geometry(rng)._replace(front=front)
    inertia = random_inertia(rng)._replace(front=FrontInertia(*rng.uniform(0.3, 3.0, 3).tolist()))
    q = rng.uniform(-2, 2, 7)
    q[3] = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 1.2)
    if seed in POLAR:  # round the origin to the left, within 70 degrees of a circle; one of them straight ahead
        bearing, r = rng.uniform(-1.5, 1.5), rng.uniform(0.5, 3.0)
        q[:3] = r * np.cos(bearing), r * np.sin(bearing), bearing + rng.uniform(-1.2, 1.2)
        q[3] *= seed != POLAR[-1]
    return geometry, inertia, q, rng.uniform(-2, 2, 5)


def position_of(geometry, q):
    return robot_kinematics.standing(geometry, Pose(*q[oracle.REST], steer=q[3]), 0.0)


@jax.jit
def forces(geometry, inertia, q, u):
    """Those that the simulator's inverse dynamics asks for (5, 6), at rest and for one unit of each acceleration."""
    position, velocity = position_of(geometry, q), tuple(u)
    arm = robot_kinematics.posture(geometry, position)
    T = robot_kinematics.body_map(geometry, position)
    T_rate = robot_kinematics.body_map_rate(geometry, position, velocity)
    terms = robot_dynamics.dynamics(
        robot_dynamics.lump(geometry, inertia),
        robot_dynamics.factors(geometry, GRAVITY, arm, T @ velocity),
        T,
        T_rate,
        two_axles.front_motion(geometry.front, position, velocity),
    )
    return jnp.stack(robot_dynamics.inverse_dynamics(terms, tuple(np.eye(5, 6, 1))))


def equation_of_motion(geometry, inertia, q, u):
    """M (5, 5) and h (5,)."""
    found = np.asarray(forces(geometry, inertia, q, u))
    return found[:, 1:] - found[:, :1], found[:, 0]


@pytest.mark.parametrize("seed", SEEDS)
def test_equation_of_motion_is_that_of_energies_and_mujocos(seed):
    geometry, inertia, q, u = robot(seed)
    M, h = equation_of_motion(geometry, inertia, q, u)
    M_energy, C_energy, G_energy = map(np.asarray, oracle.chained_terms(geometry, inertia, GRAVITY, q, u))
    assert_close(M, M_energy, 1e-13)
    assert_close(h, C_energy @ u + G_energy, 1e-12)
    assert_close(M, M.T, 1e-14)
    assert np.linalg.eigvalsh(M).min() > 0
    M_tree, h_tree = oracle.mujoco_terms(geometry, inertia, GRAVITY, q, u)
    assert_close(M, M_tree, 1e-11)
    assert_close(h, h_tree, 1e-11)


@pytest.mark.parametrize("seed", [*SEEDS[:4], *POLAR])
def test_rate_of_inertia_less_twice_coriolis_is_skew(seed):
    geometry, inertia, q, u = robot(seed)
    q_dot = np.asarray(oracle.chained_basis(geometry, q)) @ u
    step = 1e-4 / max(1.0, np.abs(q_dot).max() / 4.0)
    around = [
        w * equation_of_motion(geometry, inertia, q + k * step * q_dot, u)[0]
        for k, w in ((-2, 1), (-1, -8), (1, 8), (2, -1))
    ]
    _, C, _ = map(np.asarray, oracle.chained_terms(geometry, inertia, GRAVITY, q, u))
    difference = sum(around) / (12 * step) - 2 * C
    assert np.abs(difference + difference.T).max() < 1e-8 * np.abs(difference).max()


@pytest.mark.parametrize("seed", [*SEEDS[:6], *POLAR])
def test_chained_form_steering_and_actuators(seed):
    geometry, _, q, u = robot(seed)
    position = position_of(geometry, q)
    assert isinstance(position, LongPosition)
    z, z_dot = jax.jvp(partial(oracle.chained, geometry), (q,), (np.asarray(oracle.chained_basis(geometry, q)) @ u,))
    assert_close(vector(position)[:4], z, 1e-14)
    assert_close(vector(robot_kinematics.position_rates(position, tuple(u)))[:4], z_dot, 1e-12)
    assert float(two_axles.steering(geometry.front, position)) == pytest.approx(q[3], rel=1e-13)
    read = robot_kinematics.mismeasured(geometry, position, Position(*(0.01 * u), 0.02), 0.03)
    shifted = q + np.array([0.0, 0.0, 0.0, 0.03, 0.01 * u[3], 0.01 * u[4], 0.02])
    assert float(two_axles.steering(geometry.front, read)) == pytest.approx(shifted[3], rel=1e-12)
    place = vector(robot_kinematics.placed(geometry, read))
    expected = np.concatenate([lagrangian.chained_position(q[oracle.REST]) + 0.01 * u[:3], shifted[4:]])
    assert_close(place, expected, 1e-14)
    B = linear_map(lambda torque: vector(robot_kinematics.actuator_force(geometry, position, torque)), 5)
    assert_close(B, oracle.input_matrix(geometry, q), 1e-13)
    force = robot_kinematics.actuator_force(geometry, position, tuple(u))
    assert_close(vector(robot_kinematics.actuator_torque(geometry, position, force)), u, 1e-11)
    rates = robot_kinematics.actuator_rates(geometry, position, tuple(u))
    assert_close(vector(rates), B.T @ u, 1e-13)


FRONTS = (Trailer(unit=12.02), Car(unit=2.5))


def coupled():
    """Trailer and car on all rows near the nominal motion, moving: model, kinematics, q (2, 7)."""
    paper, rng = Plant(), np.random.default_rng(3)
    plant = paper._replace(
        geometry=tuple(g._replace(front=front) for g, front in zip(paper.geometry, FRONTS, strict=True)),
        inertia=tuple(i._replace(front=FrontInertia(2.0, 0.7, 0.3)) for i in paper.inertia),
    )
    model = build_model(Parameters(plant=plant, nominal=plant.inertia))
    q = np.array([[2.4, 0.0, 0.0, 0.2, 1.35, -0.75, 1.5], [1.0, 0.0, 0.0, 0.45, 1.57, 2.34, 1.6]])
    q[:, :4] += rng.uniform(-0.03, 0.03, (2, 4))
    position = tuple(position_of(g, row) for g, row in zip(plant.geometry, q, strict=True))
    independent = tuple(rng.uniform(-1, 1, 6).tolist())
    for _ in range(8):
        k = plant_kinematics(Structure(), model, 0.0, position, independent)
        change = dependent_solution(k.reduction, k.reduction.rows.phi)
        position = tuple(map(robot_kinematics.arm_moved, position, change))
    q[:, 4:] = [vector(p[4:]) for p in position]
    return model, plant, plant_kinematics(Structure(), model, 0.0, position, independent), q


def test_power_balance_of_trailer_and_car():
    """Energy changes by what the actuators do: neither rolling nor a constraint row does any work."""
    model, plant, k, q = coupled()
    model = model._replace(disturbance=())
    torque = np.random.default_rng(0).uniform(-5, 5, 10)
    force = tuple(map(robot_kinematics.actuator_force, plant.geometry, k.bodies.position, pair(torque)))
    moved = respond(Structure(), model, 0.0, k, force)
    gained = power = 0.0
    for i in range(2):
        u, u_dot = vector(k.velocity[i]), vector(moved.full[i])
        q_dot = np.asarray(oracle.chained_basis(plant.geometry[i], q[i])) @ u
        about = (plant.geometry[i], plant.inertia[i], GRAVITY)
        gained += float(jax.jvp(lambda q, u, about=about: oracle.energy(*about, q, u), (q[i], u), (q_dot, u_dot))[1])
        power += float(u @ vector(force[i]))
    assert gained == pytest.approx(power, rel=1e-11)
    J = [np.array(each.rows, dtype=float) for each in k.reduction.rows.J]
    assert max(abs(sum(row @ vector(u) for row, u in zip(rows, k.velocity, strict=True))) for rows in zip(*J)) < 1e-13

"""Random robots, pairs of robots and states, and how tests hand them to the simulator and read its answers."""

import jax
import numpy as np

from coopmm_jax.control.robust_adaptive import ControllerState
from coopmm_jax.kinds.surfaces import Conic, Plane, Profile
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics import robot_kinematics
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.partitioning import dependent_solution
from coopmm_jax.parameters import ALL_ROWS, Geometry, Inertia, Parameters, Plant, Pose, Surface
from coopmm_jax.proof import terms as proof_terms
from tests.oracles import lagrangian

GRAVITY = 9.81
ROW_SETS = [
    ALL_ROWS,
    ("contact_normal", "guide_radial", "guide_height"),
    ("contact_normal", "contact_height"),
    ("contact_normal",),
]
SHAPES = {
    "arc": Conic(1.0 / 0.7, 1.0 / 0.7),
    "plane": Plane(),
    "convex arc": Conic(-2.0, -2.0),
    "hollow ellipse": Conic(1.2, 10.0 / 3.0),
    "convex ellipse": Conic(-0.8, -1.5),
    "parabola": Conic(0.9, 0.0),
    "quartic": Profile((0.4, -0.3, 0.5)),
}


def random_geometry(rng):
    return Geometry(*rng.uniform(0.2, 1.0, 6).tolist(), mount_offset=rng.uniform(-0.3, 0.3))


def random_inertia(rng):
    return Inertia(*rng.uniform(0.2, 3.0, 10).tolist())


def random_robot(rng):
    return random_geometry(rng), random_inertia(rng), rng.uniform(-3, 3, 6), rng.uniform(-3, 3, 5)


def random_pair(rng):
    """A plant with both robots near the nominal motion, where the dependent joints are far from singular."""
    plant = Plant(
        (random_geometry(rng), random_geometry(rng)),
        (random_inertia(rng), random_inertia(rng)),
        Surface(*rng.uniform(0.5, 2.0, 3).tolist()),
    )
    th = rng.uniform(-3, 3)
    radius = np.array([2.4, 1.0])
    nominal = np.column_stack(
        [radius * np.cos(th), radius * np.sin(th), [th, th], [1.2, 1.57], [-0.7, 2.1], [1.5, 2.1]]
    )
    return plant, nominal + rng.uniform(-0.2, 0.2, (2, 6))


def random_states(rng, count, at=None):
    """Times (count,) and states of the paper's loop around its nominal motion, at random times or all ``at`` one."""

    def around(*values, width=0.1):
        return tuple(value + rng.uniform(-width, width, count) for value in values)

    t = rng.uniform(0, 5, count) if at is None else np.full(count, at)
    position = tuple(
        Position(t + around(0.0)[0], *around(radius, 0.0, *arm))
        for radius, arm in ((2.4, (1.2, -0.7, 1.5)), (1.0, (1.57, 2.1, 2.1)))
    )
    controller = ControllerState(
        around(0.0, 0.0), around(0.0, 0.0), around(*(1.0,) * 5, width=0.9), around(*(0.0,) * 4)
    )
    return t, State(position, around(1.0, 0.0, 0.0, 1.0, 0.0, 0.0), controller)


def at_surface(shape, seed):
    """The paper's plant with another surface, and both robots at random near their desired places, q on all rows."""
    plant = Plant(surface=Surface(shape=shape))
    rng = np.random.default_rng(seed)
    q = np.array([[2.4, 0.0, 0.0, 1.35, -0.75, 1.5], [1.0, 0.0, 0.0, 1.57, 2.34, 1.6]])
    return plant, on_rows(plant, q + rng.uniform(-0.05, 0.05, (2, 6)))


def on_rows(plant, q, motion=None):
    """q (2, 6) moved onto all constraint rows, of a surface that may have moved."""
    model, position = model_of(plant), positions(q)
    for _ in range(8):
        k = kinematics(model, ALL_ROWS, position, (0.0,) * 6, motion)
        change = dependent_solution(k.reduction, k.reduction.rows.phi)
        position = tuple(map(robot_kinematics.arm_moved, position, change))
    assert np.abs(vector(kinematics(model, ALL_ROWS, position, (0.0,) * 6, motion).reduction.rows.phi)).max() < 1e-14
    return poses(tuple(map(vector, position)))


def admissible(rows, plant, q, rng):
    """Terms at a random u that satisfies J u = 0."""
    at_rest = lagrangian.coupled_terms(plant, rows, q, np.zeros(10))
    L, _ = lagrangian.velocity_basis(rows, at_rest)
    u = L @ rng.uniform(-1, 1, L.shape[1])
    return lagrangian.coupled_terms(plant, rows, q, u), u


def assert_close(actual, desired, relative):
    np.testing.assert_allclose(actual, desired, rtol=0, atol=relative * np.max(np.abs(desired)))


def positions(q):
    """Chained positions of both robots at q (2, 6), as the simulator takes them."""
    return tuple(robot_kinematics.chained(Pose(*map(float, row))) for row in q)


def poses(position):
    """q (..., 2, 6) of chained positions, by inverting (6) on arrays."""
    rows = []
    for z1, z2, z3, *joints in position:
        s, c = np.sin(z1), np.cos(z1)
        rows.append(np.stack([z2 * c - z3 * s, z2 * s + z3 * c, z1, *joints], axis=-1))
    return np.stack(rows, axis=-2)


def pair(u):
    """u (10,) as the simulator's velocity or force of both robots."""
    return tuple(map(float, u[:5])), tuple(map(float, u[5:]))


def model_of(plant):
    """The simulator's model of a plant, with an exact controller."""
    return build_model(Parameters(plant=plant, nominal=plant.inertia))


def joined(both):
    """(10,) of the simulator's pair of vectors."""
    return vector((*both[0], *both[1]))


def vector(components):
    """A flat vector of the simulator's scalars."""
    return np.array([float(x) for x in components])


def linear_map(function, size):
    """The matrix of a linear function from a tuple of ``size`` scalars to a vector, column by column."""
    return np.column_stack([function(tuple(map(float, unit))) for unit in np.eye(size)])


def rate_of_V1(structure, parameters, t, states):
    """Of (32) at states with leaves (T,): V1's rate, what decays and what couples, (T,) each, without the rest."""

    @jax.jit
    def chosen(parameters, t, states):
        terms = proof_terms.evaluate(structure, build_model(parameters), t, states)
        return terms.V1_rate, terms.decay, terms.cross

    return chosen(parameters, t, states)

"""Arms link by link against a serial chain, energies and MuJoCo; what rows ask of them."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.mechanics import robot_dynamics, robot_kinematics
from coopmm_jax.mechanics.coordinates import arm_of
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.partitioning import dependent_solution, partition
from coopmm_jax.mechanics.plant import plant_kinematics, respond
from coopmm_jax.parameters import Arm, LiftedArm, LinkInertia, Parameters, Plant, Pose, Structure
from coopmm_jax.runs.reach import missed
from coopmm_jax.scenario.scenario import load_scenario
from tests.oracles import mujoco_tree, serial_chain
from tests.samples import GRAVITY, assert_close, linear_map, random_geometry, random_inertia, vector

KINDS = [(Arm, 1), (Arm, 2), (Arm, 3), (Arm, 4), (LiftedArm, 1), (LiftedArm, 2), (LiftedArm, 3)]


def robot(kind, links, seed=0):
    """A random robot: geometry, inertia, q (x, y, th, joints), u."""
    rng = np.random.default_rng((seed, links))
    geometry = random_geometry(rng)._replace(arm=kind(tuple(rng.uniform(0.2, 0.6, links).tolist())))
    own = LinkInertia(*(tuple(rng.uniform(0.2, 2.0, links).tolist()) for _ in range(2)))
    joints = 1 + (kind is LiftedArm) + links
    return (
        geometry,
        random_inertia(rng)._replace(links=own),
        rng.uniform(-2, 2, 3 + joints),
        rng.uniform(-2, 2, 2 + joints),
    )


def position_of(q):
    x, y, th, a1, *joints = map(float, q)
    return robot_kinematics.chained(Pose(x, y, th, a1, 0.0, 0.0, arm=tuple(joints)))


def equation_of_motion(geometry, inertia, q, u):
    """M and h in u, as the simulator's inverse dynamics has them."""
    position, velocity = position_of(q), tuple(map(float, u))
    T = robot_kinematics.body_map(geometry, position)
    terms = robot_dynamics.dynamics(
        robot_dynamics.lump(geometry, inertia),
        robot_dynamics.factors(geometry, GRAVITY, robot_kinematics.posture(geometry, position), T @ velocity),
        T,
        robot_kinematics.body_map_rate(geometry, position, velocity),
    )
    at_rest = vector(robot_dynamics.inverse_dynamics(terms, (0.0,) * len(u)))
    M = linear_map(lambda a: vector(robot_dynamics.inverse_dynamics(terms, a)), len(u)) - at_rest[:, None]
    return M, at_rest


def in_chained_form(q, u, inverse):
    """M and h in u from a function of v = (V, w, rates) and v_dot."""
    lateral, forward = (np.array([[np.cos(q[2]), np.sin(q[2])], [-np.sin(q[2]), np.cos(q[2])]]) @ q[:2]).tolist()
    T = np.eye(len(u))
    T[:2, :2] = [[lateral, 1.0], [1.0, 0.0]]
    v, rest = T @ u, np.zeros(len(u))
    rest[0] = u[0] ** 2 * forward
    h = inverse(v, rest)
    M = np.column_stack([T.T @ (inverse(v, rest + T @ unit) - h) for unit in np.eye(len(u))])
    return M, T.T @ h


@pytest.mark.parametrize(("kind", "links"), KINDS)
def test_equation_of_motion_is_that_of_a_serial_chain_and_of_mujoco(kind, links):
    for seed in range(3):
        geometry, inertia, q, u = robot(kind, links, seed)
        M, h = equation_of_motion(geometry, inertia, q, u)
        chain = in_chained_form(q, u, partial(serial_chain.inverse_dynamics, geometry, inertia, GRAVITY, q[3:]))
        M_v, h_v = mujoco_tree.quasi_velocity_terms(geometry, inertia, GRAVITY, q, u_to_v(q, u))
        tree = in_chained_form(q, u, lambda v, v_dot, M_v=M_v, h_v=h_v: M_v @ v_dot + h_v)
        for (M_other, h_other), tolerance in ((chain, 4e-14), (tree, 1e-13)):
            assert_close(M, M_other, tolerance)
            assert_close(h, h_other, tolerance)
        assert_close(M, M.T, 1e-14)
        assert np.linalg.eigvalsh(M).min() > 0


def u_to_v(q, u):
    lateral = q[0] * np.cos(q[2]) + q[1] * np.sin(q[2])
    return np.array([u[1] + lateral * u[0], u[0], *u[2:]])


def test_two_links_are_links_2_and_3():
    geometry, inertia, q, u = robot(Arm, 2)
    g = geometry._replace(l2=geometry.arm.l_links[0], l3=geometry.arm.l_links[1])
    (m2, m3), (I2, I3) = inertia.links
    i = inertia._replace(m2=m2, m3=m3, I2=I2, I3=I3)
    for found, expected in zip(
        equation_of_motion(geometry, inertia, q, u),
        equation_of_motion(g._replace(arm=None), i._replace(links=None), q, u),
        strict=True,
    ):
        assert_close(found, expected, 1e-14)


@pytest.fixture(scope="module")
def lifted():
    """A lifted arm of three links: its robot, and M, C by Christoffel's symbols, G in u as functions of q and u."""
    geometry, inertia, q, u = robot(LiftedArm, 3)

    def terms(q, u):
        S = serial_chain.chained_basis(q)
        _, S_dot = jax.jvp(serial_chain.chained_basis, (q,), (S @ u,))
        M = jax.hessian(lambda q, v: serial_chain.energy(geometry, inertia, GRAVITY, q, v)[0], 1)
        slopes = jax.jacobian(lambda q: M(q, jnp.zeros_like(q)))(q)
        C = 0.5 * jnp.einsum("ijk,k->ij", slopes + slopes.transpose(0, 2, 1) - slopes.transpose(2, 1, 0), S @ u)
        G = jax.grad(lambda q: serial_chain.energy(geometry, inertia, GRAVITY, q, jnp.zeros_like(q))[1])(q)
        M = M(q, jnp.zeros_like(q))
        return S, S.T @ M @ S, S.T @ (M @ S_dot + C @ S), S.T @ G

    return (geometry, inertia, q, u), tuple(map(np.asarray, jax.jit(terms)(q, u)))


def test_energies_give_the_same_equations_and_a_skew_difference(lifted):
    (geometry, inertia, q, u), (S, M_energy, C, G) = lifted
    M, h = equation_of_motion(geometry, inertia, q, u)
    assert_close(M, M_energy, 1e-14)
    assert_close(h, C @ u + G, 1e-14)
    q_dot, step = S @ u, 1e-4
    around = [
        w * equation_of_motion(geometry, inertia, q + k * step * q_dot, u)[0]
        for k, w in ((-2, 1), (-1, -8), (1, 8), (2, -1))
    ]
    difference = sum(around) / (12 * step) - 2 * C
    assert np.abs(difference + difference.T).max() < 1e-10 * np.abs(difference).max()
    lumped = robot_dynamics.lump(geometry, inertia)
    posture = robot_kinematics.posture(geometry, position_of(q))
    assert_close(vector(robot_dynamics.gravity_force(lumped, GRAVITY, posture, geometry)), G, 1e-14)


STRUCTURE = Structure(joints=(6, 6))
STARTS = (
    Pose(2.45, 0.05, 0.0, 1.1, 0.0, 0.0, arm=(-0.6, -0.5, 1.6)),
    Pose(1.02, 0.0, 0.03, 1.5, 0.0, 0.0, arm=(0.1, 2.3, 1.7)),
)
INDEPENDENT = tuple(np.random.default_rng(3).uniform(-1, 1, 8).tolist())
TORQUE = tuple(map(tuple, np.random.default_rng(0).uniform(-5, 5, (2, 6)).tolist()))


def plant_with(x=(0.0,) * 4):
    """Three links against two on a lift, with a length or mass of either moved by x (4,)."""
    paper = Plant()
    arms = (Arm((0.25 + x[0], 0.2, 0.25)), LiftedArm((0.25, 0.25 + x[1])))
    links = (
        LinkInertia((0.5, 0.4, 0.3 + x[2]), (0.5, 0.4, 0.3)),
        LinkInertia((0.5, 0.5), (0.5 + x[3], 0.5)),
    )
    return paper._replace(
        geometry=tuple(g._replace(arm=arm) for g, arm in zip(paper.geometry, arms, strict=True)),
        inertia=tuple(i._replace(links=own) for i, own in zip(paper.inertia, links, strict=True)),
    )


def model_with(x=(0.0,) * 4):
    plant = plant_with(x)
    return build_model(Parameters(plant=plant, nominal=plant.inertia, start=STARTS, disturbance=()))


@jax.jit
def state_of(position):
    """Rows, velocities and Jdot u, as all the rows' motion has them."""
    k = plant_kinematics(STRUCTURE, model_with(), 0.0, position, INDEPENDENT)
    J = [jnp.array([jnp.stack([x + jnp.zeros(()) for x in row]) for row in each.rows]) for each in k.reduction.rows.J]
    phi = k.reduction.rows.phi
    moved = tuple(map(robot_kinematics.arm_moved, position, dependent_solution(k.reduction, phi)))
    rates = tuple(map(robot_kinematics.position_rates, position, k.velocity))
    return {"phi": phi, "moved": moved, "J": J, "velocity": k.velocity, "L_rate": k.L_rate, "rates": rates}


@jax.jit
def response(x, position):
    """Accelerations and forces on the joints of both robots under TORQUE, and the multipliers."""
    model = model_with(x)
    k = plant_kinematics(STRUCTURE, model, 0.0, position, INDEPENDENT)
    force = tuple(map(robot_kinematics.actuator_force, model.geometry, position, TORQUE))
    moved = respond(STRUCTURE, model, 0.0, k, force)
    return moved.full, force, moved.multipliers


@pytest.fixture(scope="module")
def on_rows():
    """Positions on all rows, and their ``state_of``."""
    position = jax.tree.map(jnp.asarray, tuple(map(robot_kinematics.chained, STARTS)))
    for _ in range(12):
        position = state_of(position)["moved"]
    state = state_of(position)
    assert np.abs(vector(state["phi"])).max() < 1e-13
    return position, state


def test_power_balance_of_two_arms(on_rows):
    """Energy changes by what the actuators do: neither rolling nor a constraint row does any work."""
    position, state = on_rows
    full, force, _ = response(np.zeros(4), position)
    plant, gained, power = plant_with(), 0.0, 0.0

    def rate(i, q, u, u_dot):
        def total(q, u):
            return sum(
                serial_chain.energy(plant.geometry[i], plant.inertia[i], GRAVITY, q, serial_chain.chained_basis(q) @ u)
            )

        return jax.jvp(total, (q, u), (serial_chain.chained_basis(q) @ u, u_dot))[1]

    for i in range(2):
        u, q = vector(state["velocity"][i]), vector(robot_kinematics.unchained(position[i]))
        gained += float(jax.jit(partial(rate, i))(q, u, vector(full[i])))
        power += float(u @ vector(force[i]))
    assert gained == pytest.approx(power, rel=5e-15)
    speeds = sum(np.asarray(J) @ vector(u) for J, u in zip(state["J"], state["velocity"], strict=True))
    assert np.abs(speeds).max() < 1e-13


OFFSETS, WEIGHTS = np.array([-2, -1, 1, 2]), np.array([1, -8, 8, -1]) / 12.0


def test_bias_of_the_rows_is_their_acceleration(on_rows):
    """Jdot u by differences of J along the motion, of links and of a lift."""
    position, state = on_rows

    def moved(h):
        at = tuple(
            type(p)(*(x + h * v for x, v in zip(p, r, strict=True)))
            for p, r in zip(position, state["rates"], strict=True)
        )
        return sum(np.asarray(J) @ vector(u) for J, u in zip(state_of(at)["J"], state["velocity"], strict=True))

    h = 1e-4
    expected = sum(w * moved(j * h) for j, w in zip(OFFSETS, WEIGHTS, strict=True)) / h
    found = sum(np.asarray(J) @ vector(x) for J, x in zip(state["J"], state["L_rate"], strict=True))
    np.testing.assert_allclose(-found, expected, atol=5e-11 * np.abs(expected).max())


def test_slopes_by_lengths_and_masses_are_those_of_differences(on_rows):
    """Of accelerations and multipliers, by numbers of single links of either arm; errors seen: 4e-10."""
    position, _ = on_rows

    def cost(x):
        full, _, multipliers = response(x, position)
        return sum(map(sum, full)) + sum(multipliers)

    step = 1e-3
    both = jax.jit(jax.value_and_grad(cost))
    slopes = np.asarray(both(np.zeros(4))[1])
    differences = [WEIGHTS @ [float(both(j * step * unit)[0]) for j in OFFSETS] / step for unit in np.eye(4)]
    assert np.all(slopes != 0)
    np.testing.assert_allclose(slopes, differences, rtol=0, atol=4e-9 * np.abs(slopes).max())


def test_rows_take_the_last_joints():
    assert partition(Structure().rows, (6, 6)).dependent == ((4, 5), (4, 5))
    assert partition(("contact_normal",), (4, 7)).independent == ((0, 1, 2), (0, 1, 2, 3, 4, 5, 6))


@pytest.mark.parametrize(("kind", "links"), KINDS[1:])
def test_desired_joints_put_the_tip_where_it_is_wanted(kind, links):
    geometry, _, q, _ = robot(kind, links)
    near = tuple(map(float, q[4:]))
    arm = robot_kinematics.posture(geometry, position_of(q))
    lift = 0.1 if kind is LiftedArm and links == 1 else 0.0  # reaches any height
    joints = robot_kinematics.arm_joints(geometry, arm.reach, arm.height - 2.0 * geometry.l1 + lift, near)
    at = robot_kinematics.posture(geometry, position_of([*q[:4], *map(float, joints)]))
    assert (float(at.reach), float(at.height)) == pytest.approx((float(arm.reach), float(arm.height) + lift), abs=1e-12)
    assert joints[: len(near) - 2] == pytest.approx(near[:-2])
    assert arm_of(position_of(q))[1:] == near


def test_start_that_no_arm_reaches_names_robot_and_distance():
    """Along the arm's own direction the tip has to come 2.3 m, and an arm of 1 m misses by 1.3 m."""
    far = load_scenario("paper", initial={"x": [2.5, 4.0], "a1": [0.5253, math.pi / 2]})
    found = missed(far.structure(), far.parameters())
    assert found["II"] == pytest.approx(4.0 - 1.7 - 1.0, abs=1e-4)
    assert missed(Structure(), load_scenario("paper").parameters()) == {}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [({}, math.hypot(0.2, 0.7)), ({"coupling.surface.kind": "arc", "reference.path.kind": "circle"}, 0.2 + 0.7)],
    ids=["to an end of the arc", "along arm II to a level surface"],
)
def test_far_half_of_the_circle_is_not_the_surface(changes, expected):
    """Arm I, stretched, ends 0.2 m short of the centre of the arc, whose far half it could reach."""
    start = {"initial": {"x": [3.6, 1.2], "a1": [math.pi / 2, math.pi / 2]}}
    scenario = load_scenario("paper", **start).with_overrides(changes)
    assert missed(scenario.structure(), scenario.parameters())["I"] == pytest.approx(expected, abs=1e-4)

"""A platform on two axles from energies and, a second time, from MuJoCo's tree, projected onto rolling.

Coordinates q are (x, y, th, phi, a1, a2, a3): ``lagrangian``'s, with the front axle's angle phi against the platform.
Rolling without side slip leaves v = (V, phidot, a1dot, a2dot, a3dot), from which u follows by differentiating the
chained coordinates: nothing here knows a turning radius.
"""

from __future__ import annotations

from functools import partial, wraps

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from coopmm_jax.parameters import Car, Geometry, Inertia, Trailer
from tests.oracles import lagrangian, mujoco_tree

REST = np.array([0, 1, 2, 4, 5, 6])  # of q, as ``lagrangian`` takes it


def of_either(function):
    """``function`` of a geometry and more, compiled once for trailers and cars: they move alike, driven elsewhere."""
    compiled = jax.jit(function)

    @wraps(function)
    def called(geometry, *rest):
        return compiled(geometry._replace(front=Trailer(*geometry.front)), *rest)

    return called


def forward(angle):
    return jnp.stack([-jnp.sin(angle), jnp.cos(angle)])


def kinetic_energy(geometry: Geometry, inertia: Inertia, q, q_dot):
    """T [J] at q, q_dot (7,)."""
    front, own = geometry.front, inertia.front

    def places(q):
        axle = q[:2] + front.wheelbase * forward(q[2])
        return axle, axle + front.d_f * forward(q[2] + q[3])

    _, (axle, centre) = jax.jvp(places, (q,), (q_dot,))
    turn = q_dot[2] + q_dot[3]
    rolling = axle @ forward(q[2] + q[3])
    wheels = jnp.stack([rolling + front.l_f * turn, rolling - front.l_f * turn]) / front.r_f
    ahead = own.m_f * centre @ centre + own.I_f * turn**2 + own.I_wf * wheels @ wheels
    return lagrangian.kinetic_energy(geometry, inertia, q[REST], q_dot[REST]) + 0.5 * ahead


@of_either
def chained(geometry: Geometry, q):
    """(z1, ..., z4) (4,), lengths in the platform's unit; about the origin in the chart that is polar."""
    if geometry.front.chart is not None:
        bearing, r = jnp.arctan2(q[1], q[0]), jnp.hypot(q[0], q[1])
        off = q[2] - bearing
        z4 = (1 - r * jnp.tan(q[3]) / geometry.front.wheelbase / jnp.cos(off)) / jnp.cos(off) ** 2
        return jnp.stack([bearing, jnp.log(r), -jnp.tan(off), z4])
    z1, z2, z3 = lagrangian.chained_position(q[REST])
    lengths = jnp.stack([z2, z3, geometry.front.wheelbase / jnp.tan(q[3]) - z2])
    return jnp.concatenate([z1[None], lengths / geometry.front.unit])


def rolling_basis(geometry: Geometry, q):
    """R (7, 5): q_dot = R v."""
    R = jnp.zeros((7, 5)).at[:2, 0].set(forward(q[2])).at[2, 0].set(jnp.tan(q[3]) / geometry.front.wheelbase)
    return R.at[jnp.arange(3, 7), jnp.arange(1, 5)].set(1.0)


@of_either
def chained_basis(geometry: Geometry, q):
    """S (7, 5): q_dot = S u with u = (z1dot, z4dot, a1dot, a2dot, a3dot)."""
    R = rolling_basis(geometry, q)
    u_of_v = jnp.concatenate([(jax.jacobian(partial(chained, geometry))(q) @ R)[jnp.array([0, 3])], R[4:]])
    return R @ jnp.linalg.inv(u_of_v)


@of_either
def chained_terms(geometry: Geometry, inertia: Inertia, gravity, q, u):
    """M_u, C_u (5, 5) with Christoffel's symbols in q, and G_u (5,)."""
    S = chained_basis(geometry, q)
    q_dot = S @ u
    _, S_dot = jax.jvp(partial(chained_basis, geometry), (q,), (q_dot,))

    def inertia_matrix(q):
        return jax.hessian(partial(kinetic_energy, geometry, inertia, q))(jnp.zeros(7))

    M, slopes = inertia_matrix(q), jax.jacobian(inertia_matrix)(q)
    C = 0.5 * jnp.einsum("ijk,k->ij", slopes + slopes.transpose(0, 2, 1) - slopes.transpose(2, 1, 0), q_dot)
    G = jax.grad(lambda q: lagrangian.potential_energy(geometry, inertia, gravity, q[REST]))(q)
    return S.T @ M @ S, S.T @ (M @ S_dot + C @ S), S.T @ G


@of_either
def energy(geometry: Geometry, inertia: Inertia, gravity, q, u):
    """T + U [J] at q (7,), u (5,)."""
    kinetic = kinetic_energy(geometry, inertia, q, chained_basis(geometry, q) @ u)
    return kinetic + lagrangian.potential_energy(geometry, inertia, gravity, q[REST])


@jax.jit
def input_matrix(geometry: Geometry, q):
    """B (5, 5) by virtual work: u^T B tau is the power of tau."""
    front = geometry.front

    def actuator_rates(u):
        q_dot = chained_basis(geometry, q) @ u
        if isinstance(front, Car):
            return jnp.concatenate([(q_dot[:2] @ forward(q[2]) / geometry.r)[None], q_dot[3:]])
        _, axle = jax.jvp(lambda q: q[:2] + front.wheelbase * forward(q[2]), (q,), (q_dot,))
        rolling, turning = axle @ forward(q[2] + q[3]), front.l_f * (q_dot[2] + q_dot[3])
        return jnp.concatenate([jnp.stack([rolling + turning, rolling - turning]) / front.r_f, q_dot[4:]])

    return jax.jacobian(actuator_rates)(jnp.zeros(5)).T


# The tree's joints: x, y, th, both rear wheels, the arm's three, then phi and both front wheels.
_ORDER, _OWN = np.array([0, 1, 2, 5, 6, 7, 8]), np.array([0, 1, 2, 4, 5, 6, 3])


def _tree_basis(geometry: Geometry, q):
    """S (11, 5) of the velocities of the tree's joints."""
    front = geometry.front
    S = chained_basis(geometry, q)
    _, axle = jax.vmap(lambda v: jax.jvp(lambda q: q[:2] + front.wheelbase * forward(q[2]), (q,), (v,)), 1)(S)
    rear, rolling = S[:2].T @ forward(q[2]), axle @ forward(q[2] + q[3])
    spin = [(rear + s * geometry.l * S[2]) / geometry.r for s in (1, -1)]
    spin += [(rolling + s * front.l_f * (S[2] + S[3])) / front.r_f for s in (1, -1)]
    tree = jnp.zeros((11, 5)).at[_ORDER].set(S[_OWN])
    return tree.at[jnp.array([3, 4, 9, 10])].set(jnp.stack(spin))


@of_either
def _tree_motion(geometry: Geometry, q, u):
    """S and Sdot u of the tree."""
    S, S_dot = jax.jvp(partial(_tree_basis, geometry), (q,), (chained_basis(geometry, q) @ u,))
    return S, S_dot @ u


def mujoco_terms(geometry: Geometry, inertia: Inertia, gravity: float, q, u):
    """M_u (5, 5) and h_u (5,) of MuJoCo's tree, gravity in h_u."""
    front, own = geometry.front, inertia.front
    spec, platform = mujoco_tree.build_tree(geometry, inertia, gravity)
    ahead = platform.add_body(
        pos=front.wheelbase * mujoco_tree.FORWARD,
        mass=own.m_f,
        inertia=[own.I_f] * 3,
        ipos=front.d_f * mujoco_tree.FORWARD,
        explicitinertial=True,
    )
    ahead.add_joint(type=mujoco_tree.HINGE, axis=mujoco_tree.UP)
    for side in (1, -1):
        mujoco_tree.add_wheel(ahead, side * front.l_f, own.I_wf)
    model = spec.compile()
    S, S_dot_u = map(np.asarray, _tree_motion(geometry, q, u))
    data = mujoco.MjData(model)
    data.qpos[_ORDER] = np.asarray(q)[_OWN]
    data.qvel[:] = S @ u
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return S.T @ M @ S, S.T @ (M @ S_dot_u + data.qfrc_bias)

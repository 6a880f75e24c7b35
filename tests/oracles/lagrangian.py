"""Euler-Lagrange equations with multipliers, by differentiating energies written from body positions.

One robot: T(q, qdot) and U(q) in the full coordinates q = (x, y, th, a1, a2, a3) give M(q) qddot + h(q, qdot), and a
basis S(q) of the admissible velocities, qdot = S w, projects them: S^T M S wdot + S^T (M Sdot w + h). The basis is
R(q) of (3) for the quasi-velocities v = (V, w, a1dot, a2dot, a3dot), or R T for the chained form's
u = (u1, u2, a1dot, a2dot, a3dot). S^T removes the side-slip multiplier, because the constraint annihilates S.

Two robots: the rows phi(q1, q2) = 0 keep their multipliers. u (10) is robot I's u followed by robot II's.

>>> import numpy as np
>>> from coopmm_jax.parameters import Geometry, Inertia
>>> q, v = np.array([2.4, 0.0, 0.0, 1.57, -0.8, 1.6]), np.ones(5)
>>> M, h = quasi_velocity_terms(Geometry(), Inertia(), 9.81, q, v)
>>> M.shape, h.shape
((5, 5), (5,))
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.mechanics.surfaces import Shape
from coopmm_jax.parameters import ALL_ROWS, Geometry, Inertia, Plant, Surface

Terms = tuple[np.ndarray, np.ndarray]  # a matrix and the vector that goes with it


def _turned(angle: Scalar) -> jax.Array:
    """The forward axis (-sin, cos) of a body turned by angle from th = 0, in space (3,)."""
    return jnp.stack([-jnp.sin(angle), jnp.cos(angle), jnp.zeros_like(angle)])


def _pitched(heading: jax.Array, angle: Scalar) -> jax.Array:
    return heading * jnp.cos(angle) + jnp.array([0.0, 0.0, 1.0]) * jnp.sin(angle)


class Bodies(NamedTuple):
    """Positions of the mass centres and of the tip [m], and the rods' unit directions; each (3,)."""

    platform: jax.Array
    column: jax.Array
    link2: jax.Array
    link3: jax.Array
    tip: jax.Array
    rod2: jax.Array
    rod3: jax.Array


def bodies(geometry: Geometry, q: jax.Array) -> Bodies:
    """Places of all bodies of one robot at q (6,)."""
    x, y, th, a1, a2, a3 = q
    up = jnp.array([0.0, 0.0, 1.0])
    axle = jnp.stack([x, y, jnp.zeros_like(x)])
    mount = axle + geometry.mount_offset * _turned(th)
    rod2, rod3 = _pitched(_turned(th + a1), a2), _pitched(_turned(th + a1), a2 + a3)
    elbow = mount + 2 * geometry.l1 * up + 2 * geometry.l2 * rod2
    return Bodies(
        platform=axle + geometry.d * _turned(th),
        column=mount + geometry.l1 * up,
        link2=mount + 2 * geometry.l1 * up + geometry.l2 * rod2,
        link3=elbow + geometry.l3 * rod3,
        tip=elbow + 2 * geometry.l3 * rod3,
        rod2=rod2,
        rod3=rod3,
    )


def wheel_rates(geometry: Geometry, forward_speed: Scalar, yaw_rate: Scalar) -> jax.Array:
    """Rolling rates (right, left) of the wheels [rad/s]."""
    turn = geometry.l * yaw_rate
    return jnp.stack([forward_speed + turn, forward_speed - turn]) / geometry.r


def kinetic_energy(geometry: Geometry, inertia: Inertia, q: jax.Array, q_dot: jax.Array) -> jax.Array:
    """T [J] in the full coordinates; q, q_dot (6,).

    The wheels' rates stand for V, the forward part of the axle's velocity. The terms that this substitution adds to
    the Euler-Lagrange equations vanish where there is no side slip, which is where they are used.
    """
    _, rate = jax.jvp(lambda q: bodies(geometry, q), (q,), (q_dot,))
    yaw_rate, column_rate = q_dot[2], q_dot[2] + q_dot[3]
    wheels = wheel_rates(geometry, q_dot[:2] @ _turned(q[2])[:2], yaw_rate)
    twice = (
        inertia.m_p * rate.platform @ rate.platform
        + inertia.m1 * rate.column @ rate.column
        + inertia.m2 * rate.link2 @ rate.link2
        + inertia.m3 * rate.link3 @ rate.link3
        + inertia.m_obj * rate.tip @ rate.tip
        + inertia.I_w * wheels @ wheels
        + inertia.I_p * yaw_rate**2
        + inertia.I1 * column_rate**2
        # A slender rod's angular velocity across itself is that of its direction.
        + inertia.I2 * rate.rod2 @ rate.rod2
        + inertia.I3 * rate.rod3 @ rate.rod3
    )
    return twice / 2


def potential_energy(geometry: Geometry, inertia: Inertia, gravity: Scalar, q: jax.Array) -> jax.Array:
    """U [J] of the rods and the object; platform and column keep their height."""
    at = bodies(geometry, q)
    return gravity * (inertia.m2 * at.link2[2] + inertia.m3 * at.link3[2] + inertia.m_obj * at.tip[2])


@jax.jit
def full_terms(
    geometry: Geometry, inertia: Inertia, gravity: Scalar, q: jax.Array, q_dot: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """M (6, 6) and h (6,) of M qddot + h = generalised forces in the full coordinates."""
    T = partial(kinetic_energy, geometry, inertia)
    M = jax.hessian(T, argnums=1)(q, q_dot)
    _, momentum_rate = jax.jvp(lambda q: jax.grad(T, argnums=1)(q, q_dot), (q,), (q_dot,))
    return M, momentum_rate - jax.grad(T)(q, q_dot) + jax.grad(partial(potential_energy, geometry, inertia, gravity))(q)


def rolling_basis(q: jax.Array) -> jax.Array:
    """R(q) (6, 5) of (3): qdot = R v without side slip."""
    R = jnp.zeros((6, 5)).at[:2, 0].set(_turned(q[2])[:2])
    return R.at[jnp.arange(2, 6), jnp.arange(1, 5)].set(1.0)


def chained_position(q: jax.Array) -> jax.Array:
    """(z1, z2, z3) of (6)-(8)."""
    x, y, th = q[:3]
    return jnp.stack([th, x * jnp.cos(th) + y * jnp.sin(th), -x * jnp.sin(th) + y * jnp.cos(th)])


def chained_velocity_map(q: jax.Array) -> jax.Array:
    """T(q) (5, 5): v = T u, from w = u1 and V = u2 + z2 u1."""
    z2 = chained_position(q)[1]
    return jnp.eye(5).at[0, 0].set(z2).at[0, 1].set(1.0).at[1, 0].set(1.0).at[1, 1].set(0.0)


@jax.jit
def chained_basis(q: jax.Array) -> jax.Array:
    """R(q) T(q) (6, 5): qdot = R T u."""
    return rolling_basis(q) @ chained_velocity_map(q)


@partial(jax.jit, static_argnums=0)
def _admissible_motion(basis: Callable, q: jax.Array, w: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """S, qdot = S w and Sdot w."""
    S = basis(q)
    _, S_dot_w = jax.jvp(lambda q: basis(q) @ w, (q,), (S @ w,))
    return S, S @ w, S_dot_w


def _projected(
    basis: Callable, geometry: Geometry, inertia: Inertia, gravity: Scalar, q: np.ndarray, w: np.ndarray
) -> Terms:
    S, q_dot, S_dot_w = map(np.asarray, _admissible_motion(basis, q, w))
    M, h = map(np.asarray, full_terms(geometry, inertia, gravity, q, q_dot))
    return S.T @ M @ S, S.T @ (M @ S_dot_w + h)


def quasi_velocity_terms(geometry: Geometry, inertia: Inertia, gravity: Scalar, q: np.ndarray, v: np.ndarray) -> Terms:
    """M_v (5, 5) and h_v (5,) at q (6,), v (5,): M_v vdot + h_v = R^T (forces), gravity in h_v."""
    return _projected(rolling_basis, geometry, inertia, gravity, q, v)


def chained_terms(geometry: Geometry, inertia: Inertia, gravity: Scalar, q: np.ndarray, u: np.ndarray) -> Terms:
    """M_u (5, 5) and h_u (5,) at q (6,), u (5,): M_u udot + h_u = T^T R^T (forces), gravity and M Tdot u in h_u."""
    return _projected(chained_basis, geometry, inertia, gravity, q, u)


@jax.jit
def energy(geometry: Geometry, inertia: Inertia, gravity: Scalar, q: jax.Array, u: jax.Array) -> jax.Array:
    """T + U [J] of one robot at q (6,), u (5,)."""
    return kinetic_energy(geometry, inertia, q, chained_basis(q) @ u) + potential_energy(geometry, inertia, gravity, q)


@jax.jit
def input_matrix(geometry: Geometry, q: jax.Array) -> jax.Array:
    """B (5, 5) by virtual work: u^T B tau is the power of tau (right wheel, left wheel, joints 1, 2, 3)."""

    def actuator_rates(u: jax.Array) -> jax.Array:
        v = chained_velocity_map(q) @ u
        return jnp.concatenate([wheel_rates(geometry, v[0], v[1]), v[2:]])

    return jax.jacobian(actuator_rates)(jnp.zeros(5)).T


def all_constraints(plant: Plant, q: jax.Array) -> jax.Array:
    """phi (4,) of model.md section 2, in the order of ALL_ROWS, at q (2, 6) [m]."""
    p1, p2 = (bodies(geometry, q_i).tip for geometry, q_i in zip(plant.geometry, q, strict=True))
    guide_radius, guide_height = plant.surface.guide_radius, plant.surface.guide_height
    phi = {
        "contact_normal": normal_residual(plant.surface, p1[:2] - p2[:2], q[1, 2] + q[1, 3]),
        "contact_height": p1[2] - p2[2],
        "guide_radial": (p2[:2] @ p2[:2] - guide_radius**2) / (2 * guide_radius),
        "guide_height": p2[2] - guide_height,
    }
    return jnp.stack([phi[row] for row in ALL_ROWS])


def normal_residual(surface: Surface, between: jax.Array, yaw: Scalar) -> jax.Array:
    """phi [m] of the contact's normal row: the arc's as in model.md, else F/|grad F|.

    Args:
        surface: of the object.
        between: tip I less tip II in the world (2,) [m].
        yaw: direction of arm II in the world [rad].
    """
    if surface.shape is None:
        Rc, from_centre = surface.contact_radius, between + surface.contact_radius * _turned(yaw)[:2]
        return (Rc**2 - from_centre @ from_centre) / (2 * Rc)
    value, gradient = jax.value_and_grad(partial(level, surface.shape))(between, yaw)
    return value / jnp.linalg.norm(gradient)


def level(shape: Shape, between: jax.Array, yaw: Scalar) -> jax.Array:
    """F [m] of a surface whose frame is turned to ``yaw``, arguments as ``normal_residual``."""
    e = _turned(yaw)[:2]
    return shape.level(between @ e, between @ jnp.stack([-e[1], e[0]]))


@jax.jit
def _all_constraint_terms(plant: Plant, q: jax.Array, u: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    def q_dot(q: jax.Array, u: jax.Array) -> jax.Array:
        return jax.vmap(lambda q_i, u_i: chained_basis(q_i) @ u_i)(q, u.reshape(2, 5))

    def phi_dot(q: jax.Array, u: jax.Array) -> jax.Array:
        return jax.jvp(partial(all_constraints, plant), (q,), (q_dot(q, u),))[1]

    _, J_dot_u = jax.jvp(lambda q: phi_dot(q, u), (q,), (q_dot(q, u),))
    return all_constraints(plant, q), jax.jacobian(phi_dot, argnums=1)(q, u), J_dot_u


def constraint_terms(
    plant: Plant, rows: tuple[str, ...], q: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """phi (m,) [m], J (m, 10) and Jdot u (m,) of the named rows at q (2, 6), u (10,).

    phidot = J u and phiddot = J udot + Jdot u.
    """
    chosen = [ALL_ROWS.index(row) for row in rows]
    phi, J, J_dot_u = (np.asarray(term)[chosen] for term in _all_constraint_terms(plant, q, u))
    return phi, J, J_dot_u


class CoupledTerms(NamedTuple):
    """M udot + h = f + J^T lambda and J udot + Jdot u = 0, where f = B tau - d; all in u (10)."""

    M: np.ndarray  # (10, 10)
    h: np.ndarray  # (10,), with gravity
    B: np.ndarray  # (10, 10)
    J: np.ndarray  # (m, 10)
    J_dot_u: np.ndarray  # (m,)


def coupled_terms(plant: Plant, rows: tuple[str, ...], q: np.ndarray, u: np.ndarray) -> CoupledTerms:
    """The two robots and their constraint rows at q (2, 6), u (10,)."""
    M, h, B = np.zeros((10, 10)), np.zeros(10), np.zeros((10, 10))
    for i, (geometry, inertia) in enumerate(zip(plant.geometry, plant.inertia, strict=True)):
        own = slice(5 * i, 5 * i + 5)
        M[own, own], h[own] = chained_terms(geometry, inertia, plant.gravity, q[i], u[own])
        B[own, own] = input_matrix(geometry, q[i])
    _, J, J_dot_u = constraint_terms(plant, rows, q, u)
    return CoupledTerms(M, h, B, J, J_dot_u)


def multiplier_solution(terms: CoupledTerms, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """udot (10,) and lambda (m,) under the generalised force f = B tau - d (10,)."""
    m = len(terms.J)
    kkt = np.block([[terms.M, -terms.J.T], [terms.J, np.zeros((m, m))]])
    solution = np.linalg.solve(kkt, np.concatenate([force - terms.h, -terms.J_dot_u]))
    return solution[:10], solution[10:]


def dependent_joints(rows: tuple[str, ...]) -> list[int]:
    """Entries of u (10) that the rows determine: the last joints of robot I by contact rows, of II by guide rows."""
    contact = sum(row.startswith("contact") for row in rows)
    guide = len(rows) - contact
    return [3, 4][2 - contact :] + [8, 9][2 - guide :]


def velocity_basis(rows: tuple[str, ...], terms: CoupledTerms) -> tuple[np.ndarray, np.ndarray]:
    """L (10, n) of (10), u = L u^1, and Ldot u^1 (10,), from J L = 0 and its derivative.

    u^1 keeps u's order: (u1, u2, a1dot) of I, then of II, with the joints that fewer rows set free after their a1dot.
    Ldot u^1 holds at the u of the terms, which must satisfy J u = 0.
    """
    dependent = dependent_joints(rows)
    independent = [i for i in range(10) if i not in dependent]
    L, L_dot_u1 = np.zeros((10, len(independent))), np.zeros(10)
    L[independent] = np.eye(len(independent))
    L[dependent] = -np.linalg.solve(terms.J[:, dependent], terms.J[:, independent])
    L_dot_u1[dependent] = -np.linalg.solve(terms.J[:, dependent], terms.J_dot_u)
    return L, L_dot_u1


def reduced_terms(rows: tuple[str, ...], terms: CoupledTerms) -> tuple[np.ndarray, np.ndarray]:
    """M_r (n, n) and the bias (n,) of (11): M_r u1dot + bias = L^T (B tau - d)."""
    L, L_dot_u1 = velocity_basis(rows, terms)
    return L.T @ terms.M @ L, L.T @ (terms.M @ L_dot_u1 + terms.h)

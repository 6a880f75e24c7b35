"""What couples the robots: the map L of (10), reduced dynamics (11), multipliers.

Each constraint row makes one joint dependent: contact rows (a2, a3) of robot I (a3 alone when only the normal row is
left: at the nominal posture sin A + sin B = 0, so a2 does not move the normal row there), guide rows (a2, a3) of robot
II. J is block triangular over the dependent joints because the guide does not see robot I,

    J_dep = [[N1, N2], [0, G2]],

so every solve with it is two solves of size two at most. L is not block diagonal, unlike below (10): robot I's
dependent joints move when the object does.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax import robot
from coopmm_jax.components import (
    Matrix,
    Scalar,
    Vector,
    cholesky_solve,
    congruence,
    dot,
    inverse_small,
    minus,
    plus,
    scaled,
    sub,
)
from coopmm_jax.constraints import JOINTS, Bodies, Rows, SurfaceMotion, bodies, constraint_rows, convective
from coopmm_jax.model import Model


class Partition(NamedTuple):
    """Which of (u1, u2, a1dot, a2dot, a3dot) of each robot are independent and which follow from the rows."""

    independent: tuple[tuple[int, ...], tuple[int, ...]]
    dependent: tuple[tuple[int, ...], tuple[int, ...]]


def partition(rows: tuple[str, ...]) -> Partition:
    """The split of (10) for a set of rows; static.

    >>> partition(("contact_normal",)).dependent
    ((4,), ())
    """
    dependent = (
        (3, 4) if "contact_height" in rows else (4,),
        (3, 4) if "guide_radial" in rows else (),
    )
    independent = tuple(tuple(j for j in range(JOINTS) if j not in taken) for taken in dependent)
    return Partition(independent, dependent)


class Reduction(NamedTuple):
    """The constraint solved for the dependent joints, (10)."""

    L: tuple[Matrix, Matrix]  # u of each robot (5,) from the independent velocities (n,)
    part: Partition
    rows: Rows
    N1_inverse: Matrix
    N2: Matrix | None
    G2_inverse: Matrix | None
    determinants: tuple[Scalar, ...]  # of N1 and G2: an arm is singular where one vanishes


def _columns(matrix: Matrix, rows: slice, columns: tuple[int, ...]) -> Matrix:
    return Matrix([[row[j] for j in columns] for row in matrix.rows[rows]])


def reduce(rows: Rows, names: tuple[str, ...]) -> Reduction:
    """Solve J u = 0 for the dependent joints: L of (10) and what the solves below need."""
    part = partition(names)
    contact, guide = slice(0, rows.contacts), slice(rows.contacts, None)
    J1, J2 = rows.J
    N1_inverse, N1_determinant = inverse_small(_columns(J1, contact, part.dependent[0]))
    n1, n2 = len(part.independent[0]), len(part.independent[1])
    at_contact2 = _columns(J2, contact, part.independent[1])
    D2, N2, G2_inverse, determinants = None, None, None, (N1_determinant,)
    if part.dependent[1]:
        G2_inverse, G2_determinant = inverse_small(_columns(J2, guide, part.dependent[1]))
        D2 = _negated(G2_inverse @ _columns(J2, guide, part.independent[1]))
        N2 = _columns(J2, contact, part.dependent[1])
        at_contact2 = at_contact2 + N2 @ D2
        determinants = (N1_determinant, G2_determinant)
    at_contact1 = _columns(J1, contact, part.independent[0])
    both = Matrix([a + b for a, b in zip(at_contact1.rows, at_contact2.rows, strict=True)])
    D1 = _negated(N1_inverse @ both)
    L1 = _assemble(D1, part.independent[0], part.dependent[0], 0, n1 + n2)
    D2_wide = Matrix([(0,) * n1 + row for row in D2.rows]) if D2 is not None else None
    L2 = _assemble(D2_wide, part.independent[1], part.dependent[1], n1, n1 + n2)
    return Reduction((L1, L2), part, rows, N1_inverse, N2, G2_inverse, determinants)


def _negated(matrix: Matrix) -> Matrix:
    return Matrix([[sub(0, x) for x in row] for row in matrix.rows])


def _assemble(D: Matrix | None, independent: tuple, dependent: tuple, offset: int, width: int) -> Matrix:
    """Rows of L of one robot: unit rows for its independent velocities, rows of D for the dependent ones."""
    L = [(0,) * width] * JOINTS
    for k, joint in enumerate(independent):
        L[joint] = tuple(int(column == offset + k) for column in range(width))
    for k, joint in enumerate(dependent):
        L[joint] = D.rows[k]
    return Matrix(L)


def dependent_solution(reduction: Reduction, right: Vector) -> tuple[Vector, Vector]:
    """The dependent joints x with J_dep x = -right, as vectors (5,) of each robot, zero elsewhere.

    With right = Jdot u it is Ldot u^1; with right = phi it is the joint correction that removes the drift.
    """
    part, contacts = reduction.part, reduction.rows.contacts
    full = [[0] * JOINTS, [0] * JOINTS]
    at_contact = right[:contacts]
    if part.dependent[1]:
        x2 = tuple(sub(0, x) for x in reduction.G2_inverse @ right[contacts:])
        at_contact = plus(at_contact, reduction.N2 @ x2)
        for joint, value in zip(part.dependent[1], x2, strict=True):
            full[1][joint] = value
    x1 = reduction.N1_inverse @ at_contact
    for joint, value in zip(part.dependent[0], x1, strict=True):
        full[0][joint] = sub(0, value)
    return tuple(full[0]), tuple(full[1])


def expand(reduction: Reduction, independent: Vector) -> tuple[Vector, Vector]:
    """u of each robot (5,) from the independent velocities (n,): u = L u^1 of (10)."""
    return reduction.L[0] @ independent, reduction.L[1] @ independent


def restrict(reduction: Reduction, force: tuple[Vector, Vector]) -> Vector:
    """L^T F (n,): a generalised force on all joints as seen by the independent velocities."""
    return plus(*(L.T @ f for L, f in zip(reduction.L, force, strict=True)))


def spread(reduction: Reduction, force: Vector) -> tuple[Vector, Vector]:
    """L (L^T L)^-1 F: the least force on all joints that L^T takes back to F (substitution after (40)).

    L = [I; D] up to order, so (I + D^T D)^-1 = I - D^T (I + D D^T)^-1 D needs a solve with one unknown per row only.
    """
    D = Matrix(
        [L.rows[joint] for L, joints in zip(reduction.L, reduction.part.dependent, strict=True) for joint in joints]
    )
    size = len(D.rows)
    gram = Matrix([[dot(D.rows[i], D.rows[j]) for j in range(size)] for i in range(size)])
    gram = gram + Matrix([[1.0 if i == j else 0 for j in range(size)] for i in range(size)])
    (y,) = cholesky_solve(gram, D @ force)
    return expand(reduction, minus(force, D.T @ y))


def multipliers(reduction: Reduction, residual: tuple[Vector, Vector]) -> Vector:
    """lambda (m,) [N] with J^T lambda = residual, from the dependent joints' rows alone.

    The same as (J J^T)^-1 J residual, since a residual of the constrained dynamics lies in the range of J^T.
    """
    part = reduction.part
    at1 = tuple(residual[0][joint] for joint in part.dependent[0])
    contact = reduction.N1_inverse.T @ at1
    if not part.dependent[1]:
        return contact
    at2 = tuple(residual[1][joint] for joint in part.dependent[1])
    return contact + reduction.G2_inverse.T @ minus(at2, reduction.N2.T @ contact)


def constraint_force(reduction: Reduction, lam: Vector) -> tuple[Vector, Vector]:
    """J^T lambda on each robot (5,)."""
    return tuple(J.T @ lam for J in reduction.rows.J)


class Kinematics(NamedTuple):
    """The constrained motion at one state: everything (10) says."""

    bodies: Bodies
    reduction: Reduction
    velocity: tuple[Vector, Vector]  # u = L u^1 of each robot (5,)
    L_rate: tuple[Vector, Vector]  # Ldot u^1 of each robot (5,)


def kinematics(
    model: Model,
    rows: tuple[str, ...],
    position: tuple[robot.Position, robot.Position],
    independent: Vector,
    motion: SurfaceMotion | None = None,
) -> Kinematics:
    """(10) at one state: ``independent`` is u^1 (n,).

    Args:
        motion: of the object's surface. It adds to what (10) says: u = L u^1 + c with J c = -dphi/dt.
    """
    b = bodies(model.geometry, position)
    radius = None if motion is None else motion.radius
    reduction = reduce(constraint_rows(model.surface, model.geometry, rows, b, radius), rows)
    velocity = expand(reduction, independent)
    if motion is not None:
        carried = dependent_solution(reduction, _in_normal_row(rows, motion.phi_rate))
        velocity = tuple(plus(u, c) for u, c in zip(velocity, carried, strict=True))
    bias = convective(model.surface, model.geometry, rows, b, velocity)
    if motion is not None:
        bias = plus(bias, _in_normal_row(rows, motion.phi_acceleration))
    return Kinematics(b, reduction, velocity, dependent_solution(reduction, bias))


def _in_normal_row(rows: tuple[str, ...], value: Scalar) -> Vector:
    return tuple(value if name == "contact_normal" else 0 for name in rows)


class Accelerations(NamedTuple):
    """Solution of the constrained dynamics at one instant."""

    independent: Vector  # du^1/dt (n,)
    full: tuple[Vector, Vector]  # udot of each robot (5,)
    multipliers: Vector  # lambda (m,) [N]


def constrained_accelerations(
    model: Model,
    k: Kinematics,
    force: tuple[Vector, Vector],
    friction: tuple[Vector, Vector] | None = None,
) -> Accelerations:
    """(11) under a generalised force (B tau - d of each robot, constraint forces left out), and lambda of (9).

    Args:
        friction: further force of each robot (5,) for each newton of |lambda_n|: Coulomb friction of the contact.
    """
    dynamics = robot_dynamics(model, model.plant, k)
    at_rest = tuple(minus(f, h) for f, h in zip(force, _required_force(dynamics, k, k.L_rate), strict=True))
    pushes = (at_rest,) if friction is None else (at_rest, friction)
    solutions = cholesky_solve(reduced_inertia(k, dynamics), *(restrict(k.reduction, f) for f in pushes))
    # M L u1dot less the push, with everything that does not depend on u1dot already in the push.
    left = tuple(
        _less(_inertial_force(dynamics, k, expand(k.reduction, solution)), push)
        for solution, push in zip(solutions, pushes, strict=True)
    )
    lam = tuple(multipliers(k.reduction, residual) for residual in left)
    independent, forces = solutions[0], lam[0]
    if friction is not None:
        # lambda = free + |lambda_n| per_newton is piecewise linear in lambda_n, whose sign is that of its free value.
        free, per_newton = lam
        load = jnp.abs(free[0]) / (1.0 - jnp.sign(free[0]) * per_newton[0])
        independent = plus(independent, scaled(load, solutions[1]))
        forces = plus(free, scaled(load, per_newton))
    full = tuple(plus(x, y) for x, y in zip(expand(k.reduction, independent), k.L_rate, strict=True))
    return Accelerations(independent, full, forces)


def _less(a: tuple[Vector, Vector], b: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    return tuple(minus(x, y) for x, y in zip(a, b, strict=True))


def _required_force(dynamics: tuple, k: Kinematics, acceleration: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """M udot + C u + G of each robot."""
    return tuple(robot.inverse_dynamics(d, T, a) for d, T, a in zip(dynamics, k.bodies.T, acceleration, strict=True))


def _inertial_force(dynamics: tuple, k: Kinematics, acceleration: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
    """M udot of each robot."""
    return tuple(T.T @ (d.inertia @ (T @ a)) for d, T, a in zip(dynamics, k.bodies.T, acceleration, strict=True))


def reduced_inertia(k: Kinematics, dynamics: tuple[robot.Dynamics, robot.Dynamics]) -> Matrix:
    """Mr = L^T M L (n x n) of (11), as (T L)^T M (T L) with M in body rates, where it is sparsest."""
    first, second = (congruence(T @ L, d.inertia) for T, L, d in zip(k.bodies.T, k.reduction.L, dynamics, strict=True))
    return first + second


def robot_dynamics(
    model: Model, lumped: tuple[robot.Lumped, robot.Lumped], k: Kinematics
) -> tuple[robot.Dynamics, robot.Dynamics]:
    """Inertia and bias of both robots, for the plant's or the controller's lumped parameters."""
    return tuple(
        robot.dynamics(m, g, model.gravity, p, arm, T, u)
        for m, g, p, arm, T, u in zip(
            lumped, model.geometry, k.bodies.position, k.bodies.arm, k.bodies.T, k.velocity, strict=True
        )
    )

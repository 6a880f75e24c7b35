"""What couples the robots: constraint rows, Jacobian J, the map L of (10), reduced dynamics (11), multipliers.

Rows (model.md section 2): ``contact_normal`` and ``contact_height`` tie the tip of robot I to the object carried by
robot II; ``guide_radial`` and ``guide_height`` hold robot II's tip, the object, on its circle. Each row makes one joint
dependent: contact rows (a2, a3) of robot I (a3 alone when only the normal row is left: at the nominal posture
sin A + sin B = 0, so a2 does not move the normal row there), guide rows (a2, a3) of robot II.

J is block triangular over the dependent joints because the guide does not see robot I,

    J_dep = [[N1, N2], [0, G2]],

so every solve with it is two solves of size two at most. L is not block diagonal, unlike below (10): robot I's dependent
joints move when the object does.
"""

from __future__ import annotations

from typing import NamedTuple

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
    sincos,
    sub,
)
from coopmm_jax.parameters import Geometry, Plant, Surface

JOINTS = 5  # velocities u of one robot: u1, u2, a1dot, a2dot, a3dot


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


class Bodies(NamedTuple):
    """Both robots' kinematics at one instant (each field a pair, robot I and II)."""

    position: tuple[robot.Position, robot.Position]
    arm: tuple[robot.Posture, robot.Posture]
    T: tuple[Matrix, Matrix]  # body rates from u


class Rows(NamedTuple):
    """The constraint rows: residual phi [m], Jacobian blocks J1, J2 (m x 5 each) in u."""

    phi: Vector
    J: tuple[Matrix, Matrix]
    contacts: int  # rows that act on both robots; the rest act on robot II


def bodies(geometry: tuple[Geometry, Geometry], position: tuple[robot.Position, robot.Position]) -> Bodies:
    """Kinematics shared by inertia, constraints and control."""
    return Bodies(
        position,
        tuple(robot.posture(g, p) for g, p in zip(geometry, position, strict=True)),
        tuple(robot.body_map(p) for p in position),
    )


class _Contact(NamedTuple):
    """D = p1 - C from the arc's centre C = p2 - Rc e2 to tip I, along both arms' own axes (e, n)."""

    D1: tuple[Scalar, Scalar]
    D2: tuple[Scalar, Scalar]
    turn: tuple[Scalar, Scalar]  # sine and cosine of arm I's direction less arm II's
    tip2: tuple[Scalar, Scalar]


def _contact(surface: Surface, geometry: tuple[Geometry, Geometry], b: Bodies) -> _Contact:
    tip1, tip2 = (robot.tip_position(g, p, a) for g, p, a in zip(geometry, b.position, b.arm, strict=True))
    one, two = b.position
    s, c = sincos((one.z1 - two.z1) + (one.a1 - two.a1))
    centre = _to_arm1((s, c), (tip2[0] - surface.contact_radius, tip2[1]))
    D1 = minus(tip1, centre)
    D2 = (c * D1[0] - s * D1[1], s * D1[0] + c * D1[1])
    return _Contact(D1, D2, (s, c), tip2)


def _to_arm1(turn: tuple[Scalar, Scalar], vector: Vector) -> Vector:
    """A horizontal vector given along arm II's axes, along arm I's."""
    s, c = turn
    return c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]


def constraint_rows(surface: Surface, geometry: tuple[Geometry, Geometry], names: tuple[str, ...], b: Bodies) -> Rows:
    """phi and J of the rows in force; J u = 0.

    Args:
        names: constraint rows, in the order of ``ALL_ROWS``.
    """
    Rc, Rg = surface.contact_radius, surface.guide_radius
    contact = _contact(surface, geometry, b)
    (e1, n1, up1), (e2, n2, up2) = (robot.tip_rows(g, a) for g, a in zip(geometry, b.arm, strict=True))
    n_centre = (*n2[:2], sub(n2[2], Rc), *n2[3:])  # the centre's velocity across arm II: tip's less Rc times arm yaw
    none = (0,) * JOINTS
    p = contact.tip2
    table = {
        "contact_normal": (
            (Rc * Rc - dot(contact.D1, contact.D1)) / (2.0 * Rc),
            scaled(-1.0 / Rc, plus(scaled(contact.D1[0], e1), scaled(contact.D1[1], n1))),
            scaled(1.0 / Rc, plus(scaled(contact.D2[0], e2), scaled(contact.D2[1], n_centre))),
        ),
        "contact_height": (b.arm[0].height - b.arm[1].height, up1, tuple(sub(0, x) for x in up2)),
        "guide_radial": (
            (dot(p, p) - Rg * Rg) / (2.0 * Rg),
            none,
            scaled(1.0 / Rg, plus(scaled(p[0], e2), scaled(p[1], n2))),
        ),
        "guide_height": (b.arm[1].height - surface.guide_height, none, up2),
    }
    phi, J1, J2 = zip(*(table[name] for name in names), strict=True)
    contacts = sum(name.startswith("contact") for name in names)
    return Rows(phi, (Matrix(J1) @ b.T[0], Matrix(J2) @ b.T[1]), contacts)


def convective(
    surface: Surface,
    geometry: tuple[Geometry, Geometry],
    names: tuple[str, ...],
    b: Bodies,
    velocity: tuple[Vector, Vector],
) -> Vector:
    """Jdot u (m,) [m/s^2]: acceleration of the rows when udot = 0. ``velocity`` is u of each robot (5,)."""
    Rc = surface.contact_radius
    contact = _contact(surface, geometry, b)
    rates = tuple(T @ u for T, u in zip(b.T, velocity, strict=True))
    tips = tuple(robot.tip_rows(g, a) for g, a in zip(geometry, b.arm, strict=True))
    speed = tuple(tuple(dot(row, w) for row in rows) for rows, w in zip(tips, rates, strict=True))
    acceleration = tuple(
        robot.tip_bias(g, a, w, robot.body_map_rate(p, u))
        for g, p, a, w, u in zip(geometry, b.position, b.arm, rates, velocity, strict=True)
    )
    (v1, v2), (a1, a2), W2 = speed, acceleration, rates[1][2]
    D_rate = minus(v1[:2], _to_arm1(contact.turn, (v2[0], v2[1] - Rc * W2)))
    D_acceleration = minus(a1[:2], _to_arm1(contact.turn, (a2[0] + Rc * W2 * W2, a2[1])))
    table = {
        "contact_normal": -(dot(D_rate, D_rate) + dot(contact.D1, D_acceleration)) / Rc,
        "contact_height": a1[2] - a2[2],
        "guide_radial": (dot(v2[:2], v2[:2]) + dot(contact.tip2, a2[:2])) / surface.guide_radius,
        "guide_height": a2[2],
    }
    return tuple(table[name] for name in names)


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


def reduced_inertia(reduction: Reduction, inertia: tuple[Matrix, Matrix]) -> Matrix:
    """Mr = L^T M L (n x n) of (11); ``inertia`` is M_i2 of each robot in u."""
    first, second = (congruence(L, M) for L, M in zip(reduction.L, inertia, strict=True))
    return first + second


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


class Accelerations(NamedTuple):
    """Solution of the constrained dynamics at one instant."""

    independent: Vector  # du^1/dt (n,)
    full: tuple[Vector, Vector]  # udot of each robot (5,)
    multipliers: Vector  # lambda (m,) [N]


def constrained_accelerations(
    plant: Plant,
    lumped: tuple[robot.Lumped, robot.Lumped],
    b: Bodies,
    reduction: Reduction,
    velocity: tuple[Vector, Vector],
    L_rate: tuple[Vector, Vector],
    force: tuple[Vector, Vector],
) -> Accelerations:
    """(11) under a generalised force (B tau - d, without constraint forces), and lambda of (9).

    Args:
        velocity: u of each robot. L_rate: Ldot u^1, from ``dependent_solution``.
    """
    inertia = tuple(robot.body_inertia(m, g, a) for m, g, a in zip(lumped, plant.geometry, b.arm, strict=True))
    bias = tuple(
        robot.body_bias(m, g, plant.gravity, a, T @ u)
        for m, g, a, T, u in zip(lumped, plant.geometry, b.arm, b.T, velocity, strict=True)
    )
    T_rate = tuple(robot.body_map_rate(p, u) for p, u in zip(b.position, velocity, strict=True))

    def required_force(acceleration: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
        return tuple(map(robot.inverse_dynamics, inertia, bias, b.T, T_rate, acceleration))

    at_rest = tuple(minus(f, h) for f, h in zip(force, required_force(L_rate), strict=True))
    in_u = tuple(congruence(T, M) for T, M in zip(b.T, inertia, strict=True))
    (independent,) = cholesky_solve(reduced_inertia(reduction, in_u), restrict(reduction, at_rest))
    full = tuple(plus(x, y) for x, y in zip(expand(reduction, independent), L_rate, strict=True))
    residual = tuple(minus(h, f) for h, f in zip(required_force(full), force, strict=True))
    return Accelerations(independent, full, multipliers(reduction, residual))

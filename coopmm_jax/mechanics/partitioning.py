"""Coupling of the robots: the map L of (10) from the independent velocities u^1 to all of them, and its uses.

Each constraint row makes one joint dependent, the last ones of an arm: contact rows (a2, a3) of robot I (a3 alone when
only one of them is left: at the nominal posture sin A + sin B = 0, so a2 does not move the normal row there), guide
rows (a2, a3) of robot II; where the contact is compliant, the plant may have neither. Joints that an arm has more than
these are independent, as its yaw is. J is block triangular over the dependent joints because the
guide does not see robot I,

    J_dep = [[N1, N2], [0, G2]],

so every solve with it is two solves of size two at most. L is not block diagonal, unlike below (10): robot I's
dependent joints move when the object does.

Rows that hold a height do not see the independent velocities when both heights are held. The other rows drive the
dependent joints: u_dep = N R u^1, with one row of the drive matrix R for each of them, in the full set one for each
robot. So the time loop never multiplies L out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Matrix, cholesky_solve, dot, identity, inverse_small, is_zero, minus, plus, sub
from coopmm_jax.algebra.types import Pair, Scalar, T, Vector
from coopmm_jax.mechanics.constraints import Rows
from coopmm_jax.mechanics.robot import JOINTS, YAW, per_robot


class Partition(NamedTuple):
    """Partition of each robot's (u1, u2, a1dot, a2dot, a3dot) into independent ones and those that the rows decide."""

    independent: Pair[tuple[int, ...]]
    dependent: Pair[tuple[int, ...]]


def partition(rows: tuple[str, ...], joints: Pair[int] = (JOINTS, JOINTS)) -> Partition:
    """The split of (10) for a set of rows and numbers of joints, as ``Structure`` has them; static.

    >>> partition(("contact_normal",)).dependent
    ((4,), ())
    """
    contacts = sum(name.startswith("contact") for name in rows)
    taken = (contacts, len(rows) - contacts)
    for count, own in zip(joints, taken, strict=True):
        assert count - own > YAW, "an arm has fewer joints than rows ask for"
    dependent = per_robot(lambda count, own: tuple(range(count - own, count)), joints, taken)
    return Partition(per_robot(lambda count, own: tuple(range(count - own)), joints, taken), dependent)


class Reduction(NamedTuple):
    """The constraint solved for the dependent joints, (10)."""

    R: Matrix  # (drives, n): what of u^1 drives the dependent joints, robot I's drives first
    N: Pair[Matrix]  # of each robot (dependent joints, its drives): how they follow
    part: Partition
    rows: Rows
    N1_inverse: Matrix
    carried: Matrix  # -N2 G2^-1: what residuals of the guide add at the contact
    G2_inverse: Matrix
    determinants: tuple[Scalar, ...]  # of N1 and G2: an arm is singular where one vanishes


_NOTHING = Matrix([])


def _columns(matrix: Matrix, rows: slice, columns: tuple[int, ...]) -> Matrix:
    return Matrix([[row[j] for j in columns] for row in matrix.rows[rows]])


def reduce(rows: Rows, names: tuple[str, ...], joints: Pair[int] = (JOINTS, JOINTS)) -> Reduction:
    """Solve J u = 0 for the dependent joints: L of (10) as N R, and what the solves below need."""
    part = partition(names, joints)
    contact, guide = slice(0, rows.contacts), slice(rows.contacts, None)
    J1, J2 = rows.J
    N1_inverse, determinants = _NOTHING, ()
    if part.dependent[0]:
        N1_inverse, determinant = inverse_small(_columns(J1, contact, part.dependent[0]))
        determinants = (determinant,)
    at_contact = _columns(J2, contact, part.independent[1])
    R2, N_II, carried, G2_inverse = _NOTHING, _NOTHING, _NOTHING, _NOTHING
    if part.dependent[1]:
        G2_inverse, determinant = inverse_small(_columns(J2, guide, part.dependent[1]))
        determinants = (*determinants, determinant)
        carried = _carried(_columns(J2, contact, part.dependent[1]), G2_inverse, names)
        at_guide = _columns(J2, guide, part.independent[1])
        at_contact = at_contact + carried @ at_guide
        R2, N_II = _drives(at_guide, G2_inverse)
    at_contact = _columns(J1, contact, part.independent[0]).beside(at_contact)
    R1, N_I = _drives(at_contact, N1_inverse)
    other = (0,) * len(part.independent[0])
    R = Matrix([*R1.rows, *((*other, *row) for row in R2.rows)])
    return Reduction(R, (N_I, N_II), part, rows, N1_inverse, carried, G2_inverse, determinants)


def _carried(N2: Matrix, G2_inverse: Matrix, names: tuple[str, ...]) -> Matrix:
    """-N2 G2^-1, whose height row is known: there N2 is the opposite of the guide's height row."""
    product = N2 @ G2_inverse
    negated = (tuple(sub(0, x) for x in row) for row in product.rows)
    return Matrix([(0, 1) if name == "contact_height" else row for name, row in zip(names, negated, strict=False)])


def _drives(right: Matrix, inverse: Matrix) -> Pair[Matrix]:
    """R and N with N R = -inverse right, without the rows of ``right`` that are zero by structure."""
    kept = [i for i, row in enumerate(right.rows) if not all(map(is_zero, row))]
    N = Matrix([[sub(0, row[i]) for i in kept] for row in inverse.rows])
    return Matrix([right.rows[i] for i in kept]), N


def of_each_robot(reduction: Reduction, drives: Sequence[T]) -> Pair[tuple[T, ...]]:
    """Values of the drives, as those of each robot."""
    first = len(reduction.N[0].rows[0]) if reduction.N[0].rows else 0
    return tuple(drives[:first]), tuple(drives[first:])


def joined(part: Partition, independent: Sequence[T], dependent: Pair[Sequence[T]]) -> Pair[tuple[T, ...]]:
    """Values of all joints, (5,) of each robot, from those of the independent (n,) and of the dependent ones."""

    def all_joints(free: tuple[int, ...], own: Sequence[T], bound: tuple[int, ...], values: Sequence[T]) -> tuple:
        entries = dict(zip((*free, *bound), (*own, *values), strict=True))
        return tuple(entries[joint] for joint in range(len(entries)))

    return per_robot(all_joints, part.independent, split(part, independent), part.dependent, dependent)


def split(part: Partition, independent: Sequence[T]) -> Pair[tuple[T, ...]]:
    """Values of the independent joints (n,), as those of each robot."""
    first = len(part.independent[0])
    return tuple(independent[:first]), tuple(independent[first:])


def parted(part: Partition, joints: Pair[Vector]) -> tuple[Vector, Pair[Vector]]:
    """The inverse of ``joined``: the independent (n,), and the dependent ones of each robot."""
    first, second = per_robot(_chosen, joints, part.independent)
    return first + second, per_robot(_chosen, joints, part.dependent)


def _chosen(values: Vector, joints: tuple[int, ...]) -> Vector:
    return tuple(values[j] for j in joints)


def velocity_maps(reduction: Reduction) -> Pair[Matrix]:
    """L of (10), multiplied out: of each robot (5 x n)."""
    drives = of_each_robot(reduction, reduction.R.rows)
    dependent = per_robot(lambda N, R: (N @ Matrix(R)).rows, reduction.N, drives)
    return per_robot(Matrix, joined(reduction.part, identity(len(reduction.R.rows[0])).rows, dependent))


def expand(reduction: Reduction, independent: Vector) -> Pair[Vector]:
    """u of each robot (5,) from the independent velocities (n,): u = L u^1 of (10)."""
    drives = of_each_robot(reduction, reduction.R @ independent)
    return joined(reduction.part, independent, per_robot(lambda N, x: N @ x, reduction.N, drives))


def restrict(reduction: Reduction, force: Pair[Vector]) -> Vector:
    """L^T F (n,): a generalised force on all joints as seen by the independent velocities."""
    independent, dependent = parted(reduction.part, force)
    return plus(independent, reduction.R.T @ _on_drives(reduction, dependent))


def _on_drives(reduction: Reduction, dependent: Pair[Vector]) -> Vector:
    first, second = per_robot(lambda N, f: N.T @ f, reduction.N, dependent)
    return first + second


def velocity_map_norm(reduction: Reduction) -> Scalar:
    """Frobenius norm [-] of L: |L|^2 = n + trace(N^T N R R^T)."""
    R = reduction.R
    own = _block_diagonal(*(N.T @ N for N in reduction.N))
    trace = dot(*(sum(M.rows, ()) for M in (own, R @ R.T)))
    return jnp.sqrt(sum(map(len, reduction.part.independent)) + trace)


def _block_diagonal(first: Matrix, second: Matrix) -> Matrix:
    m, n = len(first.rows), len(second.rows)
    return Matrix([*((*row, *(0,) * n) for row in first.rows), *(((0,) * m + row) for row in second.rows)])


def least_equivalent(reduction: Reduction, force: Pair[Vector]) -> Pair[Vector]:
    """The least force on all joints that does to the independent velocities what ``force`` does.

    It is L (L^T L)^-1 L^T force (substitution after (40)). As L = [I; N R] up to order, L^T L = I + R^T N^T N R, and by
    Woodbury's identity its inverse takes a solve with one unknown for each drive only.
    """
    R, N = reduction.R, reduction.N
    independent, dependent = parted(reduction.part, force)
    compliance = _block_diagonal(*(inverse_small(M.T @ M)[0] if M.rows else M for M in N))
    on_drives = _on_drives(reduction, dependent)
    (change,) = cholesky_solve(compliance + R @ R.T, minus(R @ independent, compliance @ on_drives))
    rates = of_each_robot(reduction, compliance @ plus(on_drives, change))
    dependent = per_robot(lambda M, rate: M @ rate, N, rates)
    return joined(reduction.part, minus(independent, R.T @ change), dependent)


def spread(reduction: Reduction, force: Vector) -> Pair[Vector]:
    """The least force on all joints that L^T takes to ``force`` (n,)."""
    return least_equivalent(reduction, on_independent(reduction.part, force))


def on_independent(part: Partition, force: Vector) -> Pair[Vector]:
    """A force (n,) on the independent joints, none on the others."""
    return joined(part, force, per_robot(lambda bound: (0,) * len(bound), part.dependent))


def dependent_solution(reduction: Reduction, right: Vector) -> Pair[Vector]:
    """The dependent joints x with J_dep x = -right, as vectors (5,) of each robot, zero elsewhere.

    With right = Jdot u it is Ldot u^1; with right = phi it is the joint correction that removes the drift.
    """
    part, contacts = reduction.part, reduction.rows.contacts
    at_contact, at_guide = right[:contacts], right[contacts:]
    if at_guide:
        at_contact = plus(at_contact, reduction.carried @ at_guide)
    solved = (reduction.N1_inverse @ at_contact, reduction.G2_inverse @ at_guide)
    none = (0,) * sum(map(len, part.independent))
    return joined(part, none, per_robot(lambda values: tuple(sub(0, x) for x in values), solved))


def multipliers(reduction: Reduction, residual: Pair[Vector]) -> Vector:
    """lambda (m,) [N] with J^T lambda = residual, from the dependent joints' rows alone.

    The same as (J J^T)^-1 J residual, since a residual of the constrained dynamics lies in the range of J^T.
    """
    _, (first, second) = parted(reduction.part, residual)
    contact = reduction.N1_inverse.T @ first
    if not second:
        return contact
    if not contact:
        return reduction.G2_inverse.T @ second
    return contact + plus(reduction.G2_inverse.T @ second, reduction.carried.T @ contact)


def constraint_force(reduction: Reduction, lam: Vector) -> Pair[Vector]:
    """J^T lambda on each robot (5,)."""
    return per_robot(lambda J: J.T @ lam, reduction.rows.J)

"""Small matrices made of scalar components, with structural zeros and ones.

XLA's CPU back end runs a handful of tiny matrix products a hundred times slower than the same arithmetic written on
scalars, which it fuses into a few loops. Entries are scalars; a Python ``0`` or ``1`` (an int) is structural: products
and sums with it vanish while tracing, so ``L.T @ M @ L`` costs only its non-trivial terms.

>>> (Matrix([[1, 0], [2.0, 1]]) @ (3.0, 4.0))
(3.0, 10.0)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import overload

from coopmm_jax.algebra.later import jnp, lax
from coopmm_jax.algebra.types import Scalar, Vector


def _structural(a: Scalar, value: int) -> bool:
    return type(a) is int and a == value


def is_zero(a: Scalar) -> bool:
    """True if a scalar is a structural zero."""
    return _structural(a, 0)


def _alike(a: Scalar, b: Scalar) -> bool:
    """True for arrays of one type, whose primitives JAX traces in half the time that its operators take."""
    kind = getattr(a, "aval", None)
    return kind is not None and kind == getattr(b, "aval", None)


def add(a: Scalar, b: Scalar) -> Scalar:
    """Scalars a + b, dropping structural zeros."""
    if _structural(a, 0):
        return b
    if _structural(b, 0):
        return a
    return lax.add(a, b) if _alike(a, b) else a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """Scalars a - b, dropping structural zeros."""
    if _structural(b, 0):
        return a
    if _structural(a, 0):
        return -b
    return lax.sub(a, b) if _alike(a, b) else a - b


def mul(a: Scalar, b: Scalar) -> Scalar:
    """Product of scalars, dropping structural zeros and ones."""
    if _structural(a, 0) or _structural(b, 0):
        return 0
    if _structural(a, 1):
        return b
    if _structural(b, 1):
        return a
    return lax.mul(a, b) if _alike(a, b) else a * b


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    """Inner product of two vectors of one length."""
    total: Scalar = 0
    for x, y in zip(a, b, strict=True):
        total = add(total, mul(x, y))
    return total


def plus(*vectors: Sequence[Scalar]) -> Vector:
    """Sum of vectors of one length."""
    total = tuple(vectors[0])
    for vector in vectors[1:]:
        total = tuple(add(x, y) for x, y in zip(total, vector, strict=True))
    return total


def minus(a: Sequence[Scalar], b: Sequence[Scalar]) -> Vector:
    """a - b for vectors of one length."""
    return tuple(sub(x, y) for x, y in zip(a, b, strict=True))


def scaled(factor: Scalar, vector: Sequence[Scalar]) -> Vector:
    """A vector (n,) times a scalar."""
    return tuple(mul(factor, x) for x in vector)


def norm(vector: Sequence[Scalar]) -> Scalar:
    """Euclidean norm of a vector (n,), smoothed as sqrt(x.x + 1e-16) so that its gradient exists at zero."""
    return jnp.sqrt(dot(vector, vector) + 1e-16)


class Matrix:
    """A matrix as a tuple of rows of scalars.

    Args:
        rows: equally long sequences of scalars; Python ints 0 and 1 are structural.
    """

    def __init__(self, rows: Sequence[Sequence[Scalar]]):
        self.rows = tuple(tuple(row) for row in rows)

    @property
    def T(self) -> Matrix:
        """The transpose (columns, rows)."""
        return Matrix(list(zip(*self.rows, strict=True)))

    @overload
    def __matmul__(self, other: Matrix) -> Matrix: ...
    @overload
    def __matmul__(self, other: Sequence[Scalar]) -> Vector: ...
    def __matmul__(self, other: Matrix | Sequence[Scalar]) -> Matrix | Vector:
        if isinstance(other, Matrix):
            columns = other.T.rows
            return Matrix([[dot(row, column) for column in columns] for row in self.rows])
        return tuple(dot(row, other) for row in self.rows)

    def __add__(self, other: Matrix) -> Matrix:
        return Matrix([plus(a, b) for a, b in zip(self.rows, other.rows, strict=True)])

    def beside(self, other: Matrix) -> Matrix:
        """This matrix with the columns of ``other``, which has as many rows, to its right."""
        return Matrix([a + b for a, b in zip(self.rows, other.rows, strict=True)])


def identity(n: int) -> Matrix:
    """The n x n unit matrix, all of it structural."""
    return Matrix([[int(i == j) for j in range(n)] for i in range(n)])


def congruence(L: Matrix, M: Matrix) -> Matrix:
    """L^T M L (k x k) for symmetric M (n x n) and L (n x k), computing each off-diagonal entry once."""
    ML, columns = (M @ L).T.rows, L.T.rows
    lower = [[dot(columns[i], ML[j]) for j in range(i + 1)] for i in range(len(columns))]
    return Matrix([[lower[max(i, j)][min(i, j)] for j in range(len(columns))] for i in range(len(columns))])


def cholesky_solve(A: Matrix, *right_sides: Sequence[Scalar]) -> list[Vector]:
    """Solve A x = b for each right side b (n,) by unrolled U D U^T; A (n x n) is symmetric positive definite.

    D apart rather than Cholesky: n divisions and no square roots, which cost ten multiplications each. From the last
    unknown to the first, so from the tip of an arm to its base, as that keeps the zeros of its inertia matrix
    (Featherstone, Rigid Body Dynamics Algorithms, section 6.5).
    """
    n = len(A.rows)
    U: list[list[Scalar]] = [[0] * n for _ in range(n)]
    UD: list[list[Scalar]] = [[0] * n for _ in range(n)]
    inverse_pivot: list[Scalar] = [0] * n
    for j in reversed(range(n)):
        for i in range(j + 1):
            UD[i][j] = sub(A.rows[i][j], dot(UD[i][j + 1 :], U[j][j + 1 :]))
        inverse_pivot[j] = 1.0 / UD[j][j]
        for i in range(j):
            U[i][j] = mul(UD[i][j], inverse_pivot[j])
    solutions = []
    for b in right_sides:
        y = list(b)
        for i in reversed(range(n)):
            y[i] = sub(y[i], dot(U[i][i + 1 :], y[i + 1 :]))
        x = [mul(y[i], inverse_pivot[i]) for i in range(n)]
        for i in range(n):
            x[i] = sub(x[i], dot([U[k][i] for k in range(i)], x[:i]))
        solutions.append(tuple(x))
    return solutions


def inverse_small(A: Matrix) -> tuple[Matrix, Scalar]:
    """Inverse of a 1 x 1 or 2 x 2 matrix and its determinant, by Cramer's rule."""
    if len(A.rows) == 1:
        ((a,),) = A.rows
        return Matrix([[1.0 / a]]), a
    (a, b), (c, d) = A.rows
    determinant = sub(mul(a, d), mul(b, c))
    scale = 1.0 / determinant
    return Matrix([[mul(d, scale), mul(sub(0, b), scale)], [mul(sub(0, c), scale), mul(a, scale)]]), determinant

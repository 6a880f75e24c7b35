"""Small matrices made of scalar components, with structural zeros and ones.

XLA's CPU back end runs a handful of tiny matrix products a hundred times slower than the same arithmetic written on
scalars, which it fuses into a few loops. Entries are scalars; a Python ``0`` or ``1`` (an int) is structural: products
and sums with it vanish while tracing, so ``L.T @ M @ L`` costs only its non-trivial terms.

>>> (Matrix([[1, 0], [2.0, 1]]) @ (3.0, 4.0))
(3.0, 10.0)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

Scalar = Any
Vector = tuple


def _structural(a: Scalar, value: int) -> bool:
    return type(a) is int and a == value


def is_zero(a: Scalar) -> bool:
    """Whether a scalar is a structural zero."""
    return _structural(a, 0)


def add(a: Scalar, b: Scalar) -> Scalar:
    """Scalars a + b, dropping structural zeros."""
    if _structural(a, 0):
        return b
    return a if _structural(b, 0) else a + b


def sub(a: Scalar, b: Scalar) -> Scalar:
    """Scalars a - b, dropping structural zeros."""
    if _structural(b, 0):
        return a
    return -b if _structural(a, 0) else a - b


def mul(a: Scalar, b: Scalar) -> Scalar:
    """Product of scalars, dropping structural zeros and ones."""
    if _structural(a, 0) or _structural(b, 0):
        return 0
    if _structural(a, 1):
        return b
    return a if _structural(b, 1) else a * b


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

    def __matmul__(self, other: Matrix | Sequence[Scalar]) -> Any:
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
    U = [[0] * n for _ in range(n)]
    UD = [[0] * n for _ in range(n)]
    inverse_pivot = [0] * n
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


class _Series(NamedTuple):
    """Constants of ``sincos`` in one precision.

    ``pi`` is split after Cody and Waite into parts whose product with n is exact up to |x| ~ 1e5, the last one to
    rounding. ``sin`` and ``cos`` are Chebyshev fits in z = h^2, |h| <= pi/2, of (sin h - h) / (h z) and (cos h - 1 +
    z/2) / z^2, to rounding.
    """

    pi: tuple[float, ...]
    sin: tuple[float, ...]
    cos: tuple[float, ...]


_DOUBLE = _Series(
    pi=(3.1415926534682512, 1.2154201013012384e-10),
    sin=(
        2.7314447512062796e-15,
        -7.643970295533013e-13,
        1.605897731242445e-10,
        -2.505210761699557e-08,
        2.755731921916323e-06,
        -0.00019841269841254974,
        0.008333333333333316,
        -0.16666666666666666,
    ),
    cos=(
        4.646435932869834e-14,
        -1.1466252257937559e-11,
        2.0876681558822446e-09,
        -2.7557318573365657e-07,
        2.4801587298913547e-05,
        -0.0013888888888884767,
        0.04166666666666666,
    ),
)
_SINGLE = _Series(
    pi=(3.140625, 0.0009670257568359375, 6.27832957301e-07),
    sin=(2.634756368e-06, -0.0001982273948, 0.008333242135, -0.1666666596),
    cos=(-2.654606561e-07, 2.478608243e-05, -0.001388881255, 0.04166666608),
)


def _horner(coefficients: Sequence[float], x: Scalar) -> Scalar:
    total: Scalar = coefficients[0]
    for coefficient in coefficients[1:]:
        total = total * x + coefficient
    return total


@jax.custom_jvp
def sincos(x: Scalar) -> tuple[Scalar, Scalar]:
    """sin x and cos x of a scalar x [rad] together, for |x| up to 1e5 to 1e-15 in float64 and 6e-7 in float32.

    A polynomial of our own, because XLA's CPU back end calls libm once per element for these two while it vectorises
    everything else. Half angles make one interval of the whole circle: choosing quadrants instead takes comparisons,
    which XLA does not fuse with their neighbours, eight small loops more for each of the angles here.
    """
    x = jnp.asarray(x)
    series = _DOUBLE if x.dtype == jnp.float64 else _SINGLE
    n = jnp.floor(x * (0.5 / jnp.pi) + 0.5)
    h = 0.5 * x
    for part in series.pi:
        h = h - n * part
    z = h * h
    s = h + h * z * _horner(series.sin, z)
    c = 1.0 - 0.5 * z + z * z * _horner(series.cos, z)
    return 2.0 * s * c, 1.0 - 2.0 * s * s


@sincos.defjvp
def _sincos_jvp(primals: tuple, tangents: tuple) -> tuple:
    s, c = sincos(primals[0])
    return (s, c), (c * tangents[0], -s * tangents[0])

"""Small matrices of scalars against numpy, what structural entries cost, and the package's own sine and cosine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.algebra import matrix
from coopmm_jax.algebra.angle import angle_of
from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.matrix import Matrix, cholesky_solve, congruence, dot, inverse_small, minus, norm, plus, scaled
from coopmm_jax.algebra.sincos import sincos, wrapped
from tests.samples import assert_close, vector


def as_matrix(array, structural=False):
    """A ``Matrix`` of floats; with ``structural`` its zeros and ones become Python ints."""

    def entry(x):
        return int(x) if structural and x in (0, 1) else float(x)

    return Matrix([[entry(x) for x in row] for row in array])


def as_array(matrix):
    return np.array([[float(x) for x in row] for row in matrix.rows])


def sparse(rng, shape):
    """A random array with many exact zeros and ones."""
    return np.where(rng.random(shape) < 0.3, rng.normal(size=shape), rng.integers(0, 2, shape))


def positive_definite(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


def operations(function, *arguments):
    """The names of the arithmetic operations that a function of scalars is traced into."""
    return sorted(equation.primitive.name for equation in jax.make_jaxpr(function)(*arguments).eqns)


@pytest.mark.parametrize("structural", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_matrix_algebra(seed, structural):
    rng = np.random.default_rng(seed)
    A, B, C = sparse(rng, (3, 4)), sparse(rng, (4, 5)), sparse(rng, (3, 4))
    x = rng.normal(size=4)
    a, b, c = (as_matrix(array, structural) for array in (A, B, C))
    assert_close(as_array(a @ b), A @ B, 1e-15)
    assert_close(vector(a @ tuple(x.tolist())), A @ x, 1e-15)
    assert_close(as_array(a + c), A + C, 1e-16)
    assert np.array_equal(as_array(a.T), A.T)


def test_vector_algebra():
    a, b, c = (1.0, 0, 2.5), (0, 1, -4.0), (3.0, 1, 0)
    A, B, C = map(np.array, (a, b, c))
    assert np.array_equal(vector(plus(a, b, c)), A + B + C)
    assert np.array_equal(vector(minus(a, b)), A - B)
    assert np.array_equal(vector(scaled(2.0, a)), 2 * A)
    assert float(dot(a, b)) == A @ B


def test_arrays_of_one_type_take_the_same_operations():
    a, b = jnp.float64(5.0), jnp.float64(3.0)
    assert (matrix.add(a, b), matrix.sub(a, b), matrix.mul(a, b)) == (8.0, 2.0, 15.0)


def test_unequal_lengths_are_refused():
    for operation in (dot, plus, minus):
        with pytest.raises(ValueError, match="shorter"):
            operation((1.0, 2.0, 3.0), (1.0, 2.0))


def test_norm_has_a_gradient_everywhere():
    x = (3.0, 0, -4.0)
    assert float(norm(x)) == pytest.approx(5.0, rel=1e-15)
    assert float(norm((0.0, 0.0))) == pytest.approx(1e-8, rel=1e-15)
    assert float(jax.grad(lambda a: norm((a, a)))(0.0)) == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_congruence(seed):
    rng = np.random.default_rng(seed)
    M, L = positive_definite(rng, 5), sparse(rng, (5, 3))
    result = as_array(congruence(as_matrix(L, structural=True), as_matrix(M)))
    assert_close(result, L.T @ M @ L, 1e-15)
    assert np.array_equal(result, result.T)


@pytest.mark.parametrize("n", range(1, 7))
def test_cholesky_solve(n):
    rng = np.random.default_rng(n)
    A, b = positive_definite(rng, n), rng.normal(size=(2, n))
    solutions = cholesky_solve(as_matrix(A), *(tuple(row.tolist()) for row in b))
    for x, right in zip(solutions, b, strict=True):
        assert_close(A @ vector(x), right, 2e-14)


def test_cholesky_solve_of_a_sparse_matrix():
    A = np.array([[4.0, 0, 1], [0, 2, 0], [1, 0, 3]])
    (x,) = cholesky_solve(as_matrix(A, structural=True), (1.0, 2.0, 3.0))
    assert_close(vector(x), np.linalg.solve(A, [1.0, 2.0, 3.0]), 1e-15)


@pytest.mark.parametrize("A", [[[-2.5]], [[1.0, 2.0], [3.0, -4.0]], [[2.0, 0.0], [1.0, 3.0]], [[0.0, 2.0], [4.0, 1.0]]])
def test_inverse_small(A):
    inverse, determinant = inverse_small(as_matrix(A, structural=True))
    assert_close(as_array(inverse) @ np.array(A), np.eye(len(A)), 3e-16)
    assert float(determinant) == pytest.approx(np.linalg.det(A), rel=1e-15)


def test_structural_entries_cost_nothing():
    def product(a, x, y):
        return Matrix([[1, 0], [a, 1]]) @ (x, y)

    def block(a, b):
        return congruence(Matrix([[1, 0], [0, 1], [a, 0]]), Matrix([[b, 0, 0], [0, b, 0], [0, 0, b]])).rows

    assert operations(product, 1.0, 2.0, 3.0) == ["add", "mul"]  # a x + y
    assert operations(block, 1.0, 2.0) == ["add", "mul", "mul"]  # b + a (b a)
    assert operations(lambda a: inverse_small(Matrix([[1, 0], [a, 1]]))[0].rows, 1.0).count("div") <= 1
    assert operations(lambda a, b: cholesky_solve(Matrix([[a, 0], [0, a]]), (b, 0)), 1.0, 2.0).count("add") == 0


def test_float_zeros_are_not_structural():
    assert operations(lambda a: dot((0.0, 1.0), (a, a)), 1.0) == ["add", "mul", "mul"]


ANGLES = np.concatenate(
    [
        np.random.default_rng(0).uniform(-1e5, 1e5, 20_000),
        np.random.default_rng(1).uniform(-7.0, 7.0, 20_000),
        # Where quadrants meet, and their neighbours.
        np.nextafter(np.arange(-64, 65) * np.pi / 2, np.inf),
        np.arange(-64, 65) * np.pi / 2,
        [0.0, 1e-300, -1e-9],
    ]
)


def test_sincos_is_accurate_over_many_turns():
    s, c = map(np.asarray, jax.jit(sincos)(ANGLES))
    exact = ANGLES.astype(np.longdouble)
    assert np.abs(s - np.sin(exact)).max() < 1e-15
    assert np.abs(c - np.cos(exact)).max() < 1e-15


def test_sincos_near_zero_keeps_relative_accuracy():
    x = np.concatenate([np.geomspace(1e-300, 1e-2, 200), -np.geomspace(1e-300, 1e-2, 200)])
    s, _ = jax.jit(sincos)(x)
    np.testing.assert_allclose(s, np.sin(x), rtol=5e-16)


def test_sincos_derivatives():
    @jax.jit
    def found(x):
        forward = jax.jvp(sincos, (x,), (jnp.full_like(x, 2.0),))[1]
        second = jax.vmap(jax.grad(jax.grad(lambda x: sincos(x)[0])))(x)
        return sincos(x), forward, jax.vmap(jax.jacrev(sincos))(x), second

    (s, c), forward, backward, second = jax.device_get(found(ANGLES[::50]))
    for (ds, dc), factor in ((forward, 2.0), (backward, 1.0)):
        np.testing.assert_array_equal(ds, factor * c)
        np.testing.assert_array_equal(dc, -factor * s)
    np.testing.assert_array_equal(second, -s)


def test_sincos_in_single_precision():
    x = np.linspace(-50, 50, 1001, dtype=np.float32)
    s, c = jax.jit(sincos)(x)
    assert s.dtype == c.dtype == np.float32
    np.testing.assert_allclose(s, np.sin(x.astype(float)), rtol=0.0, atol=6e-7)
    np.testing.assert_allclose(c, np.cos(x.astype(float)), rtol=0.0, atol=6e-7)


def test_wrapped_angles_are_exact_within_half_a_turn_and_a_turn_less_beyond():
    x = np.linspace(-3.14159, 3.14159, 1001)
    assert np.array_equal(jax.jit(wrapped)(x), x)
    np.testing.assert_allclose(jax.jit(wrapped)(x + 6 * np.pi), x, rtol=0, atol=1e-14)
    assert jax.vmap(jax.grad(wrapped))(np.array([0.1, 3.0, 4.0, -20.0])).tolist() == [1.0] * 4


def test_angle_of_a_vector_is_accurate_all_round():
    turn = np.linspace(-np.pi, np.pi, 4001)[1:]
    x, y = 3.0 * np.cos(turn), 3.0 * np.sin(turn)
    np.testing.assert_allclose(jax.jit(angle_of)(x, y), np.arctan2(y, x), rtol=4e-16, atol=1e-300)
    single = jax.jit(angle_of)(x.astype(np.float32), y.astype(np.float32))
    np.testing.assert_allclose(single, np.arctan2(y.astype(np.float32), x.astype(np.float32)), rtol=3e-7)
    assert [float(angle_of(*v)) for v in ((1.0, 0.0), (0.0, -2.0), (-1.0, 0.0))] == [0.0, -0.5 * np.pi, np.pi]


def test_angle_of_a_vector_turns_as_the_vector_does():
    rates = jax.jvp(angle_of, (-3.0, 4.0), (0.5, -1.0))[1]
    assert float(rates) == pytest.approx((-3.0 * -1.0 - 4.0 * 0.5) / 25.0, rel=1e-15)
    second = jax.grad(jax.grad(lambda t: angle_of(jnp.cos(t), 2.0 * jnp.sin(t))))(0.4)
    by_arctan = jax.grad(jax.grad(lambda t: jnp.arctan2(2.0 * jnp.sin(t), jnp.cos(t))))(0.4)
    assert float(second) == pytest.approx(float(by_arctan), rel=1e-13)


def test_derivatives_of_any_order_in_closed_form():
    assert [float(x) for x in derivatives(lambda x: jnp.exp(2.0 * x), 0.3, 4)] == pytest.approx(
        [2.0**k * np.exp(0.6) for k in range(5)], rel=1e-14
    )
    by_number = jax.grad(lambda a: derivatives(lambda x: a * x**3, 2.0, 2)[2])(1.5)
    assert float(by_number) == 12.0

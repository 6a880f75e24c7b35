"""The translation of the loop to C, as text."""

import jax
import jax.numpy as jnp
import pytest

from experiments.benchmarks.in_c import Translation


def test_each_expression_stands_once():
    @jax.jit
    def f(x, y):
        longest = jnp.maximum(x * x, y)
        return jnp.sqrt(x * x + longest), jnp.where(y > 2.0, -x, y**-2)

    closed = jax.make_jaxpr(f)(1.0, 3.0)
    lines = Translation()
    assert lines.of(closed.jaxpr, closed.consts, ["x", "y"]) == ["v3", "v7"]
    assert lines.lines == [
        "const V v0 = x * x;",
        "const V v1 = v0 > y ? v0 : y;",
        "const V v2 = v0 + v1;",
        "const V v3 = c_sqrt(v2);",
        "const M v4 = y > C(2.0);",
        "const V v5 = -x;",
        "const V v6 = C(1) / (y * y);",
        "const V v7 = v4 ? v5 : v6;",
    ]


def test_what_has_no_translation_is_named():
    closed = jax.make_jaxpr(jnp.arctan2)(1.0, 3.0)
    with pytest.raises(NotImplementedError, match="atan2 in C"):
        Translation().of(closed.jaxpr, closed.consts, ["x", "y"])

"""A loop on vectors does what the loop on scalars does, and packs only what is read."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.loop.form import Packed, Scalars, Vectors
from coopmm_jax.loop.integrate import rk4_step
from coopmm_jax.loop.rollout import Observer, Plan, rollout
from coopmm_jax.loop.state import Signals
from coopmm_jax.parameters import Parameters, Structure


class Spring(NamedTuple):
    """A state of nested scalars."""

    at: tuple[float, float]
    speed: float


CONSTANTS = ({"stiffness": 3.0}, (0.1, 0.2))
START = Spring((1.0, -0.5), 0.3)


def spring_rates(constants, t, state):
    """Rates, and signals of which only the first is read."""
    stiffness, (damping, push) = constants[0]["stiffness"], constants[1]
    force = -stiffness * sum(state.at) - damping * state.speed + push * t
    idle = (jnp.exp(force), state.speed)
    signals = Signals(
        **dict.fromkeys(Signals._fields, ()) | {"constraint_force": (force,), "computed": {"sigma": idle}}
    )
    return Spring((state.speed, 2.0 * state.speed), force), signals


def first_signal(signals):
    return signals.constraint_force[0] ** 2


def one_step(form, constants):
    """State after one step, and the signals before it."""
    start = form.pack(jax.tree.map(jnp.asarray, START))
    field = partial(form.field(spring_rates), tuple(map(form.pack, constants)))
    return form.unpack(rk4_step(field, 0.7, 0.1, start))


@pytest.fixture
def vectors():
    return Vectors(float, first_signal)


def test_vectors_do_what_scalars_do(vectors):
    on_scalars, on_vectors = one_step(Scalars(), CONSTANTS), one_step(vectors, CONSTANTS)
    np.testing.assert_allclose(jax.tree.leaves(on_vectors[0]), jax.tree.leaves(on_scalars[0]), rtol=4e-16)
    (force,), (expected,) = (signals.constraint_force for _, signals in (on_vectors, on_scalars))
    assert float(force) == pytest.approx(float(expected), rel=4e-16)


def test_gradients_agree(vectors):
    def cost(constants, form):
        state, signals = one_step(form, constants)
        return first_signal(signals) + sum(x**2 for x in (*state.at, state.speed))

    on_scalars, on_vectors = (jax.grad(cost)(CONSTANTS, form) for form in (Scalars(), vectors))
    np.testing.assert_allclose(jax.tree.leaves(on_vectors), jax.tree.leaves(on_scalars), rtol=1e-15)


def test_only_what_is_read_is_packed(vectors):
    _, signals = spring_rates(CONSTANTS, 0.7, START)
    packed = vectors.pack(signals)
    assert packed.values.shape == (1,)
    back = vectors.unpack(packed)
    assert float(back.constraint_force[0]) == pytest.approx(float(signals.constraint_force[0]), rel=1e-15)
    assert [float(x) for x in back.computed["sigma"]] == [0.0, 0.0]


def test_arrays_stay_apart_and_keep_their_shape():
    tree = {"scalar": jnp.float64(2.0), "line": jnp.arange(6.0).reshape(3, 2), "count": jnp.int32(3)}
    packed = Packed.of(tree, float)
    assert packed.values.tolist() == [3.0, 2.0]
    back = packed.unpack()
    assert back["line"] is tree["line"]
    assert (back["count"].dtype, int(back["count"]), float(back["scalar"])) == (jnp.int32, 3, 2.0)


def test_totals_keep_their_types(paper_run):
    """An observer may count and remember: on vectors, too, its total is of whole numbers and flags."""

    def update(total, t, signals):
        count, ever, largest = total
        return count + 1, ever | (t > 1.5e-3), jnp.maximum(largest, jnp.abs(signals.computed["sigma"][0]))

    observer = Observer((jnp.int32(0), jnp.asarray(False), jnp.zeros(())), update)
    plan = Plan(1, 4, packed=True)
    packed = jax.jit(lambda: rollout(Structure(), Parameters(), 1e-3, 3, plan, observer).total)()
    assert [x.dtype for x in packed] == [jnp.int32, bool, float]
    assert (int(packed[0]), bool(packed[1])) == (4, True)
    largest = np.abs(paper_run.signals.computed["sigma"][0][:4]).max()
    assert float(packed[2]) == pytest.approx(largest, rel=1e-15)

"""RK4 against closed forms, and what checkpoints change (memory) and leave alone (every bit of the result)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.loop.integrate import rk4_step, scan_segments


def field(t, state):
    """x = exp(sin t) and y = 1 / (1 + t), from x(0) = y(0) = 1; the signal is x + y."""
    return {"x": state["x"] * jnp.cos(t), "y": -(state["y"] ** 2)}, state["x"] + state["y"]


def solve(steps, horizon=1.5):
    step = horizon / steps
    start = {"x": jnp.ones(()), "y": jnp.ones(())}
    end, *_ = scan_segments(lambda x, i: (rk4_step(field, i * step, step, x)[0], ((), ())), start, 1, steps, False)
    return np.array([end["x"] - np.exp(np.sin(horizon)), end["y"] - 1 / (1 + horizon)])


def test_order_four():
    steps = np.array([20, 40, 80, 160])
    errors = np.abs([solve(n) for n in steps.tolist()])
    for error in errors.T:
        assert np.polyfit(np.log(steps), np.log(error), 1)[0] == pytest.approx(-4, abs=0.1)


def test_step_is_exact_for_cubics():
    state, _ = rk4_step(lambda t, x: (4 * t**3 - 3 * t**2, x), 1.0, 0.7, jnp.ones(()))
    assert float(state) == pytest.approx(1 + (1.7**4 - 1) - (1.7**3 - 1), rel=1e-15)


def test_signals_are_those_at_the_start_of_the_step():
    state = {"x": jnp.array(2.0), "y": jnp.array(3.0)}
    assert rk4_step(field, 0.3, 0.1, state)[1] == field(0.3, state)[1] == 5.0


@pytest.mark.parametrize("checkpoint", [False, True])
def test_what_is_given_ahead_reaches_each_step_with_its_slope(checkpoint):
    """Steps add rate * i: after i of them rate * i (i - 1) / 2."""

    def totals(rate):
        def ahead(first, steps):
            return rate * (first + jnp.arange(steps))

        return scan_segments(lambda total, i, given: (total + given, ((), total)), 0.0, 30, 7, checkpoint, ahead)[-1]

    i = np.arange(30 * 7)
    np.testing.assert_array_equal(totals(2.0), i * (i - 1))
    np.testing.assert_array_equal(jax.jacrev(lambda rate: jnp.sum(totals(rate)))(2.0), np.sum(i * (i - 1) / 2))


@pytest.mark.parametrize("checkpoint", [False, True])
def test_segments_report_their_first_step(checkpoint):
    def advance(total, i):
        return total + i, ((i, total), 2 * i)

    total, (indices, totals), doubled = scan_segments(advance, jnp.int32(0), 3, 4, checkpoint)
    assert total == sum(range(12))
    assert indices.tolist() == [0, 4, 8]
    assert totals.tolist() == [0, 6, 28]
    assert doubled.tolist() == list(range(0, 24, 2))


def final(x, checkpoint):
    def advance(state, i):
        state, _ = rk4_step(lambda t, s: (x * jnp.cos(t) * jnp.sin(s), None), i * 0.01, 0.01, state)
        return state, ((), ())

    return scan_segments(advance, jnp.ones(()), 20, 10, checkpoint)[0]


def test_checkpoints_change_no_bit_of_value_or_gradient():
    plain, kept = (jax.jit(jax.value_and_grad(lambda x, c=c: final(x, c)))(1.3) for c in (False, True))
    assert plain == kept
    assert plain[1] != 0


def test_checkpoints_keep_the_state_of_each_segment_only():
    def kept(checkpoint):
        """Number of values that the reverse pass is handed."""
        pull = jax.vjp(lambda x: final(x, checkpoint), 1.3)[1]
        return sum(np.size(leaf) for leaf in jax.tree.leaves(pull))

    assert kept(True) < 5 * 20
    assert kept(False) > 20 * 10

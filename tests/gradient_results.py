"""Gradients of a 20 s cost three ways, for test_gradients.py."""

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.control.reference import desired_motion
from coopmm_jax.loop.rollout import Observer, Plan, rollout
from coopmm_jax.parameters import Gains, Parameters, Structure

STEP, STEPS = 1e-3, 20_000
PAPER = Parameters(gains=Gains(delta_floor=0.01))
NAMES = ("K_sigma", "gamma", "K_lambda", "K_I")
RELATIVE_STEP = 1e-3  # of central differences: truncation and rounding are both near 1e-7 there


def sample_cost(total, t, signals):
    """Integral of squared force errors [N^2] and tracking errors, weighted so that neither drowns the other."""
    cost = 0.01 * sum(e**2 for e in signals.force_error)
    for p, d in zip(signals.position, desired_motion(PAPER.reference, t), strict=True):
        errors = (p.z1 - d.z1, p.z2 - d.z2, p.z3 - d.z3, p.a1 - d.arm[0])
        cost = cost + 100.0 * sum(e**2 for e in errors)
    return total + STEP * cost


def cost(gains, plan):
    """Cost of the paper's run under ``gains``, a mapping of NAMES."""
    parameters = PAPER._replace(gains=PAPER.gains._replace(**gains))
    observer = Observer(jnp.zeros(()), sample_cost)
    return rollout(Structure(), parameters, STEP, STEPS, plan, observer).total


def flat(gains):
    return np.array(jax.tree.leaves(gains), dtype=float).tolist()


def central_differences(function, gains, relative_step=RELATIVE_STEP):
    leaves, tree = jax.tree.flatten(gains)
    slopes = []
    for i, leaf in enumerate(leaves):
        step = relative_step * leaf
        ahead, behind = (
            float(function(jax.tree.unflatten(tree, [*leaves[:i], leaf + sign * step, *leaves[i + 1 :]])))
            for sign in (1, -1)
        )
        slopes.append((ahead - behind) / (2 * step))
    return slopes


def results():
    """Value, reverse, forward, central (19 numbers each, NAMES sorted) and what the reverse pass needs [B]."""
    gains = {name: tuple(map(float, getattr(PAPER.gains, name))) for name in NAMES}
    plain, checkpointed = Plan.batch(STEPS, 1000), Plan.gradient(STEPS)
    reverse = jax.jit(jax.value_and_grad(lambda x: cost(x, checkpointed))).lower(gains).compile()
    checkpointed_value, gradient = reverse(gains)
    function = jax.jit(lambda x: cost(x, plain))
    return {
        "value": float(function(gains)),
        "checkpointed_value": float(checkpointed_value),
        "reverse": flat(gradient),
        "forward": flat(jax.jit(jax.jacfwd(lambda x: cost(x, plain)))(gains)),
        "central": central_differences(function, gains),
        "reverse_bytes": reverse.memory_analysis().temp_size_in_bytes,
    }

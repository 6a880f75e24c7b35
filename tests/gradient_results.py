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


def moved(gains, relative_step):
    """For each of ``gains`` the step, and gains with that one moved ahead and behind."""
    leaves, tree = jax.tree.flatten(gains)
    for i, leaf in enumerate(leaves):
        step = relative_step * leaf
        yield step, *(jax.tree.unflatten(tree, [*leaves[:i], leaf + d, *leaves[i + 1 :]]) for d in (step, -step))


def central_differences(function, gains, relative_step=RELATIVE_STEP):
    return [
        (float(function(ahead)) - float(function(behind))) / (2 * step)
        for step, ahead, behind in moved(gains, relative_step)
    ]


def by_forward_mode(function):
    """Value of a function of ``gains`` and its slope along a direction, compiled once for every direction and place.

    In a quarter of the time that reverse mode takes; further arguments pass through.
    """
    return jax.jit(lambda gains, along, *rest: jax.jvp(lambda x: function(x, *rest), (gains,), (along,)))


def forward_slopes(along, gains, *rest):
    """Slopes by each of ``gains`` of a function compiled by ``by_forward_mode``, in the order of ``flat``."""
    leaves, tree = jax.tree.flatten(gains)
    units = np.eye(len(leaves)).tolist()
    return [jax.tree.map(float, along(gains, jax.tree.unflatten(tree, unit), *rest)[1]) for unit in units]


def results():
    """Value, reverse, central (19 numbers each, NAMES sorted), and what the reverse pass needs [B].

    Also the slope in forward mode along 1 / reverse, in which every gain has the same share.
    """
    gains = {name: tuple(map(float, getattr(PAPER.gains, name))) for name in NAMES}
    plain, checkpointed = Plan.batch(STEPS, 1000), Plan.gradient(STEPS)
    reverse = jax.jit(jax.value_and_grad(lambda x: cost(x, checkpointed))).lower(gains).compile()
    checkpointed_value, gradient = reverse(gains)
    value, along = by_forward_mode(lambda x: cost(x, plain))(gains, jax.tree.map(lambda g: 1.0 / g, gradient))
    steps, *around = zip(*moved(gains, RELATIVE_STEP), strict=True)
    batch = jax.tree.map(lambda *x: np.array(x), *around[0], *around[1])
    ahead, behind = np.split(np.array(jax.jit(jax.vmap(lambda x: cost(x, plain)))(batch)), 2)
    return {
        "value": float(value),
        "checkpointed_value": float(checkpointed_value),
        "reverse": flat(gradient),
        "forward_share": float(along) / len(steps),
        "central": (ahead - behind) / (2.0 * np.array(steps)),
        "reverse_bytes": reverse.memory_analysis().temp_size_in_bytes,
    }

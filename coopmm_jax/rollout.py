"""One rollout as a pure function of its parameters: put it into your own jit, vmap and grad.

>>> import jax
>>> from coopmm_jax.parameters import Parameters, Structure
>>> final = jax.jit(lambda p: rollout(Structure(), p, 1e-3, 2, Plan(1, 3)).state)(Parameters())
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax import coupling, robot
from coopmm_jax.closed_loop import Signals, State, closed_loop
from coopmm_jax.components import Scalar, plus
from coopmm_jax.control.motion import Memory
from coopmm_jax.integrate import rk4_step, scan_segments
from coopmm_jax.model import Model, build_model
from coopmm_jax.packed import Packed
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.plant import plant_kinematics
from coopmm_jax.sampled_loop import initial_devices, sampled_step
from coopmm_jax.status import Health, Status, judge

# Newton's steps for the start: from the paper's printed angles six reach 1e-15; the rest is for distant starts.
_NEWTON_STEPS = 25
_START_TOLERANCE = 1e-9  # [m]


class Plan(NamedTuple):
    """Static shape of a rollout: segments of a fixed number of steps, so that the horizon itself can be traced.

    One report is kept per segment (its first step), and with ``checkpoint`` one state for the reverse pass. ``packed``
    is for a rollout by itself: the ideal loop then carries its state and model as two vectors instead of a buffer for
    each of two hundred scalars, runs a seventh faster and compiles in three quarters of the time. Under vmap entries of
    these vectors would lie apart, and a gradient would pad each of them: there it costs more than it gains.
    """

    segments: int
    length: int
    checkpoint: bool = False
    packed: bool = False

    @classmethod
    def covering(cls, steps: int, length: int = 1, checkpoint: bool = False, packed: bool = False) -> Plan:
        """The shortest plan whose samples include step 0 and step ``steps``."""
        return cls(-(-(steps + 1) // length), length, checkpoint, packed)


class Observer(NamedTuple):
    """What to accumulate along a rollout: a start value and how one sample adds to it."""

    start: Any
    update: Callable[[Any, Scalar, Signals], Any]  # (total, t, signals) -> total


class Rollout(NamedTuple):
    """Result of one rollout."""

    state: State  # at the end, or the last good one
    total: Any  # of the observer
    health: Health
    record: Any  # (t, signals) at each segment's start, stacked; None unless recorded


def as_scalars(tree: Any, dtype: Any) -> Any:
    """A pytree with every leaf an array of one floating dtype, without disturbing batch axes."""
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), tree)


def initial_state(structure: Structure, model: Model, parameters: Parameters) -> tuple[State, Scalar, tuple]:
    """Robots at rest on the constraints: Newton's iteration on the dependent joints from ``parameters.start``.

    Returns:
        The state, the largest remaining |phi| [m], and the determinants of J_dep's blocks.
    """
    part = coupling.partition(structure.rows)
    n = sum(map(len, part.independent))
    zero = parameters.plant.gravity * 0.0
    at_rest = (zero,) * n

    def solve(position: tuple) -> coupling.Kinematics:
        return plant_kinematics(structure, model, zero, position, at_rest)

    def newton(position: tuple, _: None) -> tuple[tuple, None]:
        k = solve(position)
        change = coupling.dependent_solution(k.reduction, k.reduction.rows.phi)
        return tuple(robot.Position(*p[:3], *plus(p[3:], c[2:])) for p, c in zip(position, change, strict=True)), None

    start = tuple(map(robot.chained, parameters.start))
    position, _ = jax.lax.scan(newton, start, None, length=_NEWTON_STEPS)
    reduction = solve(position).reduction
    residual = jnp.abs(reduction.rows.phi[0])
    for phi in reduction.rows.phi[1:]:
        residual = jnp.maximum(residual, jnp.abs(phi))
    memory = Memory((zero,) * (n - 4), (zero, zero), parameters.gains.c_hat0, (zero,) * len(structure.rows))
    state = State(position, at_rest, memory, initial_devices(structure, zero))
    return state, residual, reduction.determinants


def rollout(
    structure: Structure,
    parameters: Parameters,
    step: Scalar,
    steps: Scalar,
    plan: Plan,
    observer: Observer | None = None,
    record: bool = False,
) -> Rollout:
    """Integrate the closed loop from its start by RK4.

    Args:
        structure, plan, observer.update, record: static. parameters: pytree of scalars.
        step: integration step, or control period where the controller is sampled [s].
        steps: number of them, at most what ``plan`` covers; may be traced.
        observer: accumulated at the samples 0..steps, both ends included. record: keep (t, signals) of each segment.

    Returns:
        ``Rollout``; after a failure the state, totals and records stay at their last good values.
    """
    dtype = jnp.result_type(float)
    parameters, step = as_scalars(parameters, dtype), jnp.asarray(step, dtype)
    model = build_model(parameters)
    state, residual, determinants = initial_state(structure, model, parameters)
    reachable = residual < max(_START_TOLERANCE, 30.0 * float(jnp.finfo(dtype).eps))
    health = Health(jnp.where(reachable, Status.OK.value, Status.UNREACHABLE.value).astype(jnp.int32), jnp.int32(0))

    field = functools.partial(closed_loop, structure, model)
    packed = plan.packed and not structure.substeps
    if packed:
        field, state = _packed_field(structure, model, state, dtype)

    def advance(carry: tuple, i: Scalar) -> tuple[tuple, Any]:
        state, total, health = carry
        t = i.astype(dtype) * step
        if structure.substeps:
            proposed, signals = sampled_step(structure, model, i, t, step, state)
        else:
            proposed, signals = rk4_step(field, t, step, state)
        running = (health.status == 0) & (i <= steps)  # what the plan has room for beyond the horizon cannot fail
        reached = proposed.unpack() if packed else proposed
        status = jnp.where(running, judge(reached, signals, determinants), health.status)
        failed = (status != 0) & (health.status == 0)
        sampled = (status == 0) & (i <= steps)
        if observer is not None:
            total = _choose(sampled, observer.update(total, t, signals), total)
        state = _choose((status == 0) & (i < steps), proposed, state)
        health = Health(status, jnp.where(failed, i, health.step))
        return (state, total, health), Packed.of((t, signals), dtype) if record else None

    carry = (state, observer.start if observer is not None else None, health)
    (state, total, health), reports = scan_segments(advance, carry, plan.segments, plan.length, plan.checkpoint)
    state = state.unpack() if packed else state
    return Rollout(state, total, health, reports.unpack() if record else None)


def _packed_field(structure: Structure, model: Model, state: State, dtype: Any) -> tuple[Callable, Packed]:
    """``closed_loop`` and its first state, with state and model as one vector each.

    The barrier ties the reading to the stage: otherwise XLA reads ahead of the loop and carries every scalar after all.
    """
    constants = Packed.of(model, dtype)

    def field(t: Scalar, at: Packed) -> tuple[Packed, Signals]:
        read, t = jax.lax.optimization_barrier((constants, t))
        rates, signals = closed_loop(structure, read.unpack(), t, at.unpack())
        return Packed.of(rates, dtype), signals

    return field, Packed.of(state, dtype)


def _choose(condition: Scalar, new: Any, old: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)

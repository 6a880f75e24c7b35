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

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.form import Form, Packed, Scalars, Vectors
from coopmm_jax.loop.health import Health, judge
from coopmm_jax.loop.integrate import recomputed, rk4_step, scan_segments
from coopmm_jax.loop.sampled_loop import sampled_step
from coopmm_jax.loop.start import initial_state
from coopmm_jax.loop.state import Signals, State
from coopmm_jax.mechanics.model import Model, build_model
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.status import Status

_START_TOLERANCE = 1e-9  # [m]


class Plan(NamedTuple):
    """Static shape of a rollout: segments of a fixed number of steps, so that the horizon itself can be traced.

    One report is kept per segment (its first step), and with ``checkpoint`` one state for the reverse pass, which else
    keeps 1.4 kB of each step. ``packed`` is for a rollout by itself and for every gradient (``loop_form``).
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
    """What to accumulate along a rollout: a start value, a pytree of scalars, and how one sample adds to it."""

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

    form = Scalars()
    if plan.packed:
        form = Vectors(dtype, functools.partial(_all_that_is_read, state, determinants, observer, record))
    constants = form.pack_each(model)
    settle = recomputed(functools.partial(_settle, form, observer, steps))  # keeps the inputs, each one vector

    def advance(carry: tuple, i: Scalar) -> tuple[tuple, Any]:
        state, total, health = carry
        t = i.astype(dtype) * step
        proposed, signals = _step(structure, constants, form, i, t, step, state)
        running = (health.status == 0) & (i <= steps)  # what the plan has room for beyond the horizon cannot fail
        now = judge(form.unpack(proposed), form.unpack_read(signals), determinants)
        status = jnp.where(running, now, health.status)
        failed = (status != 0) & (health.status == 0)
        state, total = settle(status, i, t, (state, total), proposed, signals)
        report = Packed.of((t, form.unpack_read(signals)), dtype) if record else None
        return (state, total, Health(status, jnp.where(failed, i, health.step))), report

    carry = (form.pack(state), form.pack(observer.start) if observer else None, health)
    (state, total, health), reports = scan_segments(advance, carry, plan.segments, plan.length, plan.checkpoint)
    total = _total(form, observer, total) if observer else None
    return Rollout(form.unpack(state), total, health, reports.unpack() if record else None)


def _step(
    structure: Structure, constants: tuple, form: Form, i: Scalar, t: Scalar, step: Scalar, state: Any
) -> tuple[Any, Any]:
    """The state after step i and the signals before it, in the loop's form, as are the model's parts."""
    if structure.substeps:
        return sampled_step(structure, constants, form, i, t, step, state)

    def field(constants: tuple, t: Scalar, state: State) -> tuple[State, Signals]:
        return closed_loop(structure, Model(*constants), t, state)

    return rk4_step(form.field(field, constants, form.pack_read), t, step, state)


def _settle(
    form: Form,
    observer: Observer | None,
    steps: Scalar,
    status: Scalar,
    i: Scalar,
    t: Scalar,
    before: tuple[Any, Any],
    proposed: Any,
    signals: Any,
) -> tuple[Any, Any]:
    """State and total after step i: unchanged by a step that fails or lies beyond the horizon."""
    state, total = before
    if observer is not None:
        updated = observer.update(_total(form, observer, total), t, form.unpack_read(signals))
        total = _choose((status == 0) & (i <= steps), form.pack(updated), total)
    return _choose((status == 0) & (i < steps), proposed, state), total


def _total(form: Form, observer: Observer, carried: Any) -> Any:
    """The observer's total, counts and flags as what they were at the start."""
    return jax.tree.map(lambda x, start: x.astype(jnp.result_type(start)), form.unpack(carried), observer.start)


def _all_that_is_read(
    state: State, determinants: tuple[Scalar, ...], observer: Observer | None, record: bool, signals: Signals
) -> Any:
    """Everything that a step makes of its signals."""
    update = observer.update(observer.start, jnp.zeros_like(determinants[0]), signals) if observer else None
    return judge(state, signals, determinants), update, signals if record else None


def _choose(condition: Scalar, new: Any, old: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)

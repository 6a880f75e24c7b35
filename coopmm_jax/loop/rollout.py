"""One rollout as a pure function of its parameters: put it into your own jit, vmap and grad.

>>> import jax
>>> from coopmm_jax.parameters import Parameters, Structure
>>> final = jax.jit(lambda p: rollout(Structure(), p, 1e-3, 2, Plan.alone(2)).state)(Parameters())
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jax.typing import DTypeLike

from coopmm_jax.algebra.types import Bool, PyTree, Scalar
from coopmm_jax.errors import UserError
from coopmm_jax.loop.closed_loop import continuous_step
from coopmm_jax.loop.form import Form, Packed, Scalars, Vectors
from coopmm_jax.loop.health import Health, judge
from coopmm_jax.loop.integrate import recomputed, scan_segments
from coopmm_jax.loop.lookahead import aims_ahead
from coopmm_jax.loop.sampled_loop import sampled_step
from coopmm_jax.loop.start import Start, initial_state
from coopmm_jax.loop.state import Signals, State
from coopmm_jax.mechanics.model import Model, build_model
from coopmm_jax.parameters import Parameters, PathReference, Structure
from coopmm_jax.status import Status

_START_TOLERANCE = 1e-9  # [m]


class Plan(NamedTuple):
    """Static shape of a rollout: segments of a fixed number of steps, so that the horizon itself can be traced.

    One report is kept per segment (its first step), and with ``checkpoint`` one state for the reverse pass, which else
    keeps 1.4 kB of each step. ``alone``, ``batch`` and ``gradient`` choose the fastest form for their purpose.
    """

    segments: int
    length: int
    checkpoint: bool = False
    packed: bool = False  # carry vectors, see ``loop.form``

    @property
    def room(self) -> int:
        """The largest number of steps."""
        return self.segments * self.length - 1

    @classmethod
    def alone(cls, steps: int, length: int = 1) -> Plan:
        """For one rollout of at most ``steps`` steps.

        Args:
            steps: to have room for.
            length: steps from one report to the next.
        """
        return cls(_segments(steps, length), length, packed=True)

    @classmethod
    def batch(cls, steps: int, length: int = 1) -> Plan:
        """For a batch of rollouts (``jax.vmap``), arguments as ``alone``."""
        return cls(_segments(steps, length), length)

    @classmethod
    def gradient(cls, steps: int, length: int = 50, checkpoint: bool = True) -> Plan:
        """For gradients of one rollout or of a batch.

        Args:
            steps: to have room for.
            length: steps from one checkpoint to the next.
            checkpoint: keep one state per segment and compute the rest again; without, every step is kept, which
                compiles a third faster and takes 1.4 kB for each.
        """
        return cls(_segments(steps, length), length, checkpoint, packed=True)


def _segments(steps: int, length: int) -> int:
    """Segments whose samples include step 0 and step ``steps``."""
    return -(-(steps + 1) // length)


class Observer(NamedTuple):
    """Total to be gathered along a rollout: its start, a pytree of scalars, and the update by one sample."""

    start: PyTree
    update: Callable[[PyTree, Scalar, Signals], PyTree]  # (total, t, signals) -> total
    kept: Callable[[PyTree], PyTree] | None = None  # of the total after each sample: scalars that are to be kept


class Rollout(NamedTuple):
    """Result of one rollout."""

    state: State  # at the end, or the last good one
    total: PyTree  # of the observer
    health: Health
    record: PyTree  # (t, signals) at each segment's start, stacked; None unless recorded
    kept: PyTree = None  # what the observer keeps of every sample, stacked; after a failure the last good values


def as_scalars(tree: PyTree, dtype: DTypeLike) -> PyTree:
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
        structure: static choices.
        parameters: pytree of scalars.
        step: integration step, or control period where the controller is sampled [s].
        steps: number of them, at most as many as ``plan`` has room for; may be traced.
        plan: static.
        observer: accumulated at the samples 0..steps, both ends included; its ``update`` is static.
        record: keep (t, signals) at each segment's start; static.

    Returns:
        ``Rollout``; after a failure the state, totals and records stay at their last good values. Traced ``steps`` that
        the plan has no room for are a failure, ``Status.TOO_LONG``, before the first step.

    Raises:
        UserError: the plan has no room for so many steps.
    """
    if not isinstance(steps, Tracer) and steps > plan.room:
        raise UserError("steps", f"at most {plan.room}, which the plan has room for", steps)
    dtype = jnp.result_type(float)
    parameters, step = as_scalars(parameters, dtype), jnp.asarray(step, dtype)
    model = build_model(parameters)
    start = initial_state(structure, model, parameters)
    closed = start.residual < max(_START_TOLERANCE, 30.0 * float(jnp.finfo(dtype).eps))
    reachable = closed & (start.facing > 0.0)
    code = jnp.where(reachable, Status.OK.value, Status.UNREACHABLE.value)
    health = Health(jnp.where(steps > plan.room, Status.TOO_LONG.value, code).astype(jnp.int32), jnp.int32(0))

    reference = model.reference
    form = Vectors(dtype, functools.partial(_all_that_is_read, start, observer, record)) if plan.packed else Scalars()
    model = Model(*map(form.pack, model))  # its parts apart: a vector of all has a derivative as soon as one part has
    one_step = functools.partial(sampled_step if structure.substeps else continuous_step, structure, form, model)
    settle = recomputed(functools.partial(_settle, form, observer, steps))  # keeps the inputs, each one vector

    keep = observer.kept if observer else None

    def advance(carry: tuple, i: jax.Array, aims: Packed | None = None) -> tuple[tuple, tuple[PyTree, PyTree]]:
        state, total, health = carry
        t = i.astype(dtype) * step
        proposed, signals = one_step(i, t, step, state, aims)
        running = (health.status == 0) & (i <= steps)  # what the plan has room for beyond the horizon cannot fail
        now = judge(form.unpack(proposed), form.unpack(signals), start.determinants)
        status = jnp.where(running, now, health.status)
        failed = (status != 0) & (health.status == 0)
        state, total = settle(status, i, t, state, total, proposed, signals)
        report = Packed.of((t, form.unpack(signals)), dtype) if record else None
        kept = Packed.of(keep(form.unpack(total)), dtype) if keep else None
        return (state, total, Health(status, jnp.where(failed, i, health.step))), (report, kept)

    carry = (form.pack(start.state), form.pack(jax.tree.map(jnp.asarray, observer.start)) if observer else None, health)
    ahead = None  # a batch does without: what it does not vary is computed once for all elements
    if plan.packed and isinstance(reference, PathReference):
        ahead = aims_ahead(reference, step, dtype, structure.substeps > 0)
    carry, *stacked = scan_segments(advance, carry, plan.segments, plan.length, plan.checkpoint, ahead)
    (state, total, health), (reports, kept) = carry, stacked
    series = (reports.unpack() if record else None, kept.unpack() if keep else None)
    return Rollout(form.unpack(state), form.unpack(total), health, *series)


def _settle(
    form: Form,
    observer: Observer | None,
    steps: Scalar,
    status: Scalar,
    i: Scalar,
    t: Scalar,
    state: PyTree,
    total: PyTree,
    proposed: PyTree,
    signals: PyTree,
) -> tuple[PyTree, PyTree]:
    """State and total after step i: unchanged by a step that fails or lies beyond the horizon."""
    if observer is not None:
        before = form.unpack(total)
        after = observer.update(before, t, form.unpack(signals))
        after = jax.tree.map(lambda x, like: jnp.asarray(x, like.dtype), after, before)
        total = _choose((status == 0) & (i <= steps), form.pack(after), total)
    return _choose((status == 0) & (i < steps), proposed, state), total


def _all_that_is_read(start: Start, observer: Observer | None, record: bool, signals: Signals) -> PyTree:
    """Everything that a step makes of its signals."""
    update = observer.update(observer.start, jnp.zeros_like(start.residual), signals) if observer else None
    return judge(start.state, signals, start.determinants), update, signals if record else None


def _choose(condition: Bool, new: PyTree, old: PyTree) -> PyTree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)

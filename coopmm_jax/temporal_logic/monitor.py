"""Robustness of sentences while a rollout goes on: a number or two for each window instead of its samples.

That works exactly where a window is counted from the start of the run, and what stands in it speaks of one instant, or
of "always" or "eventually" to the end of the run. ``needs_samples`` names the other sentences: of those the samples are
kept, and ``temporal_logic/robustness.py`` looks at them afterwards.

A window that goes on beyond the run is cut at its end, and one whose conditions have windows themselves where those
would begin beyond it. The ends of windows are rounded to samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import jax.numpy as jnp

from coopmm_jax.algebra.types import Bool, Scalar
from coopmm_jax.temporal_logic.margins import EXACT, joined, margin
from coopmm_jax.temporal_logic.sentence import Formula, Logic, Temporal, is_pointwise, signals_of
from coopmm_jax.temporal_logic.signals import AFTERWARDS

Watched: TypeAlias = tuple[tuple[Scalar, ...], ...]  # what is known of each ``leaf`` of a sentence


def needs_samples(form: Formula) -> bool:
    """True if a sentence's robustness cannot be had from what ``watch`` keeps."""
    if any(name in AFTERWARDS for name in signals_of(form)):
        return True
    return not all(is_pointwise(leaf) or _is_running(leaf) for leaf in _leaves(form))


def _is_running(leaf: Temporal) -> bool:
    inner = leaf.operands[0]
    return all(map(is_pointwise, leaf.operands)) or (leaf.operator != "until" and _to_the_end(inner))


def _to_the_end(part: Any) -> bool:
    """True of always and eventually of one instant, to the end of the run."""
    return (
        isinstance(part, Temporal)
        and part.operator != "until"
        and part.end is None
        and all(map(is_pointwise, part.operands))
    )


def _leaves(form: Any) -> list[Any]:
    """Largest parts that speak of the first instant, or of a window that begins there."""
    if is_pointwise(form) or not isinstance(form, Logic):
        return [form]
    return [leaf for operand in form.operands for leaf in _leaves(operand)]


def unwatched(form: Formula, like: Scalar) -> Watched:
    """Knowledge of a sentence before the first sample.

    Args:
        form: of the sentence.
        like: scalar of the dtype.
    """
    return tuple(_start(leaf, like) for leaf in _leaves(form))


def _start(leaf: Any, like: Scalar) -> tuple[Scalar, ...]:
    worst = jnp.full_like(like, -jnp.inf)
    if is_pointwise(leaf):
        return (worst,)
    if leaf.operator == "until":
        return (-worst, worst)  # smallest margin of the first condition, best of the second so far
    return (-worst,) if leaf.operator == "always" else (worst,)


def watch(
    form: Formula, before: Watched, sample: Scalar, step: Scalar, signals: Mapping[str, Scalar], numbers: Any
) -> Watched:
    """Knowledge of a sentence after one more sample.

    Args:
        form: of the sentence.
        before: what was known.
        sample: number of the sample, from 0.
        step: from one sample to the next [s].
        signals: of the sample, by name.
        numbers: of the sentence (n,).
    """

    def after(leaf: Any, known: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        if is_pointwise(leaf):
            return (jnp.where(sample < 0.5, margin(leaf, signals, numbers), known[0]),)
        begin = samples_of(numbers[leaf.begin], step)
        end = jnp.inf if leaf.end is None else samples_of(numbers[leaf.end], step)
        if leaf.operator == "until":
            return _until(leaf, known, (sample >= begin) & (sample <= end), signals, numbers)
        inner = leaf.operands[0]
        if isinstance(inner, Temporal):
            later = samples_of(numbers[inner.begin], step)
            begin, end = begin + later, end + later
            if inner.operator != leaf.operator:  # of "eventually always" the last begin is the best
                return (_since(inner, known[0], sample, begin, end, signals, numbers),)
            inner, end = inner.operands[0], jnp.inf
        inside = (sample >= begin) & (sample <= end)
        now = margin(inner, signals, numbers)
        if leaf.operator == "always":
            return (jnp.where(inside, jnp.minimum(known[0], now), known[0]),)
        return (jnp.where(inside, jnp.maximum(known[0], now), known[0]),)

    return tuple(after(leaf, known) for leaf, known in zip(_leaves(form), before, strict=True))


def _since(
    inner: Temporal, known: Scalar, sample: Scalar, begin: Scalar, end: Scalar, signals: Any, numbers: Any
) -> Scalar:
    now = margin(inner.operands[0], signals, numbers)
    join = jnp.minimum if inner.operator == "always" else jnp.maximum
    return jnp.where(sample < begin, known, jnp.where(sample <= end, now, join(known, now)))


def _until(leaf: Temporal, known: tuple[Scalar, ...], inside: Bool, signals: Any, numbers: Any) -> tuple[Scalar, ...]:
    first, second = (margin(operand, signals, numbers) for operand in leaf.operands)
    held = jnp.minimum(known[0], first)
    return held, jnp.where(inside, jnp.maximum(known[1], jnp.minimum(held, second)), known[1])


def samples_of(instant: Scalar, step: Scalar) -> Scalar:
    """Number of samples in an instant [s], to the nearest one."""
    return jnp.round(instant / step)


def robustness_of(form: Formula, watched: Watched) -> Scalar:
    """Robustness of a sentence after the last sample, a scalar."""
    values = iter(watched)

    def of(part: Any) -> Scalar:
        if is_pointwise(part) or not isinstance(part, Logic):
            known = next(values)
            return known[-1]
        return joined(part, [of(operand) for operand in part.operands], EXACT)

    return of(form)

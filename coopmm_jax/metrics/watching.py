"""Sentences along a rollout: what is gathered of them in its scan, and their robustness at its end.

>>> import jax.numpy as jnp
>>> from coopmm_jax.metrics.grammar import read
>>> sentence = read("always contact_force >= 5")
>>> sentences = Sentences((("keeps_pressing", sentence.form),), (Numbers(sentence.numbers, sentence.scale),))
>>> names_kept(sentences, smoothly=False), names_kept(sentences, smoothly=True)
((), ('contact_force',))
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.types import Bool, Scalar
from coopmm_jax.metrics import monitor
from coopmm_jax.metrics.robustness import robustness
from coopmm_jax.metrics.sample import Sample
from coopmm_jax.metrics.sentence import Numbers, Sentences, signals_of, stand_in
from coopmm_jax.metrics.signal_values import signal_values


class Watching(NamedTuple):
    """Knowledge of all sentences so far."""

    watched: tuple[monitor.Watched, ...] = ()  # of each sentence; () of one whose samples are kept
    kept: Mapping[str, Scalar] = {}  # signals of the last sample, of which all samples are kept


def names_kept(sentences: Sentences, smoothly: bool) -> tuple[str, ...]:
    """Signals of which all samples are needed.

    Args:
        sentences: of the rollout.
        smoothly: whether the robustness of all is to be smooth.
    """
    needed = (form for _, form in sentences.forms if smoothly or monitor.needs_samples(form))
    return tuple(dict.fromkeys(name for form in needed for name in signals_of(form)))


def start(sentences: Sentences, smoothly: bool, like: Scalar) -> Watching:
    """Knowledge of all sentences before the first sample; ``like`` is a scalar of the dtype, else as ``names_kept``."""
    watched = (
        () if smoothly or monitor.needs_samples(form) else monitor.unwatched(form, like) for _, form in sentences.forms
    )
    return Watching(tuple(watched), {name: jnp.zeros_like(like) for name in names_kept(sentences, smoothly)})


def after(sentences: Sentences, before: Watching, count: Scalar, sample: Sample) -> Watching:
    """Knowledge of all sentences after one more sample, scalars.

    Args:
        sentences: of the rollout.
        before: what was known.
        count: samples before this one.
        sample: with the quantities of the metrics.
    """
    if not sentences.forms:
        return before
    running = [form for (_, form), known in zip(sentences.forms, before.watched, strict=True) if known]
    needed = dict.fromkeys((*before.kept, *(name for form in running for name in signals_of(form))))
    seen = signal_values(sample, needed)
    watched = (
        monitor.watch(form, known, count, sample.step, seen, numbers.values) if known else ()
        for (_, form), known, numbers in zip(sentences.forms, before.watched, sentences.numbers, strict=True)
    )
    return Watching(tuple(watched), {name: seen[name] for name in before.kept})


def finish(
    sentences: Sentences,
    at_end: Watching,
    kept: Any,
    step: Scalar,
    count: Scalar,
    survived: Scalar,
    complete: Bool,
    temperature: Scalar | None = None,
) -> dict[str, Scalar]:
    """Robustness by name, each in its sentence's unit; of a rollout that failed, a finite number below any other.

    Args:
        sentences: of the rollout.
        at_end: what was known after its last sample.
        kept: signals (N,) by name of which all samples were kept; None where there are none.
        step: from one sample to the next [s].
        count: samples of the rollout.
        survived: share of the horizon before a failure.
        complete: whether there was none.
        temperature: over how large a difference in units of a sentence's scale its extremes are smooth; left out, they
            are exact.
    """
    found = {}
    for (name, form), known, numbers in zip(sentences.forms, at_end.watched, sentences.numbers, strict=True):
        value = (
            monitor.robustness_of(form, known)
            if known
            else _from_samples(form, numbers, kept, step, count, temperature)
        )
        found[name] = jnp.where(complete, value, stand_in(survived) * numbers.scale)
    return found


def _from_samples(
    form: Any, numbers: Numbers, kept: Any, step: Scalar, count: Scalar, temperature: Scalar | None
) -> Scalar:
    unit = None if temperature is None else temperature * numbers.scale
    last = jnp.asarray(count - 1, jnp.int32)
    return robustness(form, {name: kept[name] for name in signals_of(form)}, numbers.values, step, last, unit)

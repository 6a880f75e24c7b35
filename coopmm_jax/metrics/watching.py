"""Sentences along a rollout: what is gathered of them in its scan, and their robustness at its end.

>>> import jax.numpy as jnp
>>> from coopmm_jax.temporal_logic.grammar import read
>>> sentence = read("always contact_force >= 5")
>>> sentences = Sentences((("keeps_pressing", sentence.form),), (Numbers(sentence.numbers, sentence.scale),))
>>> names_kept(sentences, smoothly=False), names_kept(sentences, smoothly=True)
((), ('contact_force',))
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Bool, PyTree, Scalar
from coopmm_jax.loop.start import initial_state
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.metrics.sample import Sample
from coopmm_jax.metrics.signal_values import signal_values
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.proof.margins import instants, margins, state_of
from coopmm_jax.proof.steps import check_loop
from coopmm_jax.temporal_logic import monitor
from coopmm_jax.temporal_logic.robustness import robustness
from coopmm_jax.temporal_logic.sentence import Numbers, Sentences, signals_of, stand_in
from coopmm_jax.temporal_logic.signals import AFTERWARDS


class Ran(NamedTuple):
    """Rollout that has ended."""

    structure: Structure
    parameters: Parameters
    step: Scalar  # from one sample to the next [s]
    samples: Scalar  # number of them
    survived: Scalar  # share of the horizon before a failure
    complete: Bool  # whether there was none

    @property
    def last(self) -> jax.Array:
        """Number of the last sample, a scalar."""
        return jnp.asarray(self.samples - 1, jnp.int32)


class Watching(NamedTuple):
    """Knowledge of all sentences so far."""

    watched: tuple[monitor.Watched, ...] = ()  # of each sentence; () of one whose samples are kept
    kept: Mapping[str, Scalar] = {}  # signals of the last sample, of which all samples are kept
    state: PyTree = ()  # of the loop at the last sample, where sentences speak of the proof


def names_kept(sentences: Sentences, smoothly: bool) -> tuple[str, ...]:
    """Signals of which all samples are needed, but those of the proof.

    Args:
        sentences: of the rollout.
        smoothly: whether the robustness of all is to be smooth.
    """
    needed = (form for _, form in sentences.forms if smoothly or monitor.needs_samples(form))
    return tuple(dict.fromkeys(name for form in needed for name in signals_of(form) if name not in AFTERWARDS))


def start(sentences: Sentences, smoothly: bool, structure: Structure, parameters: Parameters) -> Watching:
    """Knowledge of all sentences before the first sample, scalars.

    Args:
        sentences: of the rollout.
        smoothly: whether the robustness of all is to be smooth.
        structure: static choices.
        parameters: of the rollout.

    Raises:
        UserError: sentences speak of the proof, which is not about this loop.
    """
    like = jnp.zeros((), jnp.result_type(float))
    watched = (
        () if smoothly or monitor.needs_samples(form) else monitor.unwatched(form, like) for _, form in sentences.forms
    )
    kept, state = {name: jnp.zeros_like(like) for name in names_kept(sentences, smoothly)}, ()
    if _speak_of_the_proof(sentences):
        check_loop(structure, parameters)
        first = jax.eval_shape(lambda: initial_state(structure, build_model(parameters), parameters).state)
        state = jax.tree.map(lambda x: jnp.zeros_like(like), first)
    return Watching(tuple(watched), kept, state)


def _speak_of_the_proof(sentences: Sentences) -> bool:
    return any(name in AFTERWARDS for _, form in sentences.forms for name in signals_of(form))


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
    state = state_of(sample.structure, sample.parameters, sample.signals) if before.state else ()
    return Watching(tuple(watched), {name: seen[name] for name in before.kept}, state)


def finish(
    sentences: Sentences,
    at_end: Watching,
    kept: Any,
    ran: Ran,
    temperature: Scalar | None = None,
) -> dict[str, Scalar]:
    """Robustness by name, each in its sentence's unit; of a rollout that failed, a finite number below any other.

    Args:
        sentences: of the rollout.
        at_end: what was known after its last sample.
        kept: what was kept of all samples (N,), signals and states; None where nothing was.
        ran: the rollout.
        temperature: over how large a difference in units of a sentence's scale its extremes are smooth; left out, they
            are exact.
    """
    found, signals = {}, signals_kept(at_end, kept, ran)
    for (name, form), known, numbers in zip(sentences.forms, at_end.watched, sentences.numbers, strict=True):
        value = monitor.robustness_of(form, known) if known else _from_samples(form, numbers, signals, ran, temperature)
        found[name] = jnp.where(ran.complete, value, stand_in(ran.survived) * numbers.scale)
    return found


def signals_kept(at_end: Watching, kept: Any, ran: Ran) -> dict[str, jax.Array]:
    """Signals (N,) that were kept, and those of the proof, each of which stays until the next instant looked at."""
    if kept is None:
        return {}
    signals, states = kept
    if not at_end.state:
        return signals
    at, stride = instants(ran.last)
    found = margins(ran.structure, ran.parameters, at * ran.step, jax.tree.map(lambda x: x[at], states))
    held = jnp.minimum(jnp.arange(len(jax.tree.leaves(states)[0])) // stride, len(at) - 1)
    return signals | {name: values[held] for name, values in found.items()}


def _from_samples(form: Any, numbers: Numbers, signals: Any, ran: Ran, temperature: Scalar | None) -> Scalar:
    unit = None if temperature is None else temperature * numbers.scale
    wanted = {name: signals[name] for name in signals_of(form)}
    return robustness(form, wanted, numbers.values, ran.step, ran.last, unit)

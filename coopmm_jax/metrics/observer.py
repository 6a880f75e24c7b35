"""Metrics of one rollout, accumulated inside its scan: a few dozen scalars instead of a trajectory.

``observer`` goes into ``rollout``, ``finish`` turns the gathered sums into the numbers that ``METRICS`` in
``metrics/table.py`` describes. Both work under jit, vmap and grad, so a sweep keeps one row of metrics per rollout.

>>> from coopmm_jax.parameters import Parameters, Structure
>>> gather = observer(Structure(), Parameters(), duration=20.0, step=1e-3)
>>> total = gather.start  # of a rollout that failed at once; otherwise rollout(..., observer=gather).total
>>> float(finish(total, duration=20.0, step=1e-3)["force_min"])
nan
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.types import Bool, PyTree, Scalar
from coopmm_jax.kinds.metrics import of_plugins
from coopmm_jax.kinds.probe import number_of
from coopmm_jax.loop.rollout import Observer
from coopmm_jax.loop.state import Signals
from coopmm_jax.metrics import watching
from coopmm_jax.metrics.sample import OF_ACTUATORS, Past, Sample, no_past, past_after, quantities, root
from coopmm_jax.metrics.table import LATE, LATE_FROM, METRICS, WHOLE, Metric
from coopmm_jax.metrics.watching import Watching
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.temporal_logic.sentence import NO_SENTENCES, Sentences


class Accumulation(NamedTuple):
    """Gathering of a quantity along a rollout: from where, and by what."""

    start: float  # also what a sample outside the window adds
    join: Callable[[Scalar, Scalar], Scalar]  # (so far, of this sample)


_ACCUMULATIONS = {
    "sum": Accumulation(0.0, jnp.add),
    "sum_after_first": Accumulation(0.0, jnp.add),  # of changes since the sample before, which has to be in the window
    "max": Accumulation(-jnp.inf, jnp.maximum),
    "min": Accumulation(jnp.inf, jnp.minimum),
    "last": Accumulation(0.0, lambda before, now: now),
}


class Extent(NamedTuple):
    """Numbers that turn an accumulated quantity into a metric."""

    values: Scalar  # samples of the window, times entries of the quantity
    step: Scalar  # [s]
    duration: Scalar  # [s]
    complete: Bool  # whether the rollout reached its horizon


class Reduction(NamedTuple):
    """Way from a quantity's samples to a metric."""

    accumulation: str  # of _ACCUMULATIONS
    finish: Callable[[Scalar, Extent], Scalar]  # (accumulated, extent) -> metric


REDUCTIONS = {
    "max": Reduction("max", lambda gathered, extent: gathered),
    "min": Reduction("min", lambda gathered, extent: gathered),
    "mean": Reduction("sum", lambda gathered, extent: gathered / extent.values),
    "count": Reduction("sum", lambda gathered, extent: gathered),
    "time": Reduction("sum", lambda gathered, extent: gathered * extent.step),
    "root_mean": Reduction("sum", lambda gathered, extent: root(gathered / extent.values)),
    "root_max": Reduction("max", lambda gathered, extent: root(gathered)),
    "last": Reduction("last", lambda gathered, extent: gathered),
    "root_last": Reduction("last", lambda gathered, extent: root(gathered)),
    "variation": Reduction("sum_after_first", lambda gathered, extent: gathered),
    "time_if_complete": Reduction(
        "max", lambda gathered, extent: jnp.where(extent.complete, jnp.minimum(gathered, extent.duration), jnp.nan)
    ),
}


class Gathered(NamedTuple):
    """Name of one scalar that is gathered; metrics that need the same one share it."""

    quantity: str
    accumulation: str
    window: str

    @classmethod
    def of(cls, metric: Metric) -> Gathered:
        """Scalar that a metric needs."""
        return cls(metric.quantity, REDUCTIONS[metric.reduction].accumulation, metric.window)


class Total(NamedTuple):
    """Everything that is gathered along a rollout."""

    samples: Mapping[str, Scalar]  # of each window
    gathered: Mapping[Gathered, Scalar]
    past: Past
    watching: Watching = Watching()


def observer(
    structure: Structure,
    parameters: Parameters,
    duration: Scalar,
    step: Scalar,
    sentences: Sentences = NO_SENTENCES,
    smoothly: bool = False,
    names: Sequence[str] | None = None,
) -> Observer:
    """Observer that gathers along a ``rollout`` what ``finish`` needs; all arguments that are numbers may be traced.

    Args:
        structure: static choices.
        parameters: of the rollout.
        duration: its horizon [s].
        step: its step [s].
        sentences: whose robustness is wanted; their forms are static.
        smoothly: whether it is wanted for gradients.
        names: of the metrics that are wanted; static, all if left out.
    """

    def update(total: Total, t: Scalar, signals: Signals) -> Total:
        now = past_after(total.past, total.samples[WHOLE] <= 0, signals)
        seen = quantities(structure, parameters, t, step, signals, total.past, now)
        sample = Sample(structure, parameters, t, step, signals, seen, {})
        added = {f"metric {name}": number_of(kind, "quantity", sample) for name, kind in of_plugins().items()}
        seen = seen | added
        late = t > LATE_FROM * duration - 0.5 * step
        inside = {WHOLE: True, LATE: late}
        gathered = {}
        for key, before in total.gathered.items():
            start, join = _ACCUMULATIONS[key.accumulation]
            counts = inside[key.window]
            if key.accumulation == "sum_after_first":
                counts = counts & (total.samples[key.window] > 0)
            gathered[key] = join(before, jnp.where(counts, seen[key.quantity], start))
        samples = {window: count + jnp.where(inside[window], 1.0, 0.0) for window, count in total.samples.items()}
        seen_so_far = watching.after(sentences, total.watching, total.samples[WHOLE], sample)
        return Total(samples, gathered, now, seen_so_far)

    start = _start(structure, watching.start(sentences, smoothly, structure, parameters), names)
    keeps = start.watching.kept or start.watching.state
    return Observer(start, update, (lambda total: (total.watching.kept, total.watching.state)) if keeps else None)


def finish(
    total: Total,
    duration: Scalar,
    step: Scalar,
    sentences: Sentences = NO_SENTENCES,
    kept: PyTree = None,
    loop: tuple[Structure, Parameters] = (Structure(), Parameters()),
    temperature: Scalar | None = None,
    names: Sequence[str] | None = None,
) -> dict[str, Scalar]:
    """Metrics by name, in the order of ``METRICS``, then the robustness of sentences in theirs.

    A metric is NaN where no sample was in its window.

    Args:
        total: gathered by ``observer``.
        duration: as given to it [s].
        step: as given to it [s].
        sentences: as given to it.
        kept: what the rollout kept of every sample.
        loop: static choices and parameters of the rollout, for sentences that speak of the proof.
        temperature: of the smooth robustness, in units of each sentence's scale; left out, it is exact.
        names: as given to it.
    """
    complete = (total.samples[WHOLE] - 0.5) * step > duration
    metrics = {}
    for name, metric in _wanted(names).items():
        samples = total.samples[metric.window]
        entries = len(total.past.torque) if metric.quantity in OF_ACTUATORS else 1
        values = entries * jnp.maximum(samples, 1.0)
        extent = Extent(values, step, duration, complete)
        value = REDUCTIONS[metric.reduction].finish(total.gathered[Gathered.of(metric)], extent)
        metrics[name] = jnp.where(samples > 0, value, jnp.nan)
    if not sentences.forms:
        return metrics
    count = total.samples[WHOLE]
    ran = watching.Ran(*loop, step, count, count * step / (duration + step), complete)
    return metrics | watching.finish(sentences, total.watching, kept, ran, temperature)


def _wanted(names: Sequence[str] | None) -> Mapping[str, Metric]:
    return METRICS if names is None else {name: METRICS[name] for name in names}


def _start(structure: Structure, at_start: Watching, names: Sequence[str] | None) -> Total:
    """Total of no sample."""
    zero = jnp.zeros((), jnp.result_type(float))
    needed = dict.fromkeys(map(Gathered.of, _wanted(names).values()))
    gathered = {key: zero + _ACCUMULATIONS[key.accumulation].start for key in needed}
    return Total({WHOLE: zero, LATE: zero}, gathered, no_past(structure), at_start)

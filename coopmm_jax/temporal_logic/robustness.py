"""Robustness of a sentence from all samples of a rollout: exactly for windows within windows, smoothly for gradients.

The value of every part is an array over the samples, the whole sentence's that of the first. A window's extreme is
joined from those of 1, 2, 4, ... samples, so that its length can be traced.

>>> from coopmm_jax.temporal_logic.grammar import read
>>> sentence = read("eventually[0, 2] always[0, 1] t >= 1")
>>> float(robustness(sentence.form, {"t": jnp.arange(6.0)}, sentence.numbers, step=1.0, last=5))
1.0
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.temporal_logic.margins import EXACT, Extremes, joined, margin, smooth
from coopmm_jax.temporal_logic.monitor import samples_of
from coopmm_jax.temporal_logic.sentence import Formula, Logic, Temporal, is_pointwise

_FAR = 1e30  # in the place of infinity, of which differences are none


class _Series(NamedTuple):
    """Samples of a rollout, and how they are looked at."""

    signals: Mapping[str, jax.Array]  # (N,) each
    numbers: Any  # (n,) of the sentence
    step: Scalar  # [s]
    last: Scalar  # number of the run's last sample, at most N - 1
    temperature: Scalar | None  # None: exactly
    length: int  # N

    @property
    def extremes(self) -> Extremes:
        """Extremes of two margins, exact or smooth."""
        return EXACT if self.temperature is None else smooth(self.temperature)

    def delay(self, slot: int) -> Scalar:
        """Samples that a window's end lies after the instant from which it counts; an integer, at most N."""
        return jnp.clip(samples_of(self.numbers[slot], self.step), 0, self.length).astype(jnp.int32)


def robustness(
    form: Formula,
    signals: Mapping[str, jax.Array],
    numbers: Any,
    step: Scalar,
    last: Scalar,
    temperature: Scalar | None = None,
) -> Scalar:
    """Robustness of a sentence over a rollout.

    Args:
        form: of the sentence.
        signals: (N,) by name, at the samples 0, 1, ...
        numbers: of the sentence (n,).
        step: from one sample to the next [s].
        last: number of the run's last sample, at most N - 1; those after it do not count.
        temperature: over how large a difference of margins their extremes are smooth, in the unit of the robustness;
            left out, they are exact. ``until`` always is.
    """
    count = len(next(iter(signals.values())))
    series = _Series(signals, numbers, step, last, temperature, count)
    return _at_start(form, series)


def _at_start(part: Any, series: _Series) -> Scalar:
    """Margin of a part at the first sample; an outermost window needs no other."""
    if isinstance(part, Logic) and not is_pointwise(part):
        return joined(part, [_at_start(each, series) for each in part.operands], series.extremes)
    if not isinstance(part, Temporal) or part.operator == "until":
        return _everywhere(part, series)[0]
    inside = _within(part.operands[0], series) & (jnp.arange(series.length) >= series.delay(part.begin))
    if part.end is not None:
        inside &= jnp.arange(series.length) <= series.delay(part.end)
    return _extreme(_signed(part, series), inside, series.temperature) * _sign(part)


def _extreme(x: jax.Array, inside: jax.Array, temperature: Scalar | None) -> Scalar:
    kept = jnp.where(inside, x, -_FAR)
    if temperature is None:
        return jnp.max(kept)
    return temperature * jax.scipy.special.logsumexp(kept / temperature)


def _everywhere(part: Any, series: _Series) -> jax.Array:
    """Margins of a part (N,), of which those before the end of the run less ``_reach`` count."""
    if is_pointwise(part):
        found = margin(part, series.signals, series.numbers, series.extremes)
        return jnp.broadcast_to(found, (series.length,))
    if isinstance(part, Logic):
        return joined(part, [_everywhere(each, series) for each in part.operands], series.extremes)
    if part.operator == "until":
        return _until(part, series)
    larger = series.extremes.larger
    x = jnp.where(_within(part.operands[0], series), _signed(part, series), -_FAR)
    begin = series.delay(part.begin)
    if part.end is None:
        return _shifted(_from_the_back(larger, x), begin) * _sign(part)
    return _sliding(x, begin, series.delay(part.end), larger) * _sign(part)


def _sign(part: Temporal) -> float:
    """-1 of always, which is eventually of the opposite."""
    return -1.0 if part.operator == "always" else 1.0


def _signed(part: Temporal, series: _Series) -> jax.Array:
    return _sign(part) * _everywhere(part.operands[0], series)


def _within(part: Any, series: _Series) -> jax.Array:
    """Samples (N,) at which every window of a part begins within the run."""
    return jnp.arange(series.length) <= series.last - _reach(part, series)


def _reach(part: Any, series: _Series) -> Scalar:
    inner = [_reach(each, series) for each in getattr(part, "operands", ()) if not is_pointwise(part)]
    most: Any = 0
    for each in inner:
        most = jnp.maximum(most, each)
    return most + series.delay(part.begin) if isinstance(part, Temporal) else most


def _from_the_back(join: Callable[..., Any], *series: jax.Array) -> jax.Array:
    """r = join(r of the next sample, x, ...) of each sample (N,), from -infinity after the last.

    One sample after another: the operators that join halves, as ``cummax`` has in its gradient, are written one into
    the other by XLA and take minutes to compile.
    """

    def step(later: jax.Array, now: tuple) -> tuple[jax.Array, jax.Array]:
        found = join(later, *now)
        return found, found

    return jax.lax.scan(step, jnp.full_like(series[0][0], -_FAR), series, reverse=True)[1]


def _sliding(x: jax.Array, begin: Scalar, end: Scalar, larger: Callable) -> jax.Array:
    """Largest of the samples begin to end after each (N,)."""
    length = jnp.asarray(end - begin + 1, jnp.int32)

    def joined_bit(bit: jax.Array, carry: tuple) -> tuple:
        found, block, start = carry  # block: largest of 1, 2, 4, ... samples from each on
        used = (length >> bit) & 1
        found = jax.lax.cond(used == 1, lambda: larger(found, _shifted(block, start)), lambda: found)
        return found, larger(block, _shifted(block, 1 << bit)), start + (used << bit)

    def unless_past(bit: jax.Array, carry: tuple) -> tuple:
        return jax.lax.cond(length >> bit > 0, joined_bit, lambda _, same: same, bit, carry)

    # A loop, as XLA would write its steps one into the other: two copies of each in the next, and so forth. It has the
    # steps of the longest window, since a loop of traced length has no gradient; most windows need few of them.
    found, _, _ = jax.lax.fori_loop(0, (len(x) + 1).bit_length(), unless_past, (jnp.full_like(x, -_FAR), x, begin))
    return found


def _shifted(x: jax.Array, by: Scalar) -> jax.Array:
    """x (N,) some samples later, filled up with what is smaller than anything."""
    longer = jnp.concatenate([x, jnp.full_like(x, -_FAR)])
    return jax.lax.dynamic_slice_in_dim(longer, jnp.minimum(by, len(x)), len(x))


def _until(part: Temporal, series: _Series) -> jax.Array:
    """Margins of a first condition that holds until a second does, by the identity of Donze, Ferrere and Maler.

    It holds until a second one does within a window [a, b] if that one does within it, the first one up to a, and from
    there on the same to the end of the run.
    """
    first, second = (_everywhere(each, series) for each in part.operands)
    second = jnp.where(jnp.arange(series.length) <= series.last - _inner_reach(part, series), second, -_FAR)
    begin = series.delay(part.begin)
    held = -_sliding(-first, jnp.zeros_like(begin), begin, jnp.maximum)
    found = jnp.minimum(held, _shifted(_from_the_back(_held_until, first, second), begin))
    if part.end is None:
        return found
    return jnp.minimum(found, _sliding(second, begin, series.delay(part.end), jnp.maximum))


def _inner_reach(part: Temporal, series: _Series) -> Scalar:
    most: Any = 0
    for each in part.operands:
        most = jnp.maximum(most, _reach(each, series))
    return most


def _held_until(later: Scalar, first: Scalar, second: Scalar) -> Scalar:
    """u = min(first, max(second, u of the next sample)), a scalar."""
    return jnp.minimum(first, jnp.maximum(second, later))

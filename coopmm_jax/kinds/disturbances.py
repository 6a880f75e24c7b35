"""Disturbances over time: a kind says how one goes, ``Disturbance`` how strong it is and what it acts on.

>>> float(Pulse(start=1.0, duration=0.5, edge=0.0).value(1.25))
1.0
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple, TypeAlias

from coopmm_jax.algebra.later import jnp, sincos
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.protocol import Group, Method, quantity
from coopmm_jax.kinds.registry import declare, register

HARMONICS = 16  # of a noise
Uniform: TypeAlias = Callable[[int], Vector]  # so many random numbers (n,) between 0 and 1, those of the sample

declare(
    Group(
        "disturbance",
        "a disturbance over time",
        (
            Method("value", ("t",), "its value at time t [s], which the amplitudes are multiplied with [-]", 0.0,
                   tuple((t,) for t in (0.0, 0.5, 1.0, 7.3, 20.0))),
            Method("prepared", ("uniform",), "what is asked for values instead, made once before a rollout; uniform(n) "
                   "gives n random numbers between 0 and 1, those of the sample", None, optional=True),
        ),
    )
)  # fmt: skip


@register("disturbance", "sine")
class Sine(NamedTuple):
    """sin(frequency t + phase)."""

    frequency: Annotated[Scalar, quantity("angular frequency [rad/s]")] = 1.0
    phase: Annotated[Scalar, quantity("phase at t = 0 [rad]")] = 0.0

    def value(self, t: Scalar) -> Scalar:
        """The sine at t [s]."""
        return sincos(self.frequency * t + self.phase)[0]


@register("disturbance", "step")
class Step(NamedTuple):
    """From 0 to 1 at a time, over an edge without a jump in its slope."""

    start: Annotated[Scalar, quantity("time at which it begins [s]")] = 1.0
    edge: Annotated[Scalar, quantity("time that it takes to rise; 0: at once [s]", at_least=0)] = 0.01

    def value(self, t: Scalar) -> Scalar:
        """The step at t [s]."""
        return _risen(t - self.start, self.edge)


@register("disturbance", "pulse")
class Pulse(NamedTuple):
    """From 0 to 1 at a time, and back after a while."""

    start: Annotated[Scalar, quantity("time at which it begins [s]")] = 1.0
    duration: Annotated[Scalar, quantity("time from the begin of its rise to that of its fall [s]", above=0)] = 0.1
    edge: Annotated[Scalar, quantity("time that it takes to rise, and to fall; 0: at once [s]", at_least=0)] = 0.01

    def value(self, t: Scalar) -> Scalar:
        """The pulse at t [s]."""
        return _risen(t - self.start, self.edge) - _risen(t - self.start - self.duration, self.edge)


def _risen(t: Scalar, edge: Scalar) -> Scalar:
    """Smooth step from 0 to 1 between 0 and ``edge`` [s]: x^2 (3 - 2 x)."""
    instant = edge <= 0.0
    x = jnp.clip(jnp.where(instant, jnp.where(t >= 0.0, 1.0, 0.0), t / jnp.where(instant, 1.0, edge)), 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


class Waves(NamedTuple):
    """Sum of cosines of equal amplitude, of mean square 1: a noise that has been drawn."""

    frequencies: Vector  # [rad/s]
    phases: Vector  # [rad]

    def value(self, t: Scalar) -> Scalar:
        """The sum at t [s]."""
        waves = (sincos(w * t + phase)[1] for w, phase in zip(self.frequencies, self.phases, strict=True))
        return math.sqrt(2.0 / len(self.phases)) * sum(waves)


@register("disturbance", "noise")
class Noise(NamedTuple):
    """Random, of mean square 1 and of equal power between two frequencies; drawn anew for each sample of a sweep."""

    low: Annotated[Scalar, quantity("lowest frequency [Hz]", at_least=0)] = 0.1
    high: Annotated[Scalar, quantity("highest frequency [Hz]", above=0)] = 2.0

    def check(self) -> None:
        """Refuse a band that has no width.

        Raises:
            UserError: ``high`` is not above ``low``.
        """
        if not self.high > self.low:
            raise UserError("high", f"greater than low ({self.low:g})", self.high)

    def prepared(self, uniform: Uniform) -> Waves:
        """Cosines of random phase, one in each of equal parts of the band, at a random place in it."""
        drawn = uniform(2 * HARMONICS)
        width = (self.high - self.low) / HARMONICS
        places, phases = drawn[:HARMONICS], drawn[HARMONICS:]
        frequencies = tuple(2.0 * math.pi * (self.low + width * (i + place)) for i, place in enumerate(places))
        return Waves(frequencies, tuple(2.0 * math.pi * phase for phase in phases))

    def value(self, t: Scalar) -> Scalar:
        """A noise at t [s] that all samples have in common; a rollout asks what ``prepared`` gives."""
        return self.prepared(lambda count: tuple((i + 0.5) / count for i in range(count))).value(t)


class Ramps(NamedTuple):
    """Piecewise linear function as its first value and the changes of its slope."""

    first: Scalar
    times: Vector  # [s]
    bends: Vector  # changes of the slope there [1/s]

    def value(self, t: Scalar) -> Scalar:
        """The function at t [s]."""
        bends = zip(self.times, self.bends, strict=True)
        return sum((bend * jnp.maximum(t - time, 0.0) for time, bend in bends), self.first + 0.0 * t)


@register("disturbance", "table")
class Table(NamedTuple):
    """Straight lines through points; constant before the first and after the last."""

    times: Annotated[Vector, quantity("times of the points, rising [s]")]
    values: Annotated[Vector, quantity("value at each of the times [-]")]

    def check(self) -> None:
        """Refuse points that cannot be joined.

        Raises:
            UserError: times that do not rise, or not one value for each.
        """
        if len(self.times) != len(self.values):
            must = f"a list of {len(self.times)}, one for each of times"
            raise UserError("values", must, f"a list of {len(self.values)}")
        if any(later <= earlier for earlier, later in itertools.pairwise(self.times)):
            raise UserError("times", "rising from one to the next", list(self.times))

    def prepared(self, uniform: Uniform) -> Ramps:
        """Slopes, which need no more than one division for each piece."""
        del uniform
        points = list(zip(self.times, self.values, strict=True))
        slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in itertools.pairwise(points)]
        bends = tuple(after - before for before, after in zip([0.0, *slopes], [*slopes, 0.0], strict=True))
        return Ramps(self.values[0], self.times, bends)

    def value(self, t: Scalar) -> Scalar:
        """The lines at t [s]."""
        return self.prepared(lambda count: (0.0,) * count).value(t)


class Disturbance(NamedTuple):
    """Torques against actuators, amplitude * scale * value(t) [N m], and a force on the object likewise [N].

    A torque's amplitude is a number for both robots, or a pair. None is what does not act; None for one wheel or joint
    means the number for all of them.
    """

    wave: Any = Sine()
    scale: Scalar = 1.0
    wheel: Any = 0.5
    joint: Any = 0.1
    right_wheel: Any = None
    left_wheel: Any = None
    joint_1: Any = None
    joint_2: Any = None
    joint_3: Any = None
    force: tuple[Scalar, Scalar, Scalar] | None = None  # along the world's x, y and z

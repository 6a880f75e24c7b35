"""A number over time: a desired force, a height, the place of the contact on the object.

A course is a NamedTuple of numbers with a method ``value``; a plain number stands for itself at all times.

>>> current(Sine(mean=15.0, amplitude=5.0), 0.0).item(), current(3.0, 0.0)
(15.0, 3.0)
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple, Protocol

from coopmm_jax.algebra.later import jax, jnp, sincos
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.paths import chebyshev, one_like
from coopmm_jax.kinds.registry import Group, Method, declare, quantity, register
from coopmm_jax.kinds.timings import smooth_rise

declare(
    Group(
        "course",
        "a number over time",
        (
            Method("value", ("t",), "the number at time t [s]", 0.0, tuple((t,) for t in (0.0, 0.5, 1.0, 7.3, 20.0))),
        ),
    )
)  # fmt: skip


class Course(Protocol):
    """A number over time."""

    def value(self, t: Scalar) -> Scalar:
        """Scalar at time t [s]."""
        ...


@register("course", "sine")
class Sine(NamedTuple):
    """mean + amplitude sin(rate t + phase)."""

    mean: Annotated[Scalar, quantity("mean [N, m]")] = 0.0
    amplitude: Annotated[Scalar, quantity("amplitude [N, m]")] = 0.0
    rate: Annotated[Scalar, quantity("angular frequency [rad/s]")] = 1.0
    phase: Annotated[Scalar, quantity("phase at t = 0 [rad]")] = 0.0

    def value(self, t: Scalar) -> Scalar:
        """Scalar at time t [s]."""
        return self.mean + self.amplitude * sincos(self.rate * t + self.phase)[0]


@register("course", "swing")
class Swing(NamedTuple):
    """radius sin(-swing cos(rate t)): the paper's contact point on an arc, where the arm swings about its centre."""

    radius: Annotated[Scalar, quantity("radius of the arc [m]")] = 0.7
    swing: Annotated[Scalar, quantity("amplitude of the angle [rad]")] = math.pi / 6
    rate: Annotated[Scalar, quantity("angular frequency [rad/s]")] = 1.0

    def value(self, t: Scalar) -> Scalar:
        """Scalar at time t [s]."""
        return self.radius * sincos(-self.swing * sincos(self.rate * t)[1])[0]


@register("course", "steps")
class Steps(NamedTuple):
    """Levels one after another: ``levels[0]``, then from ``times[k]`` on a smooth edge to ``levels[k + 1]``."""

    times: Annotated[Vector, quantity("times at which the edges begin [s]")] = (5.0,)
    levels: Annotated[Vector, quantity("levels, one more than there are times [N, m]")] = (15.0, 20.0)
    edge: Annotated[Scalar, quantity("duration of an edge [s]", above=0)] = 0.2

    def check(self) -> None:
        """Refuse numbers of levels and times that do not fit.

        Raises:
            UserError: not one level more than there are times.
        """
        if len(self.levels) != len(self.times) + 1:
            raise UserError("levels", f"{len(self.times) + 1} of them, one more than times", len(self.levels))

    def value(self, t: Scalar) -> Scalar:
        """Scalar at time t [s]."""
        total = self.levels[0] + 0.0 * t
        for begin, before, after in zip(self.times, self.levels[:-1], self.levels[1:], strict=True):
            total = total + (after - before) * smooth_rise((t - begin) / self.edge)
        return total


class Series(NamedTuple):
    """Chebyshev series between two times, held before and after: what a table becomes."""

    first: Scalar  # [s]
    last: Scalar  # [s]
    coefficients: Vector  # (K,), two at least

    def value(self, t: Scalar) -> Scalar:
        """Scalar at time t [s]."""
        x = (2.0 * t - self.first - self.last) / (self.last - self.first)
        return chebyshev(self.coefficients, jnp.clip(x, -1.0, 1.0))


def is_course(thing: Any) -> bool:
    """True if ``thing`` changes over time, False of a scalar."""
    return hasattr(thing, "value")


def current(course: Any, t: Scalar) -> Scalar:
    """Scalar at time t [s] of a course or a plain number."""
    return course.value(t) if is_course(course) else course


def value_and_rates(course: Course, t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Scalar at time t [s], and its first and second time derivatives."""
    one = one_like(t)
    (now, rate), (_, acceleration) = jax.jvp(lambda t: jax.jvp(course.value, (t,), (one,)), (t,), (one,))
    return now, rate, acceleration

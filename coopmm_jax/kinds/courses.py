"""A number over time: a desired force, a height, the place of the contact on the object.

A course is a NamedTuple of numbers with a method ``value``; a plain number stands for itself at all times.

>>> current(Sine(mean=15.0, amplitude=5.0), 0.0).item(), current(3.0, 0.0)
(15.0, 3.0)
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Any, NamedTuple, Protocol

from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.later import jnp, np, sincos
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import fits
from coopmm_jax.kinds.paths import chebyshev
from coopmm_jax.kinds.protocol import Group, Method, quantity
from coopmm_jax.kinds.registry import declare, register
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

_LATEST = 1e9  # [s] of a table, to either side: what is longer than any run and can still be squared


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

    times: Annotated[Vector, quantity("times at which the edges begin, rising [s]")] = (5.0,)
    levels: Annotated[Vector, quantity("levels, one more than there are times [N, m]")] = (15.0, 20.0)
    edge: Annotated[Scalar, quantity("duration of an edge [s]", above=0)] = 0.2

    def check(self) -> None:
        """Refuse numbers of levels and times that do not fit.

        Raises:
            UserError: not one level more than there are times, or times that do not rise.
        """
        if len(self.levels) != len(self.times) + 1:
            must = f"a list of {len(self.times) + 1}, one more than times"
            raise UserError("levels", must, f"a list of {len(self.levels)}")
        if any(after <= before for before, after in itertools.pairwise(self.times)):
            raise UserError("times", "rising from one to the next", list(self.times))

    def value(self, t: Scalar) -> Scalar:
        """Scalar at time t [s]."""
        total = self.levels[0] + 0.0 * t
        for begin, before, after in zip(self.times, self.levels[:-1], self.levels[1:], strict=True):
            total = total + (after - before) * smooth_rise((t - begin) / self.edge)
        return total


@register("course", "table")
class Table(NamedTuple):
    """Chebyshev series through a table of values over time, held before its first time and after its last."""

    first: Scalar  # [s]
    last: Scalar  # [s]
    coefficients: Vector  # (K,), two at least

    @classmethod
    def build(
        cls,
        times: Annotated[Vector, quantity("of the values, rising [s]")] = (0.0, 10.0, 20.0),
        values: Annotated[Vector, quantity("of the number [N, m]")] = (15.0, 20.0, 15.0),
        order: Annotated[int, quantity("degree of the series [-]", at_least=1, at_most=60)] = 12,
        tolerance: Annotated[float, quantity("largest distance of the series from the spline [N, m]", above=0)] = 0.01,
    ) -> Table:
        """Series through a table.

        Args:
            times: of the values (n,), rising [s].
            values: of the number (n,).
            order: degree of the series.
            tolerance: largest deviation from the spline through the values.

        Raises:
            UserError: a table that is none, or a fit that deviates too far.
        """
        if len(times) != len(values) or len(times) < 2:
            must = f"a list of {max(len(times), 2)}, one for each of times, which are at least 2"
            raise UserError("values", must, f"a list of {len(values)}")
        if any(later <= before for before, later in itertools.pairwise(times)):
            raise UserError("times", "rising from one to the next", list(times))
        if not max(map(abs, times)) < _LATEST:
            raise UserError("times", f"within {_LATEST:g} s of 0", list(times))
        fit = fits.table_fit(np.array(times), np.array(values), order)
        if fit.deviation > tolerance:
            must = f"enough for a deviation of {tolerance:g} at most (it is {fit.deviation:.3g})"
            raise UserError("order", must, order)
        return cls(times[0], times[-1], tuple(fit.coefficients.tolist()))

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
    now, rate, acceleration = derivatives(course.value, t, 2)
    return now, rate, acceleration

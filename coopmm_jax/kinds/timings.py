"""Phase p(t) of a path over time: standstill and reversal are fine, as headings follow from the path alone.

A timing is a NamedTuple of numbers with a method ``phase``, smooth to the third derivative.

>>> Rate(rate=2.0, ramp=0.0).phase(0.5).item()
1.0
"""

from __future__ import annotations

from typing import Annotated, NamedTuple, Protocol

from coopmm_jax.algebra.later import jnp, sincos
from coopmm_jax.algebra.types import Scalar
from coopmm_jax.kinds.protocol import Group, Method, quantity
from coopmm_jax.kinds.registry import declare, register

_NO_RAMP = 1e-6  # [s], below which there is none


declare(
    Group(
        "timing",
        "a timing of the path",
        (
            Method("phase", ("t",), "phase of the path at time t [s], smooth to the third derivative", 0.0,
                   tuple((t,) for t in (0.0, 0.5, 1.0, 7.3, 20.0))),
        ),
    )
)  # fmt: skip


class Timing(Protocol):
    """Phase over time."""

    def phase(self, t: Scalar) -> Scalar:
        """Phase of the path at time t [s], a scalar."""
        ...


@register("timing", "rate")
class Rate(NamedTuple):
    """p = start + rate s + sway sin(sway_rate s) in the slow time s = t - ramp (1 - exp(-t/ramp)): from standstill."""

    rate: Annotated[Scalar, quantity("mean rate of the phase [1/s]")] = 1.0
    start: Annotated[Scalar, quantity("phase at t = 0 [-]")] = 0.0
    sway: Annotated[Scalar, quantity("amplitude of a sway about the mean rate [-]")] = 0.0
    sway_rate: Annotated[Scalar, quantity("angular frequency of the sway [rad/s]")] = 1.0
    ramp: Annotated[Scalar, quantity("time constant of the soft start; 0: at full rate at once [s]", at_least=0)] = 0.5

    def phase(self, t: Scalar) -> Scalar:
        """Phase at time t [s], a scalar."""
        slow = t - self.ramp * (1.0 - jnp.exp(-t / jnp.maximum(self.ramp, _NO_RAMP)))
        return self.start + self.rate * slow + self.sway * sincos(self.sway_rate * slow)[0]


@register("timing", "rest_to_rest")
class RestToRest(NamedTuple):
    """From one phase to another within a duration, at rest before and after; three continuous derivatives."""

    first: Annotated[Scalar, quantity("phase at which it begins [-]")] = -1.0
    last: Annotated[Scalar, quantity("phase at which it ends [-]")] = 1.0
    duration: Annotated[Scalar, quantity("time from rest to rest [s]", above=0)] = 10.0

    def phase(self, t: Scalar) -> Scalar:
        """Phase at time t [s], a scalar."""
        return self.first + (self.last - self.first) * smooth_rise(t / self.duration)


def smooth_rise(x: Scalar) -> Scalar:
    """Rise from 0 at x <= 0 to 1 at x >= 1 with three continuous derivatives, of a scalar.

    >>> float(smooth_rise(0.5))
    0.5
    """
    x = jnp.clip(x, 0.0, 1.0)
    return x**4 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x)))

"""Planar curves r(p) of a phase p, and the frame that runs along one.

A path is a NamedTuple of numbers with a method ``point``; JAX differentiates it, so a path of one's own needs no more
than that. It must be smooth to the fourth derivative, and dr/dp must vanish nowhere.

>>> Ellipse(half_length=2.0, half_width=1.0).point(0.0)[0].item()
2.0
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple, Protocol

from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.later import angle_of, jnp, sincos
from coopmm_jax.algebra.matrix import dot, scaled
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.protocol import Group, Method, quantity
from coopmm_jax.kinds.registry import declare, register

ROUND = (0.0, 2.0 * math.pi)  # phases of a closed path, once round
OPEN = (-1.0, 1.0)  # phases of an open one, from its first point to its last

declare(
    Group(
        "path",
        "a path of the object",
        (
            Method("point", ("phase",), "world position (x, y) at a phase [m], smooth to the fourth derivative",
                   (0.0, 0.0), ((-0.7,), (0.0,), (0.4,), (1.0,))),
            Method("span", (), "phases from end to end; a path without it repeats itself every 2 pi", (0.0, 0.0),
                   optional=True),
        ),
    )
)  # fmt: skip


class Path(Protocol):
    """Curve of a phase."""

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase [m]."""
        ...


def span(path: Any) -> tuple[float, float]:
    """Phases (2,) of a path from end to end, or once round."""
    return path.span() if hasattr(path, "span") else ROUND


def is_closed(path: Any) -> bool:
    """True if a path repeats itself every 2 pi."""
    return span(path) is ROUND


X0 = Annotated[Scalar, quantity("centre along the world's x [m]")]
Y0 = Annotated[Scalar, quantity("centre along the world's y [m]")]


@register("path", "circle")
class Circle(NamedTuple):
    """Circle, anticlockwise."""

    radius: Annotated[Scalar, quantity("radius [m]", above=0)] = 1.7
    x0: X0 = 0.0
    y0: Y0 = 0.0

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase, the angle from the world's first axis [m]."""
        s, c = sincos(phase)
        return self.x0 + self.radius * c, self.y0 + self.radius * s


@register("path", "ellipse")
class Ellipse(NamedTuple):
    """Ellipse with its axes along the world's, anticlockwise."""

    half_length: Annotated[Scalar, quantity("half of its extent along x [m]", above=0)] = 1.7
    half_width: Annotated[Scalar, quantity("half of its extent along y [m]", above=0)] = 1.2
    x0: X0 = 0.0
    y0: Y0 = 0.0

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase [m]."""
        s, c = sincos(phase)
        return self.x0 + self.half_length * c, self.y0 + self.half_width * s


@register("path", "eight")
class Eight(NamedTuple):
    """Figure of eight, x = half_length sin p and y = half_width sin 2p: it crosses itself in its centre."""

    half_length: Annotated[Scalar, quantity("half of its extent along x [m]", above=0)] = 3.0
    half_width: Annotated[Scalar, quantity("half of its extent along y [m]", above=0)] = 1.2
    x0: X0 = 0.0
    y0: Y0 = 0.0

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase [m]."""
        s, c = sincos(phase)
        return self.x0 + self.half_length * s, self.y0 + self.half_width * (2.0 * s * c)


@register("path", "fourier")
class Fourier(NamedTuple):
    """Closed path x = x0 + sum_k (xc_k cos k p + xs_k sin k p), y likewise, k = 1 ... K."""

    x0: Annotated[Scalar, quantity("mean along the world's x [m]")] = 0.0
    y0: Annotated[Scalar, quantity("mean along the world's y [m]")] = 0.0
    xc: Annotated[Vector, quantity("coefficients of cos k p in x [m]")] = (1.7,)
    xs: Annotated[Vector, quantity("coefficients of sin k p in x [m]")] = (0.0,)
    yc: Annotated[Vector, quantity("coefficients of cos k p in y [m]")] = (0.0,)
    ys: Annotated[Vector, quantity("coefficients of sin k p in y [m]")] = (1.2,)

    def check(self) -> None:
        """Refuse coefficients that are not as many in all four places.

        Raises:
            UserError: they are not.
        """
        counts = tuple(len(entries) for entries in self[2:])
        if len(set(counts)) > 1:
            raise UserError("xc, xs, yc, ys", "lists of one length", f"lists of {', '.join(map(str, counts))}")

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase [m]; the harmonics by addition of angles, so from one sine."""
        s1, c1 = sincos(phase)
        s, c, x, y = s1, c1, self.x0, self.y0
        harmonics = tuple(zip(self.xc, self.xs, self.yc, self.ys, strict=True))
        for k, (xc, xs, yc, ys) in enumerate(harmonics, 1):
            x, y = x + xc * c + xs * s, y + yc * c + ys * s
            if k < len(harmonics):
                s, c = s * c1 + c * s1, c * c1 - s * s1
        return x, y


@register("path", "open")
class Chebyshev(NamedTuple):
    """Open path x = sum_k x_k T_k(p), y likewise, from phase -1 to 1."""

    x: Annotated[Vector, quantity("Chebyshev coefficients of x [m]")] = (0.0, 3.0)
    y: Annotated[Vector, quantity("Chebyshev coefficients of y [m]")] = (0.0, 0.0)

    def check(self) -> None:
        """Refuse a path that is a point.

        Raises:
            UserError: fewer than two coefficients.
        """
        for name, entries in self._asdict().items():
            if len(entries) < 2:
                raise UserError(name, "a list of at least 2", f"a list of {len(entries)}")

    def point(self, phase: Scalar) -> tuple[Scalar, Scalar]:
        """World position (x, y) at a scalar phase [m]."""
        return chebyshev(self.x, phase), chebyshev(self.y, phase)

    def span(self) -> tuple[float, float]:
        """Phases (2,) from end to end."""
        return OPEN


def chebyshev(coefficients: Vector, x: Scalar) -> Scalar:
    """Chebyshev series at a scalar x, two coefficients at least.

    >>> chebyshev((1.0, 2.0, 3.0), 0.5)
    0.5
    """
    before, now = 1.0, x
    total = coefficients[0] + coefficients[1] * x
    for coefficient in coefficients[2:]:
        before, now = now, 2.0 * x * now - before
        total = total + coefficient * now
    return total


class Frame(NamedTuple):
    """A path at one phase: its point, its right normal and tangent, and how fast it goes by."""

    point: Vector  # r (2,) [m]
    lateral: Vector  # (2,), to the right of the tangent
    forward: Vector  # (2,), unit tangent
    stretch: Scalar  # |dr/dp| [m]


def frame(path: Path, phase: Scalar) -> Frame:
    """Frame of a path at a scalar phase."""
    return frame_of(*derivatives(path.point, phase, 1))


def frame_of(point: Vector, tangent: Vector) -> Frame:
    """Frame at a point (2,) [m], from the derivative (2,) of the path by its phase [m]."""
    stretch = jnp.sqrt(dot(tangent, tangent))
    forward = scaled(1.0 / stretch, tangent)
    return Frame(point, (forward[1], -forward[0]), forward, stretch)


def bent_frame(path: Path, phase: Scalar) -> tuple[Frame, Scalar]:
    """Frame of a path at a scalar phase, and its curvature, positive to the left [1/m]."""
    point, tangent, bend = derivatives(path.point, phase, 2)
    at = frame_of(point, tangent)
    inverse = 1.0 / at.stretch
    return at, -dot(at.lateral, bend) * (inverse * inverse)


def heading(at: Frame) -> Scalar:
    """Angle th of a platform that runs along a path: forward is (-sin th, cos th) [rad]."""
    return angle_of(at.forward[1], -at.forward[0])

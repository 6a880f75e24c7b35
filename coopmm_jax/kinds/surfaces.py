"""Surfaces of the object: a kind is the level function of a point (e, n) in the object's frame, and its zeros.

The frame's origin is the object, e points along arm II, away from robot I, and n across it. The level F(e, n) [m] is
positive where the tip of robot I is free and zero on the surface, which passes through the origin with the gradient
(-1, 0). JAX differentiates it.

>>> Conic(0.5, 0.0).level(-1.0, 2.0)
0.0
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from coopmm_jax.algebra.later import jnp
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.protocol import Group, Method, quantity
from coopmm_jax.kinds.registry import declare, register

SURFACE = declare(
    Group(
        "surface",
        "the object's surface",
        (
            Method("level", ("e", "n"), "F at a point e along arm II and n across it, from the object; positive where "
                   "the tip is free, zero on the surface, of gradient (-1, 0) at the object [m]", 0.0,
                   ((0.0, 0.0), (-0.01, 0.1), (0.02, -0.1))),
            Method("along", ("n",), "e of the surface at n across arm II [m]", 0.0, ((0.0,), (0.1,), (-0.1,))),
        ),
    )
)  # fmt: skip


@register("surface", "plane")
class Plane(NamedTuple):
    """Flat, across arm II."""

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F = -e [m]; every argument in [m]."""
        return -e + 0.0 * n

    def along(self, n: Scalar) -> Scalar:
        """e = 0 [m], for every n [m]."""
        return 0.0 * n


@register("surface", "arc")
class Arc(NamedTuple):
    """Arc of a circle, hollow if the radius is positive, convex if it is negative."""

    radius: Annotated[Scalar, quantity("of the circle, negative where it is convex [m]")] = 0.7

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F = -e - (n^2 + e^2)/(2 R) [m]; every argument in [m]."""
        return -e - (n * n + e * e) / (2.0 * self.radius)

    def along(self, n: Scalar) -> Scalar:
        """e(n) [m], on the half of the circle through the object."""
        return -n * n / (self.radius + jnp.sign(self.radius) * jnp.sqrt(self.radius * self.radius - n * n))

    def check(self) -> None:
        """Refuse a circle without size.

        Raises:
            UserError: the radius is zero.
        """
        if self.radius == 0.0:
            raise UserError("radius", "other than 0", self.radius)


@register("surface", "conic")
class Conic(NamedTuple):
    """Ellipse, parabola or what lies between arc and plane: -e = (curvature_n n^2 + curvature_e e^2)/2.

    An arc of radius R has both curvatures 1/R, a plane none; an ellipse the semi-axes 1/|curvature_e| along arm II and
    1/sqrt(curvature_e curvature_n) across it; a parabola has no ``curvature_e``. Hollow where positive, else convex.
    """

    curvature_n: Annotated[Scalar, quantity("curvature where it meets arm II [1/m]")] = 0.0
    curvature_e: Annotated[Scalar, quantity("one over the semi-axis along arm II [1/m]")] = 0.0

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F = -e - (kn n^2 + ke e^2)/2 [m]; every argument in [m]."""
        return -e - 0.5 * (self.curvature_n * n * n + self.curvature_e * e * e)

    def along(self, n: Scalar) -> Scalar:
        """e(n) [m], the root of F next to the vertex, in a form that passes smoothly through the parabola's."""
        k, q = self.curvature_n, self.curvature_e
        return -k * n * n / (1.0 + jnp.sqrt(1.0 - k * q * n * n))

    def check(self) -> None:
        """Refuse a hyperbola, whose level does not say on which branch the tip stands.

        Raises:
            UserError: the curvatures have opposite signs.
        """
        if self.curvature_n * self.curvature_e < 0.0:
            raise UserError("curvature_e", f"0, or of the sign of curvature_n ({self.curvature_n:g})", self.curvature_e)


@register("surface", "profile")
class Profile(NamedTuple):
    """Any smooth profile e = -h(n), as a polynomial h(n) = c1 n^2 + c2 n^3 + ...; hollow where h bends upwards."""

    coefficients: Annotated[Vector, quantity("of n^2, n^3, ... in h [1/m, 1/m^2, ...]")] = (0.0,)

    def height(self, n: Scalar) -> Scalar:
        """h(n) [m], for n [m]."""
        h = 0.0
        for c in reversed(self.coefficients):
            h = (h + c) * n
        return h * n

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F = -e - h(n) [m]; every argument in [m]."""
        return -e - self.height(n)

    def along(self, n: Scalar) -> Scalar:
        """e = -h(n) [m], for n [m]."""
        return -self.height(n)

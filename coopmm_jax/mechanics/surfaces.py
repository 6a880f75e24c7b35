"""Shapes of the object's surface, as level functions of a point (e, n) in the object's frame.

The frame's origin is the object, e points along arm II, away from robot I, and n across it. A level F(e, n) [m] is
positive where the tip of robot I is free and zero on the surface, which passes through the origin with gradient
(-1, 0). A shape of your own is a NamedTuple of numbers with these two methods.

>>> Conic(0.5, 0.0).level(-1.0, 2.0)
0.0
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import jax.numpy as jnp

from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.parameters import Surface


class Shape(Protocol):
    """A surface, told by its level and by its points."""

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F(e, n) [m], for a point (e, n) [m]; any smooth function, differentiated by JAX."""
        ...

    def along(self, n: Scalar) -> Scalar:
        """e(n) [m], where the surface is at n [m] across arm II, on the branch through the object."""
        ...


class Plane(NamedTuple):
    """A flat surface across arm II."""

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F = -e [m]; every argument in [m]."""
        return -e + 0.0 * n

    def along(self, n: Scalar) -> Scalar:
        """e = 0 [m], for every n [m]."""
        return 0.0 * n


class Conic(NamedTuple):
    """An arc of circle or ellipse, a parabola or, without curvature, a plane; hollow where positive, else convex.

    An arc of radius R has both curvatures 1/R; an ellipse the semi-axes 1/|curvature_e| along arm II and
    1/sqrt(curvature_e curvature_n) across it; a parabola no ``curvature_e``.
    """

    curvature_n: Scalar = 0.0  # at the vertex, the object [1/m]
    curvature_e: Scalar = 0.0  # [1/m]

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F = -e - (kn n^2 + ke e^2)/2 [m]; every argument in [m]."""
        return -e - 0.5 * (self.curvature_n * n * n + self.curvature_e * e * e)

    def along(self, n: Scalar) -> Scalar:
        """e(n) [m], the root of F next to the vertex, in a form that passes smoothly through the parabola's."""
        k, q = self.curvature_n, self.curvature_e
        return -k * n * n / (1.0 + jnp.sqrt(1.0 - k * q * n * n))


class Profile(NamedTuple):
    """A surface e = -h(n), h(n) = c[0] n^2 + c[1] n^3 + ...; hollow where h bends upwards."""

    coefficients: Vector = (0.0,)  # of n^2, n^3, ... [1/m, 1/m^2, ...]

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


def shape_of(surface: Surface) -> Shape:
    """Shape of any surface, the paper's arc as a conic.

    >>> shape_of(Surface(contact_radius=0.5)).curvature_n
    2.0
    """
    if surface.shape is None:
        return Conic(1.0 / surface.contact_radius, 1.0 / surface.contact_radius)
    return surface.shape

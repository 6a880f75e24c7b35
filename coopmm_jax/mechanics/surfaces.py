"""The object's surface as one of the kinds of ``kinds/surfaces.py``, for whatever needs its points alone."""

from __future__ import annotations

from typing import Protocol

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.parameters import Surface


class Shape(Protocol):
    """A surface, told by its level and by its points (e, n) in the object's frame."""

    def level(self, e: Scalar, n: Scalar) -> Scalar:
        """F(e, n) [m], for a point (e, n) [m]."""
        ...

    def along(self, n: Scalar) -> Scalar:
        """e(n) [m], where the surface is at n [m] across arm II, on the branch through the object."""
        ...


def shape_of(surface: Surface) -> Shape:
    """Shape of any surface, the paper's arc as a conic.

    >>> round(float(shape_of(Surface(contact_radius=0.5)).along(0.3)), 6)
    -0.1
    """
    if surface.shape is None:
        return Conic(1.0 / surface.contact_radius, 1.0 / surface.contact_radius)
    return surface.shape

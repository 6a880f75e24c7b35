"""JAX and NumPy, fetched when first used: modules that scenario files are read with know fields without importing them.

>>> float(jnp.maximum(1.0, 2.0)), round(float(sincos(0.5)[0]), 7)
(2.0, 0.4794255)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any


class _Later:
    """Module that is imported when one of its names is asked for."""

    def __init__(self, name: str):
        self._module = name

    def __getattr__(self, name: str) -> Any:
        found = getattr(import_module(self._module), name)
        setattr(self, name, found)  # and is not asked for again
        return found


if TYPE_CHECKING:
    import jax
    import jax.numpy as jnp
    import numpy as np
    from jax import lax

    from coopmm_jax.algebra.angle import angle_of
    from coopmm_jax.algebra.sincos import sincos, wrapped
else:
    jax, jnp, lax, np = map(_Later, ("jax", "jax.numpy", "jax.lax", "numpy"))

    def angle_of(x, y):
        """Angle of a vector (x, y) of scalars [rad], see ``algebra/angle.py``."""
        return import_module("coopmm_jax.algebra.angle").angle_of(x, y)

    def sincos(x):
        """Sine and cosine of a scalar [rad], see ``algebra/sincos.py``."""
        return import_module("coopmm_jax.algebra.sincos").sincos(x)

    def wrapped(angle):
        """The same direction within half a turn of zero [rad], a scalar, see ``algebra/sincos.py``."""
        return import_module("coopmm_jax.algebra.sincos").wrapped(angle)


__all__ = ["angle_of", "jax", "jnp", "lax", "np", "sincos", "wrapped"]

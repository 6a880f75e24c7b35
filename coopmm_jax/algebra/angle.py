"""Angle of a vector, for loops over many elements.

>>> round(float(angle_of(-1.0, 1.0)), 12)
2.356194490192
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.sincos import horner
from coopmm_jax.algebra.types import Scalar

_LARGE = math.tan(math.pi / 8)
# Chebyshev fits of (atan x - x) / x^3 in x^2, |x| <= tan(pi/8), to rounding.
_DOUBLE = (
    -0.01917688711906226,
    0.03923165829558719,
    -0.0508544973794026,
    0.0585814891280221,
    -0.06664511447381948,
    0.07692183190826087,
    -0.09090904578123903,
    0.11111111015256361,
    -0.14285714284666542,
    0.1999999999999552,
    -0.3333333333333333,
)
_SINGLE = (-0.06451928208, 0.1074373149, -0.142639556, 0.1999954048, -0.3333333176)


@jax.custom_jvp
def angle_of(x: Scalar, y: Scalar) -> Scalar:
    """Angle of a vector (x, y) other than zero from the first axis, within half a turn of zero [rad].

    ``arctan2`` to 3e-16 in float64 and 2e-7 in float32, by a polynomial of our own for the reason that ``sincos`` has.
    """
    x, y = jnp.asarray(x), jnp.asarray(y)
    across, along = jnp.abs(y), jnp.abs(x)
    steep = across > along
    low, high = jnp.minimum(across, along), jnp.maximum(across, along)
    turned = low > _LARGE * high  # by an eighth of a turn
    h = jnp.where(turned, low - high, low) / jnp.where(turned, low + high, high)
    z = h * h
    angle = h + h * z * horner(_DOUBLE if z.dtype == jnp.float64 else _SINGLE, z)
    angle = jnp.where(turned, angle + 0.25 * math.pi, angle)
    angle = jnp.where(steep, 0.5 * math.pi - angle, angle)
    angle = jnp.where(x < 0.0, math.pi - angle, angle)
    return jnp.where(y < 0.0, -angle, angle)


@angle_of.defjvp
def _angle_jvp(primals: tuple, tangents: tuple) -> tuple:
    (x, y), (x_rate, y_rate) = primals, tangents
    return angle_of(x, y), (x * y_rate - y * x_rate) / (x * x + y * y)

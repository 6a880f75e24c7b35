"""Sine and cosine of an angle together, and angles modulo a turn.

>>> round(float(sincos(0.5)[0]), 7)
0.4794255
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.types import Scalar

_TURN = 2.0 * math.pi


def wrapped(angle: Scalar) -> Scalar:
    """The same direction within half a turn of zero [rad]: angle - 2 pi round(angle / 2 pi), a scalar.

    The error between two headings, which is the same however many turns either has made; its derivative is 1.

    >>> round(float(wrapped(2.0 * math.pi + 0.25)), 12)
    0.25
    """
    return angle - _TURN * jnp.round(angle / _TURN)


class _Series(NamedTuple):
    """Constants of ``sincos`` in one precision.

    ``pi`` is split after Cody and Waite into parts whose product with n is exact up to |x| ~ 1e5, the last one to
    rounding. ``sin`` and ``cos`` are Chebyshev fits in z = h^2, |h| <= pi/2, of (sin h - h) / (h z) and (cos h - 1 +
    z/2) / z^2, to rounding.
    """

    pi: tuple[float, ...]
    sin: tuple[float, ...]
    cos: tuple[float, ...]


_DOUBLE = _Series(
    pi=(3.1415926534682512, 1.2154201013012384e-10),
    sin=(
        2.7314447512062796e-15,
        -7.643970295533013e-13,
        1.605897731242445e-10,
        -2.505210761699557e-08,
        2.755731921916323e-06,
        -0.00019841269841254974,
        0.008333333333333316,
        -0.16666666666666666,
    ),
    cos=(
        4.646435932869834e-14,
        -1.1466252257937559e-11,
        2.0876681558822446e-09,
        -2.7557318573365657e-07,
        2.4801587298913547e-05,
        -0.0013888888888884767,
        0.04166666666666666,
    ),
)
_SINGLE = _Series(
    pi=(3.140625, 0.0009670257568359375, 6.27832957301e-07),
    sin=(2.634756368e-06, -0.0001982273948, 0.008333242135, -0.1666666596),
    cos=(-2.654606561e-07, 2.478608243e-05, -0.001388881255, 0.04166666608),
)


def horner(coefficients: Sequence[float], x: Scalar) -> Scalar:
    """Polynomial at a scalar x, its highest coefficient first.

    >>> horner((2.0, 1.0), 3.0)
    7.0
    """
    total: Scalar = coefficients[0]
    for coefficient in coefficients[1:]:
        total = total * x + coefficient
    return total


@jax.custom_jvp
def sincos(x: Scalar) -> tuple[Scalar, Scalar]:
    """sin x and cos x of a scalar x [rad] together, for |x| up to 1e5 to 1e-15 in float64 and 6e-7 in float32.

    A polynomial of our own, because XLA's CPU back end calls libm once per element for these two while it vectorises
    everything else. Half angles make one interval of the whole circle: choosing quadrants instead takes comparisons,
    which XLA does not fuse with their neighbours, eight small loops more for each of the angles here.
    """
    return _by_series(jnp.asarray(x))


@functools.partial(jax.jit, inline=True)  # traced once: a rollout takes some thirty sines, a quarter of its equations
def _by_series(x: jax.Array) -> tuple[jax.Array, jax.Array]:
    series = _DOUBLE if x.dtype == jnp.float64 else _SINGLE
    n = jnp.floor(x * (0.5 / jnp.pi) + 0.5)
    h = 0.5 * x
    for part in series.pi:
        h = h - n * part
    z = h * h
    s = h + h * z * horner(series.sin, z)
    c = 1.0 - 0.5 * z + z * z * horner(series.cos, z)
    return 2.0 * s * c, 1.0 - 2.0 * s * s


@sincos.defjvp
def _sincos_jvp(primals: tuple, tangents: tuple) -> tuple:
    s, c = sincos(primals[0])
    return (s, c), (c * tangents[0], -s * tangents[0])

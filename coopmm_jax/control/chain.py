"""Kinematic control of a chained form of any length n_v, (12)-(15), by forward differentiation.

In tau, with d tau = u_d1 dt, the errors e = zeta - zeta_d are a chain of integrators where u1 is u_d1, and with
c = u_d1^(2 l - 1), l = n_v - 2,

    s_1 = e_1,   s_2 = e_2,   s_3 = e_3 + k_2 c s_2
    s_(j+1) = ds_j/dtau + s_(j-1) + k_j c s_j,   3 <= j < n_v
    z_b = (u_d1 + eta,  u_d2 - u_d1 s_(n_v-1) - k_(n_v) s_(n_v) - u_d1 d(s_(n_v) - e_(n_v))/dtau)
    Lambda = (L_g1 V_1,  s_(n_v)),   V_1 = (k_1 s_1^2 + s_2^2 + ... + s_(n_v)^2) / 2

where L_g1 is the derivative along (1, zeta_3, ..., zeta_(n_v), 0). Every division by u_d1 is carried out on the
polynomials that c and its derivatives by tau are in u_d1 and its rates, so nothing is singular where the platform
turns back. ``backstepping`` has n_v = 3 written out.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import dot
from coopmm_jax.algebra.types import Scalar, Vector

Polynomial = Counter[tuple[int, ...]]  # in u_d1 and its rates: exponents to coefficient


class Chain(NamedTuple):
    """Chained form (8) and its reference at one instant."""

    zeta: Vector  # (n_v,)
    e: Vector  # zeta - zeta_d (n_v,)
    u1: Vector  # u_d1 and its first n_v - 2 derivatives (n_v - 1,)
    u2: Scalar  # u_d2


def errors(k: Vector, chain: Chain) -> Vector:
    """Backstepping errors s (n_v,) of (14).

    Args:
        k: gains k_1, ..., k_(n_v) of (14), of which the first and the last play no part.
        chain: coordinates and reference.

    >>> [float(x) for x in errors((1.0, 2.0, 1.0), Chain((0.0,) * 3, (1.0, 0.25, 0.5), (3.0, 0.0), 0.0))]
    [1.0, 0.25, 2.0]
    """
    return chain.e[0], *_later_errors(k, chain.e[1:], _factors(chain)[0])


def platform_velocity(k: Vector, chain: Chain, eta: Scalar) -> tuple[Scalar, Scalar]:
    """z_b (2,) of (12).

    Args:
        k: gains (n_v,).
        chain: coordinates and reference.
        eta: of (15) [rad/s].
    """
    (c, c_rate), e, u_d1 = _factors(chain), chain.e[1:], chain.u1[0]
    e_rate = (*(u_d1 * x for x in e[1:]), jnp.zeros_like(e[0]))  # the last one's is u_d2's part, which z_b2 has
    s, s_rate = jax.jvp(functools.partial(_later_errors, k), (e, c), (e_rate, c_rate))
    return u_d1 + eta, chain.u2 - u_d1 * s[-2] - k[-1] * s[-1] - s_rate[-1]


def signal(k: Vector, chain: Chain) -> tuple[Scalar, Scalar]:
    """Lambda's non-zero entries (2,), defined below (30); (15) is etadot = -k_0 eta less the first."""
    c = _factors(chain)[0]
    along = (*chain.zeta[2:], jnp.zeros_like(chain.e[0]))
    s, moved = jax.jvp(lambda e: _later_errors(k, e, c), (chain.e[1:],), (along,))
    return k[0] * chain.e[0] + dot(s, moved), s[-1]


def stored(k: Vector, chain: Chain) -> Scalar:
    """Share of a platform in V_1 of (31), without that of eta; a scalar."""
    first, *rest = errors(k, chain)
    return 0.5 * (k[0] * first * first + dot(rest, rest))


def decay(k: Vector, chain: Chain) -> Scalar:
    """Decaying terms of (32) but that of eta, a scalar, counted positive: k_j u_d1^(2 l) s_j^2, k_(n_v) s_(n_v)^2."""
    _, *middle, last = errors(k, chain)
    power = persistence(chain.u1[0], len(chain.e))
    return power * sum(gain * s * s for gain, s in zip(k[1:-1], middle, strict=True)) + k[-1] * last * last


def persistence(u_d1: Scalar, n_v: int) -> Scalar:
    """u_d1^(2 l), l = n_v - 2, a scalar: the speed at which errors decay, over their gains.

    >>> persistence(2.0, 4)
    16.0
    """
    return u_d1 ** (2 * (n_v - 2))


def _later_errors(k: Vector, e: Vector, c: Vector) -> Vector:
    """s_2, ..., s_(n_v) from e_2, ..., e_(n_v) and from c and its derivatives by tau (n_v - 2,)."""
    return _up_to(len(e) + 1, k, e, c)


def _up_to(j: int, k: Vector, e: Vector, c: Vector) -> Vector:
    """s_2, ..., s_j."""
    if j == 3:
        return e[0], e[1] + k[1] * c[0] * e[0]
    # What would follow the last error and the last factor is not read by those before s_j.
    along = tuple((*x[1:], jnp.zeros_like(x[0])) for x in (e, c))
    s, rate = jax.jvp(functools.partial(_up_to, j - 1, k), (e, c), along)
    return *s, rate[-1] + s[-2] + k[j - 2] * c[0] * s[-1]


def _factors(chain: Chain) -> tuple[Vector, Vector]:
    """c and its derivatives by tau (n_v - 2,), and the time derivatives of them all (n_v - 2,)."""
    u_d1, n_v = chain.u1, len(chain.e)
    *c, last = (_value(p, u_d1) for p in _polynomials(n_v))
    return tuple(c), (*(u_d1[0] * x for x in c[1:]), last)


@functools.cache
def _polynomials(n_v: int) -> tuple[Polynomial, ...]:
    """c, its first n_v - 3 derivatives by tau, and the time derivative of the last of them."""
    made: list[Polynomial] = [Counter({(2 * n_v - 5,): 1})]
    for _ in range(n_v - 3):
        divided = {(powers[0] - 1, *powers[1:]): factor for powers, factor in _rate(made[-1]).items()}
        made.append(Counter(divided))
    return *made, _rate(made[-1])


def _rate(polynomial: Polynomial) -> Polynomial:
    """Time derivative: each rate of u_d1 moves on to the next."""
    moved: Polynomial = Counter()
    for powers, factor in polynomial.items():
        for place, power in enumerate(powers):
            if power:
                after = [*powers, 0] if place + 1 == len(powers) else list(powers)
                after[place] -= 1
                after[place + 1] += 1
                moved[tuple(after)] += factor * power
    return moved


def _value(polynomial: Polynomial, rates: Sequence[Scalar]) -> Scalar:
    terms = [
        math.prod((x**power for x, power in zip(rates, powers, strict=False) if power), start=float(factor))
        for powers, factor in polynomial.items()
    ]
    return sum(terms[1:], terms[0])

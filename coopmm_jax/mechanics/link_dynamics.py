"""Inertia matrix and bias forces of an arm with any number of pitch links, (5) and (9), in body rates.

The rates are (V, w, W, hdot, Adot_1, ..., Adot_N) as in ``pitch_links``, hdot only of an arm that lifts. With the
centre of mass j at sum_k p_jk (cos A_k, sin A_k) from the column's top, everything is linear in

    S_k = sum_j m_j p_jk,   J_kl = sum_j m_j p_jk p_jl, and the link's own moment of inertia in J_kk.

``robot_dynamics`` has two links written out.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from coopmm_jax.algebra.matrix import Matrix, mul
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.mechanics.pitch_links import LinkPosture, lifts
from coopmm_jax.mechanics.two_axles import FrontLumped
from coopmm_jax.parameters import Geometry, LinkInertia


class LinkLumped(NamedTuple):
    """Masses and inertias of one robot in which its equations are linear, as ``robot_dynamics.Lumped``."""

    platform: Scalar  # translating mass with the wheels' spin [kg]
    yaw: Scalar  # about the axle midpoint, arm's base on its mount included [kg m^2]
    platform_moment: Scalar  # m_p d + (m1 + arm) mount_offset [kg m]
    column: Scalar  # I1
    arm: Scalar  # mass of links and object [kg]
    S: Vector  # (N,) [kg m]
    J: tuple[Vector, ...]  # rows of the lower triangle (N x N) [kg m^2]
    front: FrontLumped | None = None  # of a platform on two axles


def moments(half_lengths: Vector, links: LinkInertia, load: Scalar) -> tuple[Vector, tuple[Vector, ...]]:
    """S (N,) and the lower triangle of J (N x N).

    Args:
        half_lengths: of the links (N,) [m].
        links: their masses and moments of inertia.
        load: mass at the tip [kg].
    """
    count = len(half_lengths)
    # Along link k the masses of the links behind it are at its end, its own is in its middle.
    beyond = [sum(links.m_links[k + 1 :], start=load) for k in range(count)]
    own = list(zip(half_lengths, links.m_links, links.I_links, beyond, strict=True))
    S = tuple(half * (m + 2.0 * behind) for half, m, _, behind in own)
    diagonal = [inertia + half**2 * (m + 4.0 * behind) for half, m, inertia, behind in own]
    J = tuple((*(2.0 * half_lengths[j] * S[k] for j in range(k)), diagonal[k]) for k in range(count))
    return S, J


class LinkFactors(NamedTuple):
    """Factors of the masses in one robot's inertia and bias: the same for plant and nominal model."""

    arm: LinkPosture
    lift: int  # number of joints that lift, one or none
    gravity: Scalar  # [m/s^2]
    mount: tuple[Scalar, Scalar]  # of the arm from the axle, along n and e [m]
    rates: Vector  # body rates (3 + k,)
    base: tuple[Scalar, Scalar]  # acceleration of the mount along e and n, under constant body rates [m/s^2]
    apart: tuple[Vector, ...]  # cosines of A_k - A_l, l < k (N rows)
    across: tuple[Vector, ...]  # likewise sines


def factors(geometry: Geometry, gravity: Scalar, arm: LinkPosture, rates: Vector) -> LinkFactors:
    """``LinkFactors`` of one robot.

    Args:
        geometry: of the robot.
        gravity: [m/s^2].
        arm: its posture.
        rates: body rates (n,).
    """
    assert geometry.arm is not None
    V, w = rates[:2]
    bs, bc = geometry.mount_offset * arm.s1, geometry.mount_offset * arm.c1
    each = list(zip(arm.sines, arm.cosines, strict=True))
    return LinkFactors(
        arm=arm,
        lift=lifts(geometry.arm),
        gravity=gravity,
        mount=(bs, bc),
        rates=rates,
        base=(w * (V * arm.s1 - w * bc), w * (V * arm.c1 + w * bs)),
        apart=tuple(tuple(c * d + s * r for r, d in each[:k]) for k, (s, c) in enumerate(each)),
        across=tuple(tuple(s * d - c * r for r, d in each[:k]) for k, (s, c) in enumerate(each)),
    )


def body_inertia(m: LinkLumped, f: LinkFactors) -> Matrix:
    """Inertia matrix (n x n) in body rates, n = 3 + k; symmetric positive definite."""
    arm, (bs, bc) = f.arm, f.mount
    forward, upward = _first_moments(m, arm)
    first, lean = _sum(forward), _leaning(m, arm)
    W = m.column + _sum(c * x for c, x in zip(arm.cosines, lean, strict=True))
    VW, wW = -arm.s1 * first, bc * first
    VA, wA = tuple(-arm.c1 * x for x in upward), tuple(-bs * x for x in upward)
    none, still = (0,) * len(forward), (0,) * f.lift
    lower = [(*map(mul, row, near), row[-1]) for row, near in zip(m.J, f.apart, strict=True)]
    count = range(len(forward))
    return Matrix(
        [
            (m.platform, 0, VW, *still, *VA),
            (0, m.yaw, wW, *still, *wA),
            (VW, wW, W, *still, *none),
            *([(0, 0, 0, m.arm, *forward)] if f.lift else []),
            *(
                (VA[k], wA[k], 0, *((forward[k],) if f.lift else ()), *(lower[max(k, j)][min(k, j)] for j in count))
                for k in count
            ),
        ]
    )


def body_bias(m: LinkLumped, f: LinkFactors) -> Vector:
    """Coriolis, centrifugal and gravity forces in body rates (3 + k,) [N, N m, N m, N of a lift, N m, ...]."""
    arm, (bs, bc), (base_e, base_n) = f.arm, f.mount, f.base
    V, w, W = f.rates[:3]
    turning = f.rates[3 + f.lift :]
    squares, swings = tuple(A * A for A in turning), tuple(2.0 * W * A for A in turning)
    forward, upward = _first_moments(m, arm)
    radial = _sum(x * (AA + W * W) for x, AA in zip(forward, squares, strict=True))
    coriolis = _sum(x * WA for x, WA in zip(upward, swings, strict=True))
    turn = tuple(s * x for s, x in zip(arm.sines, _leaning(m, arm), strict=True))
    on_platform = (
        arm.s1 * coriolis - arm.c1 * radial - m.platform_moment * (w * w),
        m.platform_moment * (w * V) - (bs * radial + bc * coriolis),
        _sum(forward) * base_n - _sum(x * WA for x, WA in zip(turn, swings, strict=True)),
    )
    lifted = (m.arm * f.gravity - _sum(x * AA for x, AA in zip(upward, squares, strict=True)),) if f.lift else ()
    of_links = (
        _sum((c * f.gravity, -s * base_e, x * (W * W), *_between(m, f, k, squares)))
        for k, (c, s, x) in enumerate(zip(forward, upward, turn, strict=True))
    )
    return (*on_platform, *lifted, *of_links)


def _between(m: LinkLumped, f: LinkFactors, k: int, squares: Vector) -> list[Scalar]:
    """Moments on link k of the other links' centrifugal forces [N m]."""
    before = [m.J[k][j] * f.across[k][j] * squares[j] for j in range(k)]
    return before + [-m.J[j][k] * f.across[j][k] * squares[j] for j in range(k + 1, len(squares))]


def gravity_force(m: LinkLumped, gravity: Scalar, arm: LinkPosture, lift: int) -> Vector:
    """G_i2 of (9) in u (3 + k,): what holds the arm's weight [0, 0, 0, N of a lift, N m, ...]."""
    weights = [gravity * x for x in _first_moments(m, arm)[0]]
    held = (_sum(weights[k:]) for k in range(len(weights)))  # a joint carries all links behind it
    return (0, 0, 0, *(gravity * m.arm,) * lift, *held)


def _first_moments(m: LinkLumped, arm: LinkPosture) -> tuple[Vector, Vector]:
    """First moments of the links along e, and upwards (N,) [kg m]."""
    forward = tuple(S * c for S, c in zip(m.S, arm.cosines, strict=True))
    return forward, tuple(S * s for S, s in zip(m.S, arm.sines, strict=True))


def _leaning(m: LinkLumped, arm: LinkPosture) -> Vector:
    """sum_l J_kl cos A_l (N,) [kg m^2]."""
    count = range(len(m.J))
    return tuple(_sum(m.J[max(k, j)][min(k, j)] * arm.cosines[j] for j in count) for k in count)


def _sum(values: Iterable[Scalar]) -> Scalar:
    first, *others = values
    return sum(others, start=first)

"""Arm with any number of pitch links on its column, which may lift them: its kinematics.

After the yaw a1 come the lift h, of an arm that has one, and the pitch of each link from the one before. Body rates of
the arm are (W, hdot, Adot_1, ..., Adot_N) with the links' absolute pitches A_k, so that the tip is at

    reach = 2 sum l_k cos A_k,   height = 2 l1 + h + 2 sum l_k sin A_k.

Constraint rows make the last joints dependent. The others hold where they start, as nothing asks them to move.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import dot, mul, scaled
from coopmm_jax.algebra.sincos import sincos, wrapped
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.parameters import AnyArm, Geometry, LiftedArm


class LinkPosture(NamedTuple):
    """Sines and cosines of one robot's arm, and where its tip is."""

    s1: Scalar  # arm yaw a1 from the forward axis
    c1: Scalar
    sines: Vector  # of the links' absolute pitches (N,)
    cosines: Vector
    reach: Scalar  # of the tip along the arm's direction e [m]
    height: Scalar  # of the tip [m]


def lifts(arm: AnyArm) -> int:
    """Number of joints that lift: one or none."""
    return int(isinstance(arm, LiftedArm))


def posture(arm: AnyArm, l1: Scalar, joints: Vector) -> LinkPosture:
    """Trigonometry of an arm.

    Args:
        arm: its links.
        l1: half height of the column [m].
        joints: yaw, lift if there is one, pitches.
    """
    yaw, *others = joints
    lift, pitches = others[: lifts(arm)], itertools.accumulate(others[lifts(arm) :])
    s1, c1 = sincos(yaw)
    sines, cosines = zip(*map(sincos, pitches), strict=True)
    reach, rise = 2.0 * dot(arm.l_links, cosines), dot(arm.l_links, sines)
    return LinkPosture(s1, c1, sines, cosines, reach, sum(lift, start=2.0 * (l1 + rise)))


def rates_map(arm: AnyArm) -> tuple[Vector, ...]:
    """Rows that take the rates of the joints after the yaw (k,) to (hdot, Adot_1, ..., Adot_N)."""
    lift, count = lifts(arm), len(arm.l_links)
    rows = [(*(0,) * lift, *(int(j <= i) for j in range(count))) for i in range(count)]
    return ((1, *(0,) * count), *rows) if lift else tuple(rows)


def tip_rows(geometry: Geometry, posture: LinkPosture) -> tuple[Vector, Vector, Vector]:
    """Jacobian rows of the tip's velocity along e, n and up, in body rates (n,), n = 3 + k."""
    arm, b, (s1, c1) = _of(geometry), geometry.mount_offset, posture[:2]
    still = (0,) * lifts(arm)
    lengths = scaled(2.0, arm.l_links)
    sideways, upwards = scaled(-1.0, tuple(map(mul, lengths, posture.sines))), tuple(map(mul, lengths, posture.cosines))
    along = (c1, b * s1, 0, *still, *sideways)
    across = (-s1, b * c1, posture.reach, *still, *(0,) * len(sideways))
    return along, across, (0, 0, 0, *(1,) * len(still), *upwards)


def tip_bias(geometry: Geometry, posture: LinkPosture, rates: Vector) -> tuple[Vector, Scalar, Scalar]:
    """Parts of the tip's acceleration when udot = 0, at body rates (3 + k,).

    Returns:
        What each link takes off along e (N,) [m/s^2], rate of the reach [m/s], and acceleration upwards [m/s^2].
    """
    arm = _of(geometry)
    turning = rates[3 + lifts(arm) :]
    speeds = tuple(map(mul, scaled(2.0, arm.l_links), turning))
    squared = tuple(map(mul, speeds, turning))
    return tuple(map(mul, posture.cosines, squared)), -dot(posture.sines, speeds), -dot(posture.sines, squared)


def joints_at(arm: AnyArm, reach: Scalar, rise: Scalar, near: Vector) -> Vector:
    """Joints after the yaw (k,) that put the tip at ``reach`` along e and ``rise`` above the column [m].

    The last two do, and the others stay: two links as a triangle, or one link and the lift.

    Args:
        arm: its links.
        reach: of the tip [m].
        rise: likewise [m].
        near: joints (k,) that the others keep, and that tell the side to which the arm bends.
    """
    lift, count = lifts(arm), len(arm.l_links)
    pitches = near[lift:]
    if count == 1:
        return _lifted(arm, reach, rise, near) if lift else (jnp.arctan2(rise, reach),)
    held, before = pitches[: count - 2], 0.0 * pitches[0]
    for half, joint in zip(arm.l_links, held, strict=False):
        before = before + joint
        s, c = sincos(before)
        reach, rise = reach - 2.0 * half * c, rise - 2.0 * half * s
    if lift:
        rise = rise - near[0]
    last = arm.l_links[count - 2 :]
    first, second = two_angles((last[0], last[1]), reach, rise, wrapped(pitches[-1]))
    return (*near[:lift], *held, wrapped(first - before) if held else first, second)


def _lifted(arm: AnyArm, reach: Scalar, rise: Scalar, near: Vector) -> Vector:
    """Lift and pitch of one link."""
    length = 2.0 * arm.l_links[0]
    pitch = jnp.copysign(jnp.arccos(jnp.clip(reach / length, -1.0, 1.0)), wrapped(near[1]))
    return rise - length * jnp.sin(pitch), pitch


def two_angles(half_lengths: Pair[Scalar], reach: Scalar, rise: Scalar, elbow: Scalar) -> tuple[Scalar, Scalar]:
    """Angles [rad] of two links that put their tip at ``reach`` and ``rise`` from where the first is hinged [m].

    Args:
        half_lengths: of both links [m].
        reach: of the tip [m].
        rise: likewise [m].
        elbow: any number with the wanted sign of the second angle.
    """
    A, B = 2.0 * half_lengths[0], 2.0 * half_lengths[1]
    cosine = (reach**2 + rise**2 - A**2 - B**2) / (2.0 * A * B)
    # Out of reach the arm is stretched; the rollout then says so, as the constraint cannot be met.
    second = jnp.copysign(jnp.arccos(jnp.clip(cosine, -1.0, 1.0)), elbow)
    first = jnp.arctan2(rise, reach) - jnp.arctan2(B * jnp.sin(second), A + B * jnp.cos(second))
    return first, second


def _of(geometry: Geometry) -> AnyArm:
    assert geometry.arm is not None
    return geometry.arm

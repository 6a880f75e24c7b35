"""The object's surface, a concave arc about C = p2 - Rc e2: where tip I stands on it, and how it moves."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import minus
from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import Position, Posture, tip_position
from coopmm_jax.parameters import Geometry, Hardware, Surface


class Contact(NamedTuple):
    """D = p1 - C from the arc's centre C = p2 - Rc e2 to tip I, along both arms' own axes (e, n) [m]."""

    D1: Vector  # (2,) along arm I
    D2: Vector  # (2,) along arm II
    turn: tuple[Scalar, Scalar]  # sine and cosine of arm I's direction less arm II's
    tip2: Vector  # (2,) along arm II


class SurfaceMotion(NamedTuple):
    """The arc's radius now, and dphi/dt, d2phi/dt2 of the normal row at fixed robots [m, m/s, m/s^2]."""

    radius: Scalar
    phi_rate: Scalar
    phi_acceleration: Scalar


def contact(surface: Surface, geometry: Pair[Geometry], position: Pair[Position], arms: Pair[Posture]) -> Contact:
    """Place of tip I on the arc about C = p2 - Rc e2; lengths in [m]."""
    tip1, tip2 = per_robot(tip_position, geometry, position, arms)
    one, two = position
    s, c = sincos((one.z1 - two.z1) + (one.a1 - two.a1))
    centre = to_arm1((s, c), (tip2[0] - surface.contact_radius, tip2[1]))
    D1 = minus(tip1, centre)
    D2 = (c * D1[0] - s * D1[1], s * D1[0] + c * D1[1])
    return Contact(D1, D2, (s, c), tip2)


def to_arm1(turn: tuple[Scalar, Scalar], vector: Vector) -> Vector:
    """A horizontal vector (2,) given along arm II's axes, along arm I's."""
    s, c = turn
    return c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]


def surface_motion(hardware: Hardware, surface: Surface, t: Scalar) -> SurfaceMotion:
    """The moving arc's radius, and the first two partial time derivatives of the normal row's phi, at t [s]."""
    angle = hardware.surface_frequency * t + hardware.surface_phase
    s, c = sincos(angle)
    radius = surface.contact_radius + hardware.surface_amplitude * s
    rate = hardware.surface_amplitude * hardware.surface_frequency * c
    acceleration = -hardware.surface_amplitude * hardware.surface_frequency**2 * s
    Rc = surface.contact_radius
    return SurfaceMotion(radius, radius * rate / Rc, (rate * rate + radius * acceleration) / Rc)

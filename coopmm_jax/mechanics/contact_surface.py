"""The two arms where they meet on the object's surface, and how the surface moves."""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.parameters import Hardware

NormalRow = tuple[Scalar, Vector, Vector]  # phi [m], and its gradient in the body rates (5,) of robot I and of II


class SurfaceMotion(NamedTuple):
    """Distance by which the surface has given way at the object, and its rates [m, m/s, m/s^2]."""

    shift: Scalar
    rate: Scalar
    acceleration: Scalar


def arms_apart(position: Pair[Position]) -> tuple[Scalar, Scalar]:
    """Sine and cosine, as scalars, of arm I's direction less arm II's."""
    one, two = position
    return sincos((one.z1 - two.z1) + (one.a1 - two.a1))


def turning_rate(row: Vector) -> Vector:
    """Row (n,) of an arm's yaw rate W in its robot's body rates, of which ``row`` is another."""
    return (0, 0, 1, *(0,) * (len(row) - 3))


def to_arm1(turn: tuple[Scalar, Scalar], vector: Vector) -> Vector:
    """A horizontal vector (2,) given along arm II's axes, along arm I's."""
    s, c = turn
    return c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]


def to_arm2(turn: tuple[Scalar, Scalar], vector: Vector) -> Vector:
    """A horizontal vector (2,) given along arm I's axes, along arm II's."""
    s, c = turn
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]


def surface_motion(hardware: Hardware, t: Scalar) -> SurfaceMotion:
    """Motion of the surface at t [s]: an arc's radius grows, any other surface moves back along arm II."""
    angle = hardware.surface_frequency * t + hardware.surface_phase
    s, c = sincos(angle)
    return SurfaceMotion(
        hardware.surface_amplitude * s,
        hardware.surface_amplitude * hardware.surface_frequency * c,
        -hardware.surface_amplitude * hardware.surface_frequency**2 * s,
    )

"""The constraint rows behind (10): residual phi, Jacobian J, and Jdot u, row by row.

``contact_normal`` and ``contact_height`` tie the tip of robot I to the object carried by robot II; ``guide_radial`` and
``guide_height`` hold robot II's tip, the object, on its circle. Tips and the arc's centre are handled along the two
arms' own horizontal axes (e along the arm, n across), so only the angle between the arms meets a sine.
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import Matrix, Scalar, Vector, dot, minus, plus, scaled, sincos, sub
from coopmm_jax.mechanics import robot_kinematics
from coopmm_jax.parameters import Geometry, Hardware, Surface

JOINTS = 5  # velocities u of one robot: u1, u2, a1dot, a2dot, a3dot


class Contact(NamedTuple):
    """D = p1 - C from the arc's centre C = p2 - Rc e2 to tip I, along both arms' own axes (e, n)."""

    D1: tuple[Scalar, Scalar]
    D2: tuple[Scalar, Scalar]
    turn: tuple[Scalar, Scalar]  # sine and cosine of arm I's direction less arm II's
    tip2: tuple[Scalar, Scalar]


class Bodies(NamedTuple):
    """Both robots' kinematics at one instant (each field but the contact a pair, robot I and II)."""

    position: tuple[robot_kinematics.Position, robot_kinematics.Position]
    arm: tuple[robot_kinematics.Posture, robot_kinematics.Posture]
    T: tuple[Matrix, Matrix]  # body rates from u
    tip: tuple[tuple[Vector, Vector, Vector], tuple[Vector, Vector, Vector]]  # Jacobian rows along e, n, up
    contact: Contact


class Rows(NamedTuple):
    """The constraint rows: residual phi [m], Jacobian blocks J1, J2 (m x 5 each) in u."""

    phi: Vector
    J: tuple[Matrix, Matrix]
    contacts: int  # rows that act on both robots; the rest act on robot II
    contact_point: Vector  # D = p1 - C along arm II's axes (e, n) [m]


class SurfaceMotion(NamedTuple):
    """The arc's radius now, and dphi/dt, d2phi/dt2 of the normal row at fixed robots [m, m/s, m/s^2]."""

    radius: Scalar
    phi_rate: Scalar
    phi_acceleration: Scalar


def bodies(
    surface: Surface,
    geometry: tuple[Geometry, Geometry],
    position: tuple[robot_kinematics.Position, robot_kinematics.Position],
) -> Bodies:
    """Kinematics shared by inertia, constraints and control."""
    arms = tuple(robot_kinematics.posture(g, p) for g, p in zip(geometry, position, strict=True))
    return Bodies(
        position,
        arms,
        tuple(robot_kinematics.body_map(p) for p in position),
        tuple(robot_kinematics.tip_rows(g, a) for g, a in zip(geometry, arms, strict=True)),
        _contact(surface, geometry, position, arms),
    )


def _contact(surface: Surface, geometry: tuple[Geometry, Geometry], position: tuple, arms: tuple) -> Contact:
    tip1, tip2 = (robot_kinematics.tip_position(g, p, a) for g, p, a in zip(geometry, position, arms, strict=True))
    one, two = position
    s, c = sincos((one.z1 - two.z1) + (one.a1 - two.a1))
    centre = _to_arm1((s, c), (tip2[0] - surface.contact_radius, tip2[1]))
    D1 = minus(tip1, centre)
    D2 = (c * D1[0] - s * D1[1], s * D1[0] + c * D1[1])
    return Contact(D1, D2, (s, c), tip2)


def _to_arm1(turn: tuple[Scalar, Scalar], vector: Vector) -> Vector:
    """A horizontal vector given along arm II's axes, along arm I's."""
    s, c = turn
    return c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]


def constraint_rows(surface: Surface, names: tuple[str, ...], b: Bodies, radius: Scalar | None = None) -> Rows:
    """phi and J of the rows in force; J u = 0, or J u = -dphi/dt where the surface moves.

    Args:
        names: constraint rows, in the order of ``ALL_ROWS``. radius: of the arc now [m], where it is not its nominal
            Rc.
    """
    Rc, Rg = surface.contact_radius, surface.guide_radius
    now = Rc if radius is None else radius
    contact, ((e1, n1, up1), (e2, n2, up2)) = b.contact, b.tip
    n_centre = (*n2[:2], sub(n2[2], Rc), *n2[3:])  # the centre's velocity across arm II: tip's less Rc times arm yaw
    none = (0,) * JOINTS
    p = contact.tip2
    table = {
        "contact_normal": (
            (now * now - dot(contact.D1, contact.D1)) / (2.0 * Rc),
            scaled(-1.0 / Rc, plus(scaled(contact.D1[0], e1), scaled(contact.D1[1], n1))),
            scaled(1.0 / Rc, plus(scaled(contact.D2[0], e2), scaled(contact.D2[1], n_centre))),
        ),
        "contact_height": (b.arm[0].height - b.arm[1].height, up1, tuple(sub(0, x) for x in up2)),
        "guide_radial": (
            (dot(p, p) - Rg * Rg) / (2.0 * Rg),
            none,
            scaled(1.0 / Rg, plus(scaled(p[0], e2), scaled(p[1], n2))),
        ),
        "guide_height": (b.arm[1].height - surface.guide_height, none, up2),
    }
    phi, J1, J2 = zip(*(table[name] for name in names), strict=True)
    contacts = sum(name.startswith("contact") for name in names)
    return Rows(phi, (Matrix(J1) @ b.T[0], Matrix(J2) @ b.T[1]), contacts, contact.D2)


def sliding_rows(surface: Surface, b: Bodies) -> tuple[Vector, Vector]:
    """Rows (5,) of each robot in u whose sum is the speed at which tip I slides along the arc [m/s].

    The surface turns with arm II, so its point at the contact moves at p2dot + W2 x (p1 - p2).
    """
    Rc = surface.contact_radius
    (e1, n1, _), (e2, n2, _) = b.tip
    yaw = (0, 0, 1, 0, 0)
    D1, D2 = b.contact.D1, b.contact.D2
    along = plus(e2, scaled(-D2[1], yaw))
    across = plus(n2, scaled(D2[0] - Rc, yaw))
    slide1 = plus(scaled(-D1[1] / Rc, e1), scaled(D1[0] / Rc, n1))
    slide2 = plus(scaled(D2[1] / Rc, along), scaled(-D2[0] / Rc, across))
    return b.T[0].T @ slide1, b.T[1].T @ slide2


def surface_motion(hardware: Hardware, surface: Surface, t: Scalar) -> SurfaceMotion:
    """The moving arc's radius, and the first two partial time derivatives of the normal row's phi, at t [s]."""
    angle = hardware.surface_frequency * t + hardware.surface_phase
    s, c = sincos(angle)
    radius = surface.contact_radius + hardware.surface_amplitude * s
    rate = hardware.surface_amplitude * hardware.surface_frequency * c
    acceleration = -hardware.surface_amplitude * hardware.surface_frequency**2 * s
    Rc = surface.contact_radius
    return SurfaceMotion(radius, radius * rate / Rc, (rate * rate + radius * acceleration) / Rc)


def convective(
    surface: Surface,
    geometry: tuple[Geometry, Geometry],
    names: tuple[str, ...],
    b: Bodies,
    velocity: tuple[Vector, Vector],
) -> Vector:
    """Jdot u (m,) [m/s^2]: acceleration of the rows when udot = 0. ``velocity`` is u of each robot (5,)."""
    Rc, contact = surface.contact_radius, b.contact
    rates = tuple(T @ u for T, u in zip(b.T, velocity, strict=True))
    speed = tuple(tuple(dot(row, w) for row in rows) for rows, w in zip(b.tip, rates, strict=True))
    acceleration = tuple(
        robot_kinematics.tip_bias(g, a, w, robot_kinematics.body_map_rate(p, u))
        for g, p, a, w, u in zip(geometry, b.position, b.arm, rates, velocity, strict=True)
    )
    (v1, v2), (a1, a2), W2 = speed, acceleration, rates[1][2]
    D_rate = minus(v1[:2], _to_arm1(contact.turn, (v2[0], v2[1] - Rc * W2)))
    D_acceleration = minus(a1[:2], _to_arm1(contact.turn, (a2[0] + Rc * W2 * W2, a2[1])))
    table = {
        "contact_normal": -(dot(D_rate, D_rate) + dot(contact.D1, D_acceleration)) / Rc,
        "contact_height": a1[2] - a2[2],
        "guide_radial": (dot(v2[:2], v2[:2]) + dot(contact.tip2, a2[:2])) / surface.guide_radius,
        "guide_height": a2[2],
    }
    return tuple(table[name] for name in names)

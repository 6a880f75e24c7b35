"""The constraint rows behind (10): residual phi, Jacobian J, and Jdot u, row by row.

``contact_normal`` and ``contact_height`` tie the tip of robot I to the object carried by robot II; ``guide_radial``
and ``guide_height`` hold robot II's tip, the object, on its circle or another path (``guide.py``). Tips and the arc's
centre are handled along the two arms' own horizontal axes (e along the arm, n across), so only the angle between the
arms meets a sine.
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import Matrix, dot, plus, scaled, sub
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics import robot_kinematics
from coopmm_jax.mechanics.arc_contact import ArcContact, arc_contact
from coopmm_jax.mechanics.contact_surface import SurfaceMotion
from coopmm_jax.mechanics.coordinates import AnyPosition, Position
from coopmm_jax.mechanics.guide import GuideFrame, Track, guide_frame, sideways, sideways_bias, sideways_row
from coopmm_jax.mechanics.level_contact import LevelContact, level_contact
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import AnyPosture
from coopmm_jax.parameters import Geometry, Surface


class Bodies(NamedTuple):
    """Both robots' kinematics at one instant (each field but the last two a pair, robot I and II)."""

    position: Pair[AnyPosition]
    place: Pair[Position]  # the same in the coordinates of (6)
    arm: Pair[AnyPosture]
    T: Pair[Matrix]  # body rates from u
    tip: Pair[tuple[Vector, Vector, Vector]]  # Jacobian rows along e, n, up
    contact: ArcContact | LevelContact
    guide: GuideFrame | None = None  # None: the circle


class Rows(NamedTuple):
    """The constraint rows: residual phi [m], Jacobian blocks J1, J2 (m x 5 each) in u."""

    phi: Vector
    J: Pair[Matrix]
    contacts: int  # rows that act on both robots; the rest act on robot II
    contact_point: Vector  # tip I from the arc's centre, else from the object, along arm II's axes (e, n) [m]


def bodies(
    surface: Surface, geometry: Pair[Geometry], position: Pair[AnyPosition], track: Track | None = None
) -> Bodies:
    """Kinematics shared by inertia, constraints and control; ``track`` guides the object, if not the circle."""
    place = per_robot(robot_kinematics.placed, geometry, position)
    arms = per_robot(robot_kinematics.posture, geometry, place)
    tips = per_robot(robot_kinematics.tip_position, geometry, place, arms)
    return Bodies(
        position,
        place,
        arms,
        per_robot(robot_kinematics.body_map, geometry, position),
        per_robot(robot_kinematics.tip_rows, geometry, arms),
        _contact(surface, place, tips),
        None if track is None else guide_frame(track, place[1], tips[1]),
    )


def _contact(surface: Surface, position: Pair[Position], tips: Pair[Vector]) -> ArcContact | LevelContact:
    if surface.shape is None:
        return arc_contact(surface, position, tips)
    return level_contact(surface.shape, position, tips)


def constraint_rows(surface: Surface, names: tuple[str, ...], b: Bodies, motion: SurfaceMotion | None = None) -> Rows:
    """phi and J of the rows in force; J u = 0, or J u = -dphi/dt where the surface moves.

    Args:
        surface: the coupling's lengths [m].
        names: constraint rows, in the order of ``ALL_ROWS``.
        b: both robots' kinematics.
        motion: of the object's surface now, where it moves.
    """
    Rg, at, (_, _, up1), (e2, n2, up2) = surface.guide_radius, b.contact, *b.tip
    none = (0,) * len(up1)
    p = at.tip2
    table = {
        "contact_normal": at.normal_row(b.tip, motion),
        "contact_height": (b.arm[0].height - b.arm[1].height, up1, tuple(sub(0, x) for x in up2)),
        "guide_radial": (
            (dot(p, p) - Rg * Rg) / (2.0 * Rg),
            none,
            scaled(1.0 / Rg, plus(scaled(p[0], e2), scaled(p[1], n2))),
        ),
        "guide_height": (b.arm[1].height - surface.guide_height, none, up2),
    }
    if b.guide is not None:
        table["guide_radial"] = (sideways(b.guide), none, sideways_row(b.guide, e2, n2))
    phi, J1, J2 = tuple(zip(*(table[name] for name in names), strict=True)) or ((),) * 3
    contacts = sum(name.startswith("contact") for name in names)
    return Rows(phi, (Matrix(J1) @ b.T[0], Matrix(J2) @ b.T[1]), contacts, at.point)


def distance_row(b: Bodies, motion: SurfaceMotion | None = None) -> tuple[Scalar, Pair[Vector]]:
    """phi [m] of the contact's normal row, on the surface or off it, and its Jacobian in u, (5,) of each robot."""
    phi, *rows = b.contact.distance_row(b.tip, motion)
    return phi, per_robot(lambda T, row: T.T @ row, b.T, rows)


def sliding_rows(b: Bodies) -> Pair[Vector]:
    """Rows (5,) of each robot in u whose sum is the speed at which tip I slides along the surface [m/s].

    The surface turns with arm II, so its point at the contact moves at p2dot + W2 x (p1 - p2).
    """
    return per_robot(lambda T, row: T.T @ row, b.T, b.contact.sliding_rows(b.tip))


def convective(
    surface: Surface,
    geometry: Pair[Geometry],
    names: tuple[str, ...],
    b: Bodies,
    velocity: Pair[Vector],
    T_rate: Pair[Vector],
) -> Vector:
    """Jdot u (m,) [m/s^2]: acceleration of the rows when udot = 0.

    Args:
        surface: the coupling's lengths [m].
        geometry: of both robots.
        names: constraint rows.
        b: both robots' kinematics.
        velocity: u of each robot (5,).
        T_rate: Tdot u of each robot (5,).
    """
    at = b.contact
    rates = per_robot(lambda T, u: T @ u, b.T, velocity)
    v1, v2 = per_robot(lambda rows, w: tuple(dot(row, w) for row in rows), b.tip, rates)
    a1, a2 = per_robot(robot_kinematics.tip_bias, geometry, b.arm, rates, T_rate)
    table = {
        "contact_normal": at.bias((v1, v2), (a1, a2), rates[1][2]),
        "contact_height": a1[2] - a2[2],
        "guide_radial": (dot(v2[:2], v2[:2]) + dot(at.tip2, a2[:2])) / surface.guide_radius,
        "guide_height": a2[2],
    }
    if b.guide is not None:
        table["guide_radial"] = sideways_bias(b.guide, v2[:2], a2[:2])
    return tuple(table[name] for name in names)

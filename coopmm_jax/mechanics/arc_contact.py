"""The contact's normal row of (10) on the paper's surface, a concave arc about C = p2 - Rc e2, in its own short form.

``level_contact`` says the same of any other surface, with the same methods.
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.matrix import dot, minus, plus, scaled, sub
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.contact_surface import NormalRow, SurfaceMotion, arms_apart, to_arm1, to_arm2, turning_rate
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.parameters import Surface


class ArcContact(NamedTuple):
    """D = p1 - C from the arc's centre C to tip I, along both arms' own axes (e, n) [m]."""

    D1: Vector  # (2,) along arm I
    D2: Vector  # (2,) along arm II
    turn: tuple[Scalar, Scalar]  # sine and cosine of arm I's direction less arm II's
    tip2: Vector  # (2,) along arm II
    radius: Scalar  # Rc

    @property
    def point(self) -> Vector:
        """Tip I from the arc's centre, along arm II's axes (2,) [m]."""
        return self.D2

    @property
    def facing(self) -> Scalar:
        """Tip I along arm II from the centre [m]: positive on the half circle through the object, the surface."""
        return self.D2[0]

    def normal_row(self, tip: Pair, motion: SurfaceMotion | None) -> NormalRow:
        """phi = (Rc^2 - |D|^2)/(2 Rc) and its gradients; ``tip`` holds both tips' rows (5,) along e, n and up."""
        Rc = self.radius
        now = Rc if motion is None else Rc + motion.shift
        (e1, n1, _), (e2, n2, _) = tip
        n_centre = (
            *n2[:2],
            sub(n2[2], Rc),
            *n2[3:],
        )  # of the centre, which arm II's yaw carries along
        return (
            (now * now - dot(self.D1, self.D1)) / (2.0 * Rc),
            scaled(-1.0 / Rc, plus(scaled(self.D1[0], e1), scaled(self.D1[1], n1))),
            scaled(1.0 / Rc, plus(scaled(self.D2[0], e2), scaled(self.D2[1], n_centre))),
        )

    distance_row = normal_row  # which has all derivatives

    def phi_rates(self, motion: SurfaceMotion) -> tuple[Scalar, Scalar]:
        """dphi/dt and d2phi/dt2 at fixed robots [m/s, m/s^2]."""
        Rc, radius, rate = self.radius, self.radius + motion.shift, motion.rate
        return radius * rate / Rc, (rate * rate + radius * motion.acceleration) / Rc

    def bias(self, v: Pair[Vector], a: Pair[Vector], W2: Scalar) -> Scalar:
        """Jdot u of the row [m/s^2].

        Args:
            v: velocities of both tips along their own arm's axes [m/s].
            a: their accelerations when udot = 0 [m/s^2].
            W2: yaw rate of arm II [rad/s].
        """
        Rc, (v1, v2), (a1, a2) = self.radius, v, a
        D_rate = minus(v1[:2], to_arm1(self.turn, (v2[0], v2[1] - Rc * W2)))
        D_acceleration = minus(a1[:2], to_arm1(self.turn, (a2[0] + Rc * W2 * W2, a2[1])))
        return -(dot(D_rate, D_rate) + dot(self.D1, D_acceleration)) / Rc

    def sliding_rows(self, tip: Pair) -> Pair[Vector]:
        """Rows (5,) in body rates of each robot whose sum is the speed of tip I along the arc [m/s]."""
        (e1, n1, _), (e2, n2, _) = tip
        Rc, D1, D2, yaw = self.radius, self.D1, self.D2, turning_rate(e2)
        along = plus(e2, scaled(-D2[1], yaw))
        across = plus(n2, scaled(D2[0] - Rc, yaw))
        slide1 = plus(scaled(-D1[1] / Rc, e1), scaled(D1[0] / Rc, n1))
        slide2 = plus(scaled(D2[1] / Rc, along), scaled(-D2[0] / Rc, across))
        return slide1, slide2


def arc_contact(surface: Surface, position: Pair[Position], tips: Pair[Vector]) -> ArcContact:
    """Place of tip I on the arc.

    Args:
        surface: the coupling's lengths [m].
        position: of both robots.
        tips: of both arms from the world's origin, along their own axes (2,) [m].
    """
    turn, (tip1, tip2) = arms_apart(position), tips
    centre = to_arm1(turn, (tip2[0] - surface.contact_radius, tip2[1]))
    D1 = minus(tip1, centre)
    return ArcContact(D1, to_arm2(turn, D1), turn, tip2, surface.contact_radius)

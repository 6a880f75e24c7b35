"""The contact's normal row of (10) on any surface F(e, n) = 0: phi = F/|grad F|, its gradient, and Jdot u.

X = p1 - p2 is the tip of robot I from the object, along arm II's axes. As these turn with arm II,

    X' = v + W2 S X,   X'' = a + 2 W2 S v - W2^2 X,   S = [[0, 1], [-1, 0]],

v and a being tip I's velocity and acceleration less tip II's. Derivatives of 1/|grad F| are left out: they stand
beside F and its rate, which vanish in contact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import dot, minus, plus, scaled
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.mechanics.contact_surface import NormalRow, SurfaceMotion, arms_apart, to_arm1, to_arm2, turning_rate
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.mechanics.surfaces import Shape


class LevelContact(NamedTuple):
    """Tip I against the surface; all but the gradient along arm I in the axes of arm II."""

    shape: Shape
    point: Vector  # X (2,) [m]
    turn: tuple[Scalar, Scalar]  # sine and cosine of arm I's direction less arm II's
    tip2: Vector  # (2,) [m]
    level: Scalar  # F [m]
    gradient: Vector  # (2,)
    gradient1: Vector  # (2,) along arm I
    size: Scalar  # of the gradient; 1 where F is a distance

    @property
    def facing(self) -> Scalar:
        """-dF/de [-]: positive on the surface through the object, negative on the far side of a closed level."""
        return -self.gradient[0]

    def normal_row(self, tip: Pair, motion: SurfaceMotion | None) -> NormalRow:
        """phi = F/|grad F| and its gradients; ``tip`` holds both tips' rows (5,) along e, n and up."""
        level = self.level if motion is None else self.level + motion.shift
        inverse = 1.0 / self.size
        return level * inverse, *self._rows(tip, scaled(inverse, self.gradient), scaled(inverse, self.gradient1))

    def distance_row(self, tip: Pair, motion: SurfaceMotion | None) -> NormalRow:
        """``normal_row`` with all derivatives of phi [m], off the surface too: the potential of an elastic force."""

        def phi(e: Scalar, n: Scalar) -> Scalar:
            level, *gradient = _value_and_gradient(self.shape.level, e, n)
            return (level if motion is None else level + motion.shift) / _size(gradient)

        value, *gradient = _value_and_gradient(phi, *self.point)
        return value, *self._rows(tip, gradient, to_arm1(self.turn, tuple(gradient)))

    def _rows(self, tip: Pair, gradient: Sequence[Scalar], gradient1: Vector) -> Pair[Vector]:
        """Gradient along arm II's axes, and along arm I's, as rows (5,) in the body rates of both robots."""
        (e1, n1, _), (e2, n2, _) = tip
        (g, h), X = gradient, self.point
        turning = scaled(g * X[1] - h * X[0], turning_rate(e2))  # X turns against arm II
        return (
            plus(scaled(gradient1[0], e1), scaled(gradient1[1], n1)),
            minus(turning, plus(scaled(g, e2), scaled(h, n2))),
        )

    def phi_rates(self, motion: SurfaceMotion) -> tuple[Scalar, Scalar]:
        """dphi/dt and d2phi/dt2 at fixed robots [m/s, m/s^2]."""
        return motion.rate / self.size, motion.acceleration / self.size

    def bias(self, v: Pair[Vector], a: Pair[Vector], W2: Scalar) -> Scalar:
        """Jdot u of the row [m/s^2], as ``ArcContact.bias``."""
        X = self.point
        v_rel = minus(to_arm2(self.turn, v[0][:2]), v[1][:2])
        a_rel = minus(to_arm2(self.turn, a[0][:2]), a[1][:2])
        X_rate = (v_rel[0] + W2 * X[1], v_rel[1] - W2 * X[0])
        X_acceleration = (
            a_rel[0] + 2.0 * W2 * v_rel[1] - W2 * W2 * X[0],
            a_rel[1] - 2.0 * W2 * v_rel[0] - W2 * W2 * X[1],
        )

        def level_rate(X: Vector, X_rate: Vector) -> Scalar:
            return jax.jvp(self.shape.level, X, X_rate)[1]

        # Several velocities may be tried at one place, of which jvp wants as many.
        e, n, *_ = jnp.broadcast_arrays(*X, *X_rate)
        return jax.jvp(level_rate, ((e, n), X_rate), (X_rate, X_acceleration))[1] / self.size

    def sliding_rows(self, tip: Pair) -> Pair[Vector]:
        """Rows (5,) in body rates of each robot whose sum is the speed of tip I along the surface [m/s]."""
        (e1, n1, _), (e2, n2, _) = tip
        (g, h), (g1, h1), X, inverse = self.gradient, self.gradient1, self.point, 1.0 / self.size
        yaw = turning_rate(e2)
        along, across = plus(e2, scaled(-X[1], yaw)), plus(n2, scaled(X[0], yaw))
        return (
            scaled(inverse, plus(scaled(h1, e1), scaled(-g1, n1))),
            scaled(inverse, plus(scaled(-h, along), scaled(g, across))),
        )


def level_contact(shape: Shape, position: Pair[Position], tips: Pair[Vector]) -> LevelContact:
    """Place of tip I against a surface; ``tips`` are (2,) [m], as ``arc_contact`` takes them."""
    turn, (tip1, tip2) = arms_apart(position), tips
    X = minus(to_arm2(turn, tip1), tip2)
    level, *gradient = _value_and_gradient(shape.level, *X)
    g, h = gradient
    return LevelContact(shape, X, turn, tip2, level, (g, h), to_arm1(turn, (g, h)), _size(gradient))


def _value_and_gradient(function: Callable[[Scalar, Scalar], Scalar], e: Scalar, n: Scalar) -> Vector:
    """Value of a function of (e, n), and its derivative along each."""
    one = e * 0.0 + 1.0
    value, g = jax.jvp(lambda e: function(e, n), (e,), (one,))
    _, h = jax.jvp(lambda n: function(e, n), (n,), (one,))
    return value, g, h


def _size(gradient: Sequence[Scalar]) -> Scalar:
    return jnp.sqrt(dot(gradient, gradient))

"""Coordinates of one robot: chained ones of its platform, then the joints of its arm, as many as it has.

>>> at_place((0.0, 2.4, 0.0), (1.2, -0.8, 1.6, 0.4))
Position(z1=0.0, z2=2.4, z3=0.0, a1=1.2, a2=-0.8, a3=1.6, a4=0.4)
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from operator import itemgetter
from typing import Any, NamedTuple, TypeVar

from coopmm_jax.algebra.types import Scalar, Vector


class Position(NamedTuple):
    """Chained coordinates [rad, m, m] and joint angles [rad] of one robot; also used for their rates."""

    z1: Scalar
    z2: Scalar
    z3: Scalar
    a1: Scalar
    a2: Scalar
    a3: Scalar


class LongPosition(NamedTuple):
    """Chained coordinates, z1 [rad], z2, z3, z4 [unit], and joint angles [rad] of one robot; also for their rates."""

    z1: Scalar
    z2: Scalar
    z3: Scalar
    z4: Scalar
    a1: Scalar
    a2: Scalar
    a3: Scalar


AnyPosition = Position | LongPosition
Kind = TypeVar("Kind", Position, LongPosition)
_ARM_JOINTS = 3  # of the classes above


def at_place(place: Vector, joints: Vector) -> Position:
    """Position from coordinates of (6) (3,) and joints of any number (k,)."""
    return with_joints(Position, place, joints)


def with_joints(kind: type[Kind], platform: Vector, joints: Vector) -> Kind:
    """Position of a kind, or of a kind like it where the arm has another number of joints.

    Args:
        kind: ``Position`` or ``LongPosition``.
        platform: chained coordinates (3,) or (4,).
        joints: of the arm (k,).
    """
    return like(kind, len(joints))(*platform, *joints)


def arm_of(position: AnyPosition) -> Vector:
    """Joints of the arm (k,) [rad], a lift's in [m]."""
    return position[platform_of(position) :]


def platform_of(position: AnyPosition) -> int:
    """Number of chained coordinates."""
    return 4 if isinstance(position, LongPosition) else 3


@functools.cache
def like(kind: type[Kind], joints: int) -> type[Kind]:
    """Class of positions of a kind for arms with so many joints, a1 to ak."""
    if joints == _ARM_JOINTS:
        return kind
    names = (*kind._fields[:-_ARM_JOINTS], *(f"a{i}" for i in range(1, joints + 1)))
    return _made(kind, names)


def _made(kind: type[Any], names: tuple[str, ...]) -> Any:
    def new(cls: type, *values: Scalar) -> Any:
        return tuple.__new__(cls, values)

    def make(cls: type, values: Iterable[Scalar]) -> Any:
        return tuple.__new__(cls, values)

    def text(self: tuple) -> str:
        return f"{kind.__name__}({', '.join(f'{name}={value!r}' for name, value in zip(names, self, strict=True))})"

    own = {name: property(itemgetter(place)) for place, name in enumerate(names)}
    about = {"__new__": new, "_make": classmethod(make), "__repr__": text, "_fields": names, "__slots__": ()}
    return type(kind.__name__, (kind,), about | own)

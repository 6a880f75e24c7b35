"""One robot in numbers: how many velocities, coordinates and actuators it has, and in which order.

>>> of_each_actuator("wheel", "joint")
('wheel', 'wheel', 'joint', 'joint', 'joint')
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from coopmm_jax.algebra.types import Pair, T

PLATFORM = 2  # velocities u1, u2 of the platform, before those of the arm
ARM_JOINTS = 3  # yaw, then two pitch joints
JOINTS = PLATFORM + ARM_JOINTS  # velocities u of (9)
PITCH_JOINTS = (3, 4)  # of the arm, a2 and a3, among u
CHAINED = 3  # coordinates z1, z2, z3 of the platform, before the arm's angles
COORDINATES = CHAINED + ARM_JOINTS
WHEELS = 2  # right, left: actuators before those of the arm's joints
ACTUATORS = WHEELS + ARM_JOINTS
ROBOTS = 2


def of_each_actuator(wheel: T, joint: T) -> tuple[T, ...]:
    """One value for each actuator of a robot (5,)."""
    return (wheel,) * WHEELS + (joint,) * ARM_JOINTS


def by_robot(actuators: Sequence[T]) -> Pair[tuple[T, ...]]:
    """Values of both robots' actuators (10,), as (5,) of each."""
    return tuple(actuators[:ACTUATORS]), tuple(actuators[ACTUATORS:])


def per_robot(function: Callable[..., T], *pairs: Sequence[Any]) -> Pair[T]:
    """``function`` of robot I's entries of some pairs, and of robot II's.

    >>> per_robot(max, (1, 4), (2, 3))
    (2, 4)
    """
    first, second = map(function, *pairs)
    return first, second

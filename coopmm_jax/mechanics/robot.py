"""One robot in numbers: how many velocities, coordinates and actuators it has, and in which order.

These are of the paper's arm; ``Structure.joints`` has the numbers of other arms, whose further joints come last.

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
YAW = PLATFORM  # place of the arm's yaw among u, before the joints that lift and pitch
CHAINED = 3  # coordinates z1, z2, z3 of the platform, before the arm's angles
WHEELS = 2  # right, left: actuators before those of the arm's joints, so as many as velocities
ROBOTS = 2


def of_each_actuator(wheel: T, joint: T, count: int = JOINTS) -> tuple[T, ...]:
    """One value for each of a robot's actuators, as many as ``count``."""
    return (wheel,) * WHEELS + (joint,) * (count - WHEELS)


def by_robot(actuators: Sequence[T], first: int) -> Pair[tuple[T, ...]]:
    """Values of both robots' actuators, as those of each; ``first`` are robot I's."""
    return tuple(actuators[:first]), tuple(actuators[first:])


def per_robot(function: Callable[..., T], *pairs: Sequence[Any]) -> Pair[T]:
    """``function`` of robot I's entries of some pairs, and of robot II's.

    >>> per_robot(max, (1, 4), (2, 3))
    (2, 4)
    """
    first, second = map(function, *pairs)
    return first, second

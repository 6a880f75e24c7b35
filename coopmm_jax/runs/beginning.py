"""Beginning of a reference: what to tell of it where a start is out of reach, or far from it and fails."""

from __future__ import annotations

import math
import warnings
from typing import Any

import jax

from coopmm_jax.algebra.types import Pair, Scalar
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.errors import Notice
from coopmm_jax.mechanics.coordinates import at_place
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import unchained
from coopmm_jax.parameters import Parameters, PathReference, Pose

_DISTANT = 0.5  # [m, rad] from where a reference begins: the paper's own start is 0.2 m away
AIMED_AT = ("x", "y", "th", "a1")  # what a reference says of a pose


def beginning(parameters: Parameters) -> Pair[Pose]:
    """Poses at which the reference begins, with the start's own pitches of the arms.

    >>> beginning(Parameters())[0].x
    2.4
    """
    with jax.enable_x64(True):
        poses = per_robot(
            lambda aim, start: start._replace(**_aimed(aim)),
            desired_motion(parameters.reference, 0.0),
            parameters.start,
        )
        return jax.tree.map(float, poses)


def warn_of_distant_start(parameters: Parameters) -> None:
    """Say of a run that failed that it began far from its path, where the reason may lie.

    Warns:
        Notice: where the reference begins.

    >>> warn_of_distant_start(Parameters())  # circles, which start anywhere
    """
    if not isinstance(parameters.reference, PathReference):
        return
    begins = beginning(parameters)
    both = list(zip(begins, parameters.start, strict=True))
    away = max(math.hypot(a.x - b.x, a.y - b.y) for a, b in both)
    turned = max(abs(math.remainder(a.th - b.th, 2.0 * math.pi)) for a, b in both)
    if max(away, turned) > _DISTANT:
        text = f"initial: up to {away:.2g} m and {turned:.2g} rad from where the reference begins"
        warnings.warn(Notice(f"{text}, {told(begins, AIMED_AT)}"), stacklevel=3)


def told(poses: Pair[Pose], names: tuple[str, ...] = Pose._fields) -> str:
    """Poses in one line, or of each the coordinates of these names.

    >>> told(Parameters().start, ("x", "y"))
    '(x 2.5, y 0) and (x 1.2, y 0)'
    """
    given = ([(name, getattr(pose, name)) for name in names if not _replaced(pose, name)] for pose in poses)
    each = (", ".join(f"{name} {_number(x)}" for name, x in pose if x is not None) for pose in given)
    return " and ".join(f"({pose})" for pose in each)


def _aimed(aim: Desired) -> dict[str, Scalar]:
    x, y, th, a1 = unchained(at_place((aim.z1, aim.z2, aim.z3), (aim.arm[0],)))
    return {"x": x, "y": y, "th": th, "a1": a1}


def _replaced(pose: Pose, name: str) -> bool:
    """True for a2 and a3 of an arm whose joints are told one by one."""
    return pose.arm is not None and name in ("a2", "a3")


def _number(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_number, value))}]"
    return f"{round(value, 9) + 0.0:g}"

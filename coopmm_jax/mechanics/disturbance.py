"""Disturbance d of (1): torques against the actuators and a force on the object, which nobody measures."""

from __future__ import annotations

from typing import Any, NamedTuple

from coopmm_jax.algebra.matrix import minus, plus, scaled
from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.kinds.disturbances import Disturbance
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.robot import JOINTS, of_each_actuator, per_robot
from coopmm_jax.mechanics.robot_kinematics import actuator_force


class Disturbing(NamedTuple):
    """All disturbances at one time."""

    torque: Pair[Vector] | None  # against each robot's actuators (5,) [N m]; None: none
    force: Vector | None  # on the object, along the world's x, y and z (3,) [N]; None: none


def disturbing(disturbances: tuple[Disturbance, ...], t: Scalar, joints: Pair[int] = (JOINTS, JOINTS)) -> Disturbing:
    """All disturbances at time t [s], scalars, of robots with so many joints.

    >>> disturbing((Disturbance(scale=0.0),), 0.0).force is None
    True
    """
    torques, forces = [], []
    for each in disturbances:
        strength = each.scale * each.wave.value(t)
        if any(amplitude is not None for amplitude in _amplitudes(each)):
            torques.append(_torques(each, strength, joints))
        if each.force is not None:
            forces.append(scaled(strength, each.force))
    torque = per_robot(lambda of_one: plus(*of_one), tuple(zip(*torques))) if torques else None
    return Disturbing(torque, plus(*forces) if forces else None)


def _amplitudes(disturbance: Disturbance) -> tuple[Any, ...]:
    """Amplitudes of a disturbance's torques: of wheels, joints, then those that single actuators have instead."""
    own = (disturbance.right_wheel, disturbance.left_wheel, disturbance.joint_1, disturbance.joint_2)
    return (disturbance.wheel, disturbance.joint, *own, disturbance.joint_3)


def _torques(disturbance: Disturbance, strength: Scalar, joints: Pair[int]) -> Pair[Vector]:
    """Torques against each robot's actuators (5,) [N m], a lift's [N]."""
    amplitudes = _amplitudes(disturbance)

    def of_robot(robot: int) -> Vector:
        wheel, joint, *own = (_times(strength, a[robot] if isinstance(a, tuple) else a) for a in amplitudes)
        common = of_each_actuator(0 if wheel is None else wheel, 0 if joint is None else joint, joints[robot])
        singles = (*own, *(None,) * len(common))[: len(common)]
        return tuple(x if single is None else single for x, single in zip(common, singles, strict=True))

    if joints[0] != joints[1] or any(isinstance(amplitude, tuple) for amplitude in amplitudes):
        return of_robot(0), of_robot(1)
    both = of_robot(0)
    return both, both


def _times(strength: Scalar, amplitude: Scalar | None) -> Scalar | None:
    return None if amplitude is None else amplitude * strength


def force_on_joints(force: Vector, k: Kinematics) -> Vector:
    """A force on the object (3,) along the world's axes [N], at tip II, on robot II's joints (5,): J_tip^T f in u."""
    position, (along, across, up) = k.bodies.place[1], k.bodies.tip[1]
    s, c = sincos(position.z1 + position.a1)
    x, y, z = force
    on_arm = plus(scaled(c * y - s * x, along), scaled(-c * x - s * y, across), scaled(z, up))
    return k.bodies.T[1].T @ on_arm


def disturbance_force(disturbances: tuple[Disturbance, ...], t: Scalar, geometry: Any, k: Kinematics) -> Pair[Vector]:
    """d of (1) in u, on each robot (5,), at t [s]: on the left of (1), so that it opposes what actuators exert.

    Args:
        disturbances: of the model.
        t: time [s].
        geometry: of both robots.
        k: kinematics of the plant.
    """
    joints = per_robot(len, k.velocity)
    now, none = disturbing(disturbances, t, joints), per_robot(lambda count: (0,) * count, joints)
    first, second = none if now.torque is None else per_robot(actuator_force, geometry, k.bodies.position, now.torque)
    return first, second if now.force is None else minus(second, force_on_joints(now.force, k))

"""Motion control: sigma, nu and the law (18), U1 + U2, spread over all joints."""

from __future__ import annotations

from typing import NamedTuple

import jax

from coopmm_jax.algebra.matrix import minus, norm, plus, scaled
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control import adaptive, backstepping
from coopmm_jax.control.gain_schedule import in_force
from coopmm_jax.control.posture import desired_postures, with_posture
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.mechanics import constrained_dynamics, partitioning
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.coordinates import AnyPosition, LongPosition, arm_of
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import Partition, Reduction, split
from coopmm_jax.mechanics.robot import PLATFORM, per_robot
from coopmm_jax.parameters import Structure


class MotionErrors(NamedTuple):
    """The filtered tracking error and what it is made of, below (15)."""

    utilde: Vector  # u^1 - z (n,)
    sigma: Vector  # utilde + K_u I
    nu_rate: Vector  # d/dt (z - K_u I)


def arm_joints(part: Partition, position: Pair[AnyPosition]) -> Pair[Vector]:
    """Independent arm joints of each robot [rad]."""

    def chosen(p: AnyPosition, joints: tuple[int, ...]) -> Vector:
        return tuple(arm_of(p)[joint - PLATFORM] for joint in joints if joint >= PLATFORM)

    return per_robot(chosen, position, part.independent)


def reference_velocities(model: Model, part: Partition, t: Scalar, position: Pair[AnyPosition], eta: Pair) -> Vector:
    """z (n,) of both robots, (12) and (13), under the gains in force at t [s]."""
    gains = in_force(model, t)

    def of_one(desired: Desired, posture: tuple[Vector, Vector], p: AnyPosition, arm: Vector, e: Scalar) -> Vector:
        return backstepping.reference_velocity(gains, with_posture(desired, posture, len(arm)), p, arm, e)

    arms, targets = arm_joints(part, position), desired_motion(model.reference, t)
    first, second = per_robot(of_one, targets, desired_postures(model, part, t), position, arms, eta)
    return first + second


def reference_and_rate(
    model: Model,
    part: Partition,
    at: tuple[Scalar, Pair[AnyPosition], Pair[Scalar]],
    rates: Pair[AnyPosition],
    eta_rates: Pair[Scalar],
) -> tuple[Vector, Vector]:
    """z and zdot (n,): the chain rule over t, the positions and eta, by forward differentiation.

    Where gains change over time, so does z through them: that is part of t.

    Args:
        model: gains and reference.
        part: independent and dependent joints.
        at: time t [s], positions, eta of each robot [rad/s].
        rates: of all coordinates.
        eta_rates: (15) of each robot [rad/s^2].
    """
    return jax.jvp(lambda *x: reference_velocities(model, part, *x), at, (at[0] * 0.0 + 1.0, rates, eta_rates))


def motion_errors(
    gains: Gains,
    part: Partition,
    z: Vector,
    z_rate: Vector,
    independent: Vector,
    integral: Vector,
    K_u_rate: Scalar | None = None,
) -> MotionErrors:
    """utilde, sigma and nudot (n,) below (15).

    Args:
        gains: of the controller.
        part: independent and dependent joints.
        z: reference velocities (n,).
        z_rate: their rates (n,).
        independent: u^1 (n,).
        integral: I of the independent arm joints [rad].
        K_u_rate: time derivative of K_u [1/s^2]; None where it is constant.
    """
    utilde = minus(independent, z)
    first, second = split(part, utilde)
    count = len(first) - PLATFORM

    integrals = integral[:count], integral[count:]

    def on_arms(gain: Scalar, values: Pair[Vector]) -> Vector:
        one, two = per_robot(lambda v: ((0,) * PLATFORM) + scaled(gain, v), values)
        return one + two

    sigma = plus(utilde, on_arms(gains.K_u, integrals))
    nu_rate = minus(z_rate, on_arms(gains.K_u, (first[PLATFORM:], second[PLATFORM:])))
    if K_u_rate is not None:
        nu_rate = minus(nu_rate, on_arms(K_u_rate, integrals))
    return MotionErrors(utilde, sigma, nu_rate)


def coordinate_speed(k: Kinematics, independent: Vector) -> Scalar:
    """|zetadot| over all coordinates: (8) makes each of them a velocity u, but z2dot = u1 z3 and z3dot = u1 z4.

    Args:
        k: kinematics of both robots.
        independent: u^1 (n,), as in ``k.velocity``.
    """
    _, dependent = partitioning.parted(k.reduction.part, k.velocity)
    lateral = tuple(u[0] * z for u, p in zip(k.velocity, k.bodies.position, strict=True) for z in _passed_on(p))
    return norm((*independent, *dependent[0], *dependent[1], *lateral))


def _passed_on(p: AnyPosition) -> Vector:
    """Coordinates that times u1 are the rates of those before them."""
    return (p.z3, p.z4) if isinstance(p, LongPosition) else (p.z3,)


def regressors(k: Kinematics, acceleration: Vector, independent: Vector) -> adaptive.Regressors:
    """f_k of (19); |L| is the Frobenius norm.

    Args:
        k: kinematics of both robots.
        acceleration: nudot - K_sigma sigma (n,).
        independent: u^1 (n,).
    """
    speed = norm(independent)
    return adaptive.Regressors(
        inertia=norm(acceleration),
        coriolis=speed,
        coriolis_rate=coordinate_speed(k, independent) * speed,
        gravity=1.0,
        disturbance=partitioning.velocity_map_norm(k.reduction),
    )


def nominal_force(model: Model, k: Kinematics, acceleration: Vector) -> Pair[Vector]:
    """M0 (L (nudot - K_sigma sigma) + Ldot u^1) + h0 on each robot (5,); L^T times it is U1 of (18).

    Args:
        model: with the nominal masses.
        k: kinematics of both robots.
        acceleration: nudot - K_sigma sigma (n,).
    """
    wanted = per_robot(plus, partitioning.expand(k.reduction, acceleration), k.L_rate)
    return constrained_dynamics.required_force(constrained_dynamics.both_dynamics(model.nominal, k), wanted)


def as_accelerated(structure: Structure, model: Model, k: Kinematics, acceleration: Vector) -> Pair[Vector]:
    """F (5,) of each robot that gives u^1 an acceleration where the nominal model is right, in either feed-forward.

    Args:
        structure: with the feed-forward in force.
        model: with the nominal masses.
        k: kinematics of both robots.
        acceleration: wanted du^1/dt (n,).
    """
    nominal = nominal_force(model, k, acceleration)
    return nominal if structure.feedforward == "full" else partitioning.least_equivalent(k.reduction, nominal)


def on_all_joints(structure: Structure, reduction: Reduction, nominal: Pair[Vector], U2: Vector) -> Pair[Vector]:
    """F (5,) of each robot with L^T F = U1 + U2: ``projected`` as substituted after (40), ``full`` as in (17)."""
    if structure.feedforward == "full":
        return per_robot(plus, nominal, partitioning.spread(reduction, U2))
    both = per_robot(plus, nominal, partitioning.on_independent(reduction.part, U2))
    return partitioning.least_equivalent(reduction, both)

"""Motion control: sigma, nu and the law (18), U1 + U2, spread over all joints."""

from __future__ import annotations

from typing import NamedTuple

import jax

from coopmm_jax.algebra.matrix import Scalar, Vector, minus, norm, plus, scaled
from coopmm_jax.control import adaptive, backstepping
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.mechanics import constrained_dynamics, partitioning, robot_kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.parameters import Structure


class Memory(NamedTuple):
    """States of the controller."""

    integral: Vector  # I of the independent arm joints [rad], Idot = utilde
    eta: tuple[Scalar, Scalar]  # of (15) [rad/s]
    c_hat: Vector  # (5,), bound estimates
    force_integral: Vector  # E (m,) [N s], Edot = e_lambda


class MotionErrors(NamedTuple):
    """The filtered tracking error and what it is made of, below (15)."""

    utilde: Vector  # u^1 - z (n,)
    sigma: Vector  # utilde + K_u I
    nu_rate: Vector  # d/dt (z - K_u I)


class MotionCommand(NamedTuple):
    """What the motion controller asks for and how its memory moves."""

    force: tuple[Vector, Vector]  # F on all joints of each robot (5,), with L^T F = U1 + U2
    sigma: Vector
    integral_rate: Vector
    eta_rate: tuple[Scalar, Scalar]
    c_hat_rate: Vector


def split(part: partitioning.Partition, independent: Vector) -> tuple[Vector, Vector]:
    """The independent velocities (n,) of each robot."""
    first = len(part.independent[0])
    return tuple(independent[:first]), tuple(independent[first:])


def arm_joints(
    part: partitioning.Partition, position: tuple[robot_kinematics.Position, robot_kinematics.Position]
) -> tuple[Vector, Vector]:
    """Independent arm joints of each robot [rad]: u's entry j >= 2 is the rate of Position's field j + 1."""
    return tuple(
        tuple(p[j + 1] for j in joints if j >= 2) for p, joints in zip(position, part.independent, strict=True)
    )


def with_posture(desired: Desired, posture: Vector, count: int) -> Desired:
    """Desired motion of one robot whose first ``count`` arm joints are independent: yaw, then ``posture`` [rad]."""
    held = posture[: count - 1]
    return desired._replace(arm=desired.arm + tuple(held), arm_rate=desired.arm_rate + (0.0,) * len(held))


def reference_velocities(model: Model, part: partitioning.Partition, t: Scalar, position: tuple, eta: tuple) -> Vector:
    """z (n,) of both robots, (12) and (13)."""
    arms = arm_joints(part, position)
    return sum(
        (
            backstepping.reference_velocity(model.gains, with_posture(desired, posture, len(arm)), p, arm, e)
            for desired, posture, p, arm, e in zip(
                desired_motion(model.reference, t), model.posture, position, arms, eta, strict=True
            )
        ),
        (),
    )


def position_rates(
    position: tuple, velocity: tuple[Vector, Vector]
) -> tuple[robot_kinematics.Position, robot_kinematics.Position]:
    """(8) for both robots: rates of all twelve coordinates from u (5,) of each."""
    return tuple(
        robot_kinematics.Position(*backstepping.chained_rates(p, u[0], u[1]), *u[2:])
        for p, u in zip(position, velocity, strict=True)
    )


def motion_errors(
    model: Model,
    part: partitioning.Partition,
    t: Scalar,
    position: tuple,
    rates: tuple,
    independent: Vector,
    memory: Memory,
    eta_rates: tuple[Scalar, Scalar],
) -> MotionErrors:
    """utilde, sigma and nudot (n,) below (15).

    zdot is the chain rule over t, the positions and eta, by forward differentiation.

    Args:
        t: time [s]. rates: of all coordinates. independent: u^1 (n,). eta_rates: (15) of each robot [rad/s^2].
    """
    z, z_rate = jax.jvp(
        lambda *at: reference_velocities(model, part, *at),
        (t, position, memory.eta),
        (t * 0.0 + 1.0, rates, eta_rates),
    )
    utilde = minus(independent, z)
    first, second = split(part, utilde)
    n1 = len(first) - 2
    integrals = (memory.integral[:n1], memory.integral[n1:])

    def on_arms(values: tuple[Vector, Vector]) -> Vector:
        return sum(((0, 0, *scaled(model.gains.K_u, v)) for v in values), ())

    sigma = plus(utilde, on_arms(integrals))
    nu_rate = minus(z_rate, on_arms((first[2:], second[2:])))
    return MotionErrors(utilde, sigma, nu_rate)


def motion_control(
    structure: Structure, model: Model, t: Scalar, k: partitioning.Kinematics, independent: Vector, memory: Memory
) -> MotionCommand:
    """(18)-(24) with the nominal model, and the generalised force F on all joints.

    Args:
        independent: u^1 (n,), as measured. k: kinematics at the measured state.
    """
    gains, part, position = model.gains, k.reduction.part, k.bodies.position
    targets = desired_motion(model.reference, t)
    eta_rates = tuple(
        backstepping.eta_rate(gains, d, p, e) for d, p, e in zip(targets, position, memory.eta, strict=True)
    )
    rates = position_rates(position, k.velocity)
    errors = motion_errors(model, part, t, position, rates, independent, memory, eta_rates)
    damping = tuple(gain * s for gain, s in zip(gains.K_sigma, errors.sigma, strict=True))
    acceleration = minus(errors.nu_rate, damping)
    utilde = split(part, errors.utilde)

    f = regressors(k, acceleration, independent)
    signal = sum((backstepping.coupling_signal(gains, d, p) for d, p in zip(targets, position, strict=True)), ())
    platform_error = utilde[0][:2] + utilde[1][:2]
    U2 = adaptive.robust_force(structure, gains, f, errors.sigma, memory.c_hat, platform_error, signal, t)
    return MotionCommand(
        force=_on_all_joints(structure, k.reduction, _nominal_force(model, k, acceleration), U2),
        sigma=errors.sigma,
        integral_rate=utilde[0][2:] + utilde[1][2:],
        eta_rate=eta_rates,
        c_hat_rate=adaptive.adaptation(gains, f, errors.sigma, memory.c_hat, t),
    )


def coordinate_speed(k: partitioning.Kinematics, independent: Vector) -> Scalar:
    """|zetadot| over all twelve coordinates: (8) makes each of them a velocity u, but for z2dot = u1 z3.

    Args:
        independent: u^1 (n,), as in ``k.velocity``.
    """
    _, dependent = partitioning.parted(k.reduction.part, k.velocity)
    lateral = tuple(u[0] * p.z3 for u, p in zip(k.velocity, k.bodies.position, strict=True))
    return norm((*independent, *dependent[0], *dependent[1], *lateral))


def regressors(k: partitioning.Kinematics, acceleration: Vector, independent: Vector) -> adaptive.Regressors:
    """f_k of (19); |L| is the Frobenius norm.

    Args:
        acceleration: nudot - K_sigma sigma (n,). independent: u^1 (n,).
    """
    speed = norm(independent)
    return adaptive.Regressors(
        inertia=norm(acceleration),
        coriolis=speed,
        coriolis_rate=coordinate_speed(k, independent) * speed,
        gravity=1.0,
        disturbance=partitioning.velocity_map_norm(k.reduction),
    )


def _nominal_force(model: Model, k: partitioning.Kinematics, acceleration: Vector) -> tuple[Vector, Vector]:
    """M0 (L (nudot - K_sigma sigma) + Ldot u^1) + h0 on each robot; L^T times it is U1 of (18)."""
    wanted = tuple(plus(a, b) for a, b in zip(partitioning.expand(k.reduction, acceleration), k.L_rate, strict=True))
    dynamics = constrained_dynamics.both_dynamics(model.nominal, k)
    return constrained_dynamics.required_force(dynamics, wanted)


def _on_all_joints(
    structure: Structure, reduction: partitioning.Reduction, nominal_force: tuple[Vector, Vector], U2: Vector
) -> tuple[Vector, Vector]:
    """F with L^T F = U1 + U2: ``projected`` as substituted after (40), ``full`` as in (17)."""
    if structure.feedforward == "full":
        return tuple(plus(a, b) for a, b in zip(nominal_force, partitioning.spread(reduction, U2), strict=True))
    robust = partitioning.on_independent(reduction.part, U2)
    both = tuple(plus(a, b) for a, b in zip(nominal_force, robust, strict=True))
    return partitioning.least_equivalent(reduction, both)

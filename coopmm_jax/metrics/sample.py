"""Quantities of one sample, which the metrics reduce along a rollout."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Matrix, dot, minus, sub
from coopmm_jax.algebra.sincos import sincos, wrapped
from coopmm_jax.algebra.types import Bool, Scalar, Vector
from coopmm_jax.control.chain import persistence
from coopmm_jax.control.controller import estimates_of
from coopmm_jax.control.reference import (
    AnyReference,
    at_instant,
    desired_contact,
    desired_motion,
    desired_object,
)
from coopmm_jax.kinds.controllers import lateral
from coopmm_jax.kinds.courses import current
from coopmm_jax.loop.devices import torque_limits
from coopmm_jax.loop.state import Signals
from coopmm_jax.mechanics.robot import ROBOTS, WHEELS
from coopmm_jax.metrics.table import IMPACT, SETTLED
from coopmm_jax.parameters import Hardware, Parameters, Reference, Structure, Surface

# Quantities that are sums over all actuators: a mean is one over all of them.
OF_ACTUATORS = ("torque_squared", "saturated")


class Errors(NamedTuple):
    """Squared norms of the errors of one sample [rad^2, m^2]."""

    heading_1: Scalar
    heading_2: Scalar
    position_1: Scalar
    position_2: Scalar
    arm_1: Scalar
    arm_2: Scalar
    object: Scalar
    relative_tip: Scalar

    @property
    def tracking(self) -> Scalar:
        """Of all heading, position and arm errors together."""
        return sum(self[:-2])


class Touching(NamedTuple):
    """Tip on a compliant surface, or off it, at a sample."""

    gap: Scalar  # phi of the normal row [m]
    since: Scalar  # samples since the tip last landed; infinity before

    def landed(self) -> Bool:
        """True if this sample is the first after a landing."""
        return self.since == 0.0


class Past(NamedTuple):
    """Earlier samples, as far as a later one needs them."""

    torque: Vector  # of the sample before, all actuators, wheels first [N m]
    determinants: Vector  # |det J_dep| of each arm with dependent joints, at the first sample
    touching: Touching | None  # at the sample before; None where the contact is rigid


def no_past(structure: Structure) -> Past:
    """The past of the first sample: torques (10,), determinants (1,) or (2,)."""
    zero = jnp.zeros((), jnp.result_type(float))
    arms = 2 if "guide_radial" in structure.rows else 1
    touching = Touching(zero, zero + jnp.inf) if structure.compliant else None
    return Past((zero,) * sum(structure.joints), (zero,) * arms, touching)


def past_after(past: Past, first: Bool, signals: Signals) -> Past:
    """The past once a sample has been taken: torques (10,), determinants (1,) or (2,).

    Args:
        past: before it.
        first: whether it was the first one.
        signals: of the sample.
    """
    both = zip(past.determinants, signals.determinants, strict=True)
    determinants = tuple(jnp.where(first, jnp.abs(now), before) for before, now in both)
    touching = past.touching
    if touching is not None:
        gap = signals.constraint_residual[0]
        landed = (touching.gap > 0.0) & (gap <= 0.0)
        touching = Touching(gap, jnp.where(landed, 0.0, touching.since + 1.0))
    return Past(_torques(signals), determinants, touching)


def squared_errors(reference: AnyReference, surface: Surface, t: Scalar, signals: Signals) -> Errors:
    """Squared norms of the errors at one sample [rad^2, m^2]; of angles modulo a turn.

    The object's desired point is given along the desired axes of platform II and turned by its heading error, so that
    no angle grows with time. The desired point of tip I is on the object's surface as it is.
    """
    now = at_instant(reference, t, signals.aim)
    desired = desired_motion(now, t)
    (p1, p2), (d1, d2) = signals.position, desired
    heading_1, heading_2 = wrapped(p1.z1 - d1.z1), wrapped(p2.z1 - d2.z1)
    s, c = sincos(heading_2)
    place = Matrix([[c, s], [sub(0, s), c]]) @ desired_object(now, surface, d2)
    object_error = minus(signals.tip[1], (*place, current(surface.guide_height, t)))
    tip_error = minus(signals.contact_point, desired_contact(now, surface, desired))
    vectors = (
        *((heading_1,), (heading_2,)),
        *((p1.z2 - d1.z2, p1.z3 - d1.z3), (p2.z2 - d2.z2, p2.z3 - d2.z3)),
        *((wrapped(p1.a1 - d1.arm[0]),), (wrapped(p2.a1 - d2.arm[0]),)),
        *(object_error, tip_error),
    )
    return Errors(*(dot(vector, vector) for vector in vectors))


@dataclass(frozen=True)
class Sample:
    """One sample of a rollout, as metrics and cost terms see it; every number is a scalar."""

    structure: Structure
    parameters: Parameters
    t: Scalar  # [s]
    step: Scalar  # until the next one [s]
    signals: Signals
    quantities: Mapping[str, Scalar]  # of the built-in metrics, see ``quantities``
    terms: Mapping[str, Scalar]  # of the built-in cost terms; empty where no cost is computed


def quantities(
    structure: Structure, parameters: Parameters, t: Scalar, step: Scalar, signals: Signals, before: Past, now: Past
) -> dict[str, Scalar]:
    """Quantities of one sample by name, scalars in the metrics' units or, if their names say so, squares of them.

    Args:
        structure: static choices.
        parameters: of the rollout.
        t: time of the sample [s].
        step: until the next one [s].
        signals: of the sample.
        before: the past, up to the sample before.
        now: the same, up to this one.
    """
    errors = squared_errors(parameters.reference, parameters.plant.surface, t, signals)
    change = tuple(map(jnp.abs, minus(now.torque, before.torque)))
    ratios = (jnp.abs(x) / first for x, first in zip(signals.determinants, now.determinants, strict=True))
    return {
        **{f"{name}_squared": error for name, error in errors._asdict().items()},
        "tracking_squared": errors.tracking,
        "unsettled_until": jnp.where(errors.tracking > SETTLED**2, t + step, 0.0),
        **_forces(structure, signals),
        **_opening(structure, step, signals, now.touching),
        "torque_squared": dot(now.torque, now.torque),
        "torque_size": largest_size(now.torque),
        "saturated": _saturated(structure, parameters.hardware, signals),
        "torque_change": sum(change),
        "wheel_torque_change": sum(change[: ROBOTS * WHEELS]),
        "joint_torque_change": sum(change[ROBOTS * WHEELS :]),
        "persistence": lateral(parameters.gains) * _least_persistence(parameters, t, signals),
        "c_hat": largest_size(estimates_of(parameters.gains, signals.controller)),
        "constraint_residual": largest_size(
            signals.constraint_residual[len(structure.rows) - len(structure.plant_rows) :]
        ),
        "determinant": functools.reduce(jnp.minimum, ratios),
    }


def _least_persistence(parameters: Parameters, t: Scalar, signals: Signals) -> Scalar:
    """u_d1^(2 l), l = n_v - 2, of the robot whose errors stay longest."""
    u_d1, fronts = _yaw_rate(parameters.reference, t, signals), [g.front for g in parameters.plant.geometry]
    in_polar = [front is not None and front.chart is not None for front in fronts]
    lengths = {3 if front is None else 4 for front, own in zip(fronts, in_polar, strict=True) if not own}
    each = [persistence(u_d1, n_v) for n_v in sorted(lengths)]
    if any(in_polar) and signals.aim is not None:
        each += [persistence(aim.turn[0], 4) for aim in signals.aim.polar if aim is not None]
    elif any(in_polar):
        each += [persistence(u_d1, 4)]
    return functools.reduce(jnp.minimum, each)


def _yaw_rate(reference: AnyReference, t: Scalar, signals: Signals) -> Scalar:
    """u_d1 [rad/s]."""
    now = at_instant(reference, t, signals.aim)
    return now.rate if isinstance(now, Reference) else now.aim.turn.value


def _forces(structure: Structure, signals: Signals) -> dict[str, Scalar]:
    contact = structure.rows.index("contact_normal")
    force = signals.constraint_force[contact]
    return {
        "force_error_squared": signals.force_error[contact] ** 2,
        "contact_force": force,
        "pull": jnp.maximum(-force, 0.0),
        "internal_force": internal_force(structure, signals),
    }


def _opening(structure: Structure, step: Scalar, signals: Signals, touching: Touching | None) -> dict[str, Scalar]:
    """Contact that is lost: a rigid one would have to pull, a compliant one opens and closes again."""
    force = signals.constraint_force[structure.rows.index("contact_normal")]
    if touching is None:
        lost = jnp.where(force < 0.0, jnp.ones_like(force), 0.0)
        return {"contact_lost": lost, "airborne": 0.0, "gap": 0.0, "landing": 0.0, "impact_force": 0.0}
    airborne = jnp.where(touching.gap > 0.0, 1.0, 0.0)
    return {
        "contact_lost": airborne,
        "airborne": airborne,
        "gap": jnp.maximum(touching.gap, 0.0),
        "landing": jnp.where(touching.landed(), 1.0, 0.0),
        "impact_force": jnp.where((touching.since - 0.5) * step < IMPACT, force, 0.0),
    }


def internal_force(structure: Structure, signals: Signals) -> Scalar:
    """Largest size of the constraint forces but the normal contact force [N]; 0 if there are none."""
    contact = structure.rows.index("contact_normal")
    return largest_size(tuple(x for i, x in enumerate(signals.constraint_force) if i != contact))


def largest_size(values: Vector) -> Scalar:
    """Largest absolute value of (n,); 0 of nothing."""
    return functools.reduce(jnp.maximum, map(jnp.abs, values), 0.0)


def root(square: Scalar) -> Scalar:
    """Square root of a scalar, with gradient 0 at 0; 0 of what is negative, which only "no sample" is."""
    positive = square > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def _torques(signals: Signals) -> Vector:
    """Torques of all actuators, wheels first (10,) [N m]."""
    one, two = signals.torque
    return (*one[:WHEELS], *two[:WHEELS], *one[WHEELS:], *two[WHEELS:])


def _saturated(structure: Structure, hardware: Hardware, signals: Signals) -> Scalar:
    """Number of actuators that are asked for more than they can give; lag and smoothing play no part in it."""
    if not structure.features.limits:
        return 0.0
    return sum(
        jnp.where(jnp.abs(torque) > limit, 1.0, 0.0)
        for robot in signals.commanded
        for torque, limit in zip(robot, torque_limits(hardware, len(robot)), strict=True)
    )

"""Metrics of one rollout, accumulated inside its scan: a few dozen scalars instead of a trajectory.

``observer`` goes into ``rollout``, ``finish`` turns what it gathered into the numbers that ``METRICS`` in
``metrics/table.py`` describes. Both work under jit, vmap and grad, so a sweep keeps one row of metrics per rollout.

>>> from coopmm_jax.parameters import Parameters, Structure
>>> gather = observer(Structure(), Parameters(), duration=20.0, step=1e-3)
>>> total = gather.start  # of a rollout that failed at once; otherwise rollout(..., observer=gather).total
>>> float(finish(total, duration=20.0, step=1e-3)["settling_time"])
20.0
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax.algebra.matrix import dot, minus
from coopmm_jax.algebra.sincos import sincos, wrapped
from coopmm_jax.algebra.types import Bool, Scalar, Vector
from coopmm_jax.control.reference import desired_motion
from coopmm_jax.loop.devices import torque_limits
from coopmm_jax.loop.rollout import Observer
from coopmm_jax.loop.state import Signals
from coopmm_jax.mechanics.robot import ACTUATORS, ROBOTS, WHEELS
from coopmm_jax.metrics.table import ERRORS, LATE, METRICS, SETTLED, TRACKING
from coopmm_jax.parameters import Hardware, Parameters, Reference, Structure, Surface


class Sums(NamedTuple):
    """Sums over samples."""

    samples: Scalar
    late_samples: Scalar
    error: dict[str, Scalar]  # squares, one per entry of ERRORS
    force_error: Scalar  # squares [N^2]
    force_error_late: Scalar
    losses: Scalar  # samples without contact
    torque: Scalar  # squares, of all actuators [N^2 m^2]
    saturated: Scalar  # actuators commanded beyond their limit
    variation: Scalar  # |change since the sample before|, of all actuators [N m]
    wheel_variation_late: Scalar


class Largest(NamedTuple):
    """Maxima over samples; a smallest value is the largest of its negative."""

    error: dict[str, Scalar]  # squares
    error_late: Scalar
    unsettled_until: Scalar  # [s]
    force: Scalar
    force_late: Scalar
    pull: Scalar  # -force
    pull_late: Scalar
    internal_force: Scalar
    torque: Scalar
    c_hat: Scalar
    residual: Scalar
    singularity: Scalar  # -|det J_dep| of an arm over its first


class Last(NamedTuple):
    """Values at the last sample, and what the next one needs to know of it."""

    error: dict[str, Scalar]  # squares
    force_error: Scalar
    torque: Vector  # of all actuators, wheels first
    first_determinants: Vector


class Total(NamedTuple):
    """Everything that is gathered along a rollout."""

    sums: Sums
    largest: Largest
    last: Last


def observer(structure: Structure, parameters: Parameters, duration: Scalar, step: Scalar) -> Observer:
    """Observer with which ``rollout`` gathers what ``finish`` needs.

    Args:
        structure: static choices.
        parameters: of the rollout; may be traced, as may all that follow.
        duration: horizon of the rollout [s].
        step: of the rollout [s].
    """

    def update(total: Total, t: Scalar, signals: Signals) -> Total:
        late = t > LATE * duration - 0.5 * step
        errors = squared_errors(parameters.reference, parameters.plant.surface, t, signals)
        last = _last(structure, total, signals, errors)
        force = signals.constraint_force[structure.rows.index("contact_normal")]
        saturated = _saturated(structure, parameters.hardware, signals)
        sums = jax.tree.map(jnp.add, total.sums, _summands(total, force, last, late, saturated))
        largest = jax.tree.map(jnp.maximum, total.largest, _candidates(structure, signals, last, late, t + step))
        return Total(sums, largest, last)

    return Observer(_start(structure), update)


def squared_errors(reference: Reference, surface: Surface, t: Scalar, signals: Signals) -> dict[str, Scalar]:
    """Squared norms of the errors named in ``ERRORS`` [rad^2, m^2] at one sample; of angles modulo a turn.

    The object's desired point is (Rg cos wt, Rg sin wt), w the platforms' yaw rate: along platform II's axes it is
    (Rg cos e1, -Rg sin e1), e1 the heading error of II, so that no angle grows with time. The desired point of tip I
    is Rc from the arc's centre along the desired direction of arm I.
    """
    desired = desired_motion(reference, t)
    errors = {}
    for i, (p, d) in enumerate(zip(signals.position, desired, strict=True), 1):
        errors[f"heading_{{}}_{i}"] = (wrapped(p.z1 - d.z1),)
        errors[f"position_{{}}_{i}"] = (p.z2 - d.z2, p.z3 - d.z3)
        errors[f"arm_{{}}_{i}"] = (wrapped(p.a1 - d.arm[0]),)
    s, c = sincos(errors["heading_{}_2"][0])
    radius = surface.guide_radius
    errors["object_{}"] = minus(signals.tip[1], (radius * c, -radius * s, surface.guide_height))
    s, c = sincos((desired[0].z1 - desired[1].z1) + (desired[0].arm[0] - desired[1].arm[0]))
    errors["relative_tip_{}"] = minus(signals.contact_point, (surface.contact_radius * c, surface.contact_radius * s))
    return {name: dot(errors[name], errors[name]) for name in ERRORS}


def finish(total: Total, duration: Scalar, step: Scalar) -> dict[str, Scalar]:
    """The metrics named in ``METRICS``, finite for every rollout: 0 where no sample was taken.

    Args:
        total: gathered by ``observer``.
        duration: as given to it [s].
        step: as given to it [s].
    """
    sums, largest, last = total
    samples, late_samples = jnp.maximum(sums.samples, 1.0), jnp.maximum(sums.late_samples, 1.0)
    complete = (sums.samples - 0.5) * step > duration
    metrics = {
        "error_late": _root(largest.error_late),
        "settling_time": jnp.where(complete, jnp.minimum(largest.unsettled_until, duration), duration),
        "force_error_rms": _root(sums.force_error / samples),
        "force_error_rms_late": _root(sums.force_error_late / late_samples),
        "force_error_final": jnp.abs(last.force_error),
        "force_min": -largest.pull,
        "force_max": largest.force,
        "force_min_late": -largest.pull_late,
        "force_max_late": largest.force_late,
        "contact_loss_fraction": sums.losses / samples,
        "contact_loss_time": sums.losses * step,
        "contact_loss_depth": jnp.maximum(largest.pull, 0.0),
        "internal_force_max": largest.internal_force,
        "torque_rms": _root(sums.torque / (len(last.torque) * samples)),
        "torque_peak": largest.torque,
        "saturation_fraction": sums.saturated / (len(last.torque) * samples),
        "torque_variation": sums.variation,
        "wheel_torque_variation_late": sums.wheel_variation_late,
        "c_hat_max": largest.c_hat,
        "constraint_residual_max": largest.residual,
        "singularity_margin": -largest.singularity,
    }
    for error in ERRORS:
        metrics[error.format("rms")] = _root(sums.error[error] / samples)
        metrics[error.format("max")] = _root(largest.error[error])
        metrics[error.format("final")] = _root(last.error[error])
    return {name: jnp.where(jnp.isfinite(metrics[name]), metrics[name], 0.0) for name in METRICS}


def _start(structure: Structure) -> Total:
    """Neutral elements; the determinants are one per robot whose arm has dependent joints."""
    zero = jnp.zeros((), jnp.result_type(float))
    arms = 2 if "guide_radial" in structure.rows else 1
    errors: dict[str, Scalar] = dict.fromkeys(ERRORS, zero)
    sums: dict[str, Any] = dict.fromkeys(Sums._fields, zero) | {"error": errors}
    largest: dict[str, Any] = dict.fromkeys(Largest._fields, zero - jnp.inf) | {"error": errors}
    return Total(
        Sums(**sums),
        Largest(**largest),
        Last(errors, zero, (zero,) * (ROBOTS * ACTUATORS), (zero,) * arms),
    )


def _last(structure: Structure, total: Total, signals: Signals, errors: dict[str, Scalar]) -> Last:
    one, two = signals.torque
    first = tuple(
        jnp.where(total.sums.samples > 0, before, jnp.abs(now))
        for before, now in zip(total.last.first_determinants, signals.determinants, strict=True)
    )
    force_error = signals.force_error[structure.rows.index("contact_normal")]
    return Last(errors, force_error, (*one[:WHEELS], *two[:WHEELS], *one[WHEELS:], *two[WHEELS:]), first)


def _saturated(structure: Structure, hardware: Hardware, signals: Signals) -> Scalar:
    """Number of actuators that are asked for more than they can give; lag and smoothing play no part in it."""
    if not structure.features.limits:
        return 0.0
    limits = torque_limits(hardware)
    return sum(
        jnp.where(jnp.abs(torque) > limit, 1.0, 0.0)
        for robot in signals.commanded
        for torque, limit in zip(robot, limits, strict=True)
    )


def _summands(total: Total, force: Scalar, last: Last, late: Bool, saturated: Scalar) -> Sums:
    """Summands of one sample: its change of torque counts if the sample before exists, or is late too."""
    one = jnp.ones_like(force)
    before, late_before = total.sums.samples > 0, total.sums.late_samples > 0
    change = tuple(map(jnp.abs, minus(last.torque, total.last.torque)))
    return Sums(
        samples=one,
        late_samples=jnp.where(late, one, 0.0),
        error=last.error,
        force_error=last.force_error**2,
        force_error_late=jnp.where(late, last.force_error**2, 0.0),
        losses=jnp.where(force < 0.0, one, 0.0),
        torque=dot(last.torque, last.torque),
        saturated=saturated,
        variation=jnp.where(before, sum(change), 0.0),
        wheel_variation_late=jnp.where(late & late_before, sum(change[: ROBOTS * WHEELS]), 0.0),
    )


def _candidates(structure: Structure, signals: Signals, last: Last, late: Scalar, end: Scalar) -> Largest:
    """Candidates for the maxima from one sample, which ends at time ``end``."""
    contact = structure.rows.index("contact_normal")
    force = signals.constraint_force[contact]
    others = tuple(x for i, x in enumerate(signals.constraint_force) if i != contact)
    tracking = sum(last.error[name] for name in TRACKING)
    ratios = (-jnp.abs(now) / first for now, first in zip(signals.determinants, last.first_determinants, strict=True))
    return Largest(
        error=last.error,
        error_late=jnp.where(late, tracking, 0.0),
        unsettled_until=jnp.where(tracking > SETTLED**2, end, 0.0),
        force=force,
        force_late=jnp.where(late, force, -jnp.inf),
        pull=-force,
        pull_late=jnp.where(late, -force, -jnp.inf),
        internal_force=_size(others),
        torque=_size(last.torque),
        c_hat=_size(signals.controller.c_hat),
        residual=_size(signals.constraint_residual),
        singularity=functools.reduce(jnp.maximum, ratios),
    )


def _size(values: Vector) -> Scalar:
    """Largest absolute value; 0 of nothing."""
    return functools.reduce(jnp.maximum, map(jnp.abs, values), 0.0)


def _root(square: Scalar) -> Scalar:
    """Square root with gradient 0 at 0; 0 of what is negative, which only "no sample" is."""
    positive = square > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)

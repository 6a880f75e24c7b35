"""Disturbance d of (1): torques on all actuators that nobody measures."""

from __future__ import annotations

import functools

from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.mechanics.robot import of_each_actuator
from coopmm_jax.parameters import Disturbance


@functools.singledispatch
def disturbance_torque(disturbance: Disturbance, t: Scalar) -> Vector:
    """Torque on each of a robot's actuators (5,) at time t [s] [N m]; on the left of (1), so it opposes tau.

    Another shape of disturbance is a NamedTuple of scalars of your own, in the place of ``Parameters.disturbance``, and
    a function for it: ``@disturbance_torque.register``.

    >>> from typing import NamedTuple
    >>> class Push(NamedTuple):
    ...     force: Scalar = 2.0
    >>> @disturbance_torque.register
    ... def _(push: Push, t: Scalar) -> Vector:
    ...     return (push.force, push.force, 0.0, 0.0, 0.0)
    >>> disturbance_torque(Push(), 0.0)
    (2.0, 2.0, 0.0, 0.0, 0.0)
    """
    wave = disturbance.scale * sincos(disturbance.frequency * t + disturbance.phase)[0]
    return of_each_actuator(disturbance.wheel * wave, disturbance.joint * wave)

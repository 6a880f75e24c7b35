"""Controllers to compare the paper's with: their gains. Their equations are in ``control/``, one module for each.

All of them control the forces as below (17). Those on sigma share the kinematics (12)-(15) with the paper's law.

>>> ComputedTorque().K_p[0], ComputedTorque.tuned
(100.0, ('K_p', 'K_d', 'K_lambda', 'K_I'))
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.kinds.controllers import ESTIMATE, VELOCITY, Signal, by_module, gain
from coopmm_jax.kinds.registry import register
from coopmm_jax.kinds.shared_gains import (
    FILTER,
    FORCE,
    SIGMA,
    ArmFeedback,
    ArmIntegral,
    DeltaFloor,
    EtaDecay,
    ForceFeedback,
    ForceIntegral,
    Forward,
    Heading,
    Lateral,
    LowerInertia,
    SigmaFeedback,
    Steering,
    UpperInertia,
)


@register("controller", "model_based")
@by_module("coopmm_jax.control.model_based")
class ModelBased(NamedTuple):
    """The paper's law (17) for a system that is certain: nominal model and feedback of sigma, no robust term."""

    k0: EtaDecay = 5.0
    k1: Heading = 180.0
    k2: Lateral = 5.0
    k3: Forward = 5.0
    k4: Steering = 5.0
    K_a: ArmFeedback = 2.0
    K_u: ArmIntegral = 1.0
    K_sigma: SigmaFeedback = (5.0,) * 6
    K_lambda: ForceFeedback = (0.3,) * 4
    K_I: ForceIntegral = (1.5,) * 4

    lateral = "k2"
    tuned = ("K_sigma", "K_lambda", "K_I")
    shown = ("sigma", "force_integral")
    signals = {"sigma": SIGMA, **FILTER}  # noqa: RUF012 - a constant


@register("controller", "robust_fixed")
@by_module("coopmm_jax.control.robust_fixed")
class RobustFixed(NamedTuple):
    """The paper's law (18), (19) with given bounds of the uncertainty in the place of those that adapt."""

    k0: EtaDecay = 5.0
    k1: Heading = 180.0
    k2: Lateral = 5.0
    k3: Forward = 5.0
    k4: Steering = 5.0
    K_a: ArmFeedback = 2.0
    K_u: ArmIntegral = 1.0
    K_sigma: SigmaFeedback = (0.5,) * 6
    c: Annotated[Vector, gain("bounds of the uncertainty in (19)", (0.01, 100.0), ESTIMATE)] = (1.0,) * 5
    K_lambda: ForceFeedback = (0.3,) * 4
    K_I: ForceIntegral = (1.5,) * 4
    beta: UpperInertia = 1.0
    lam_min: LowerInertia = 1.0
    delta_floor: DeltaFloor = 0.0

    lateral = "k2"
    tuned = ("K_sigma", "c", "K_lambda", "K_I")
    shown = ("sigma", "robust_force")
    signals = {  # noqa: RUF012 - a constant
        "sigma": SIGMA,
        "robust_force": Signal("N m, N, N m of each robot", "robust term U2 of (19)", "independent", "U2 [N m, N]"),
        **FILTER,
    }


@register("controller", "sliding_mode")
@by_module("coopmm_jax.control.sliding_mode")
class SlidingMode(NamedTuple):
    """Sliding mode on the surface sigma = 0, with a boundary layer and the nominal model."""

    k0: EtaDecay = 5.0
    k1: Heading = 180.0
    k2: Lateral = 5.0
    k3: Forward = 5.0
    k4: Steering = 5.0
    K_a: ArmFeedback = 2.0
    K_u: ArmIntegral = 1.0
    K_sigma: SigmaFeedback = (2.0,) * 6
    K_switch: Annotated[Vector, gain("reaching acceleration [rad/s^2, m/s^2]", (0.01, 100.0), VELOCITY)] = (1.0,) * 6
    layer: Annotated[Scalar, gain("width of the boundary layer [rad/s, m/s]", (1e-3, 10.0), above=0.0)] = 0.1
    K_lambda: ForceFeedback = (0.3,) * 4
    K_I: ForceIntegral = (1.5,) * 4

    lateral = "k2"
    tuned = ("K_sigma", "K_switch", "layer", "K_lambda", "K_I")
    shown = ("sigma", "switching")
    signals = {  # noqa: RUF012 - a constant
        "sigma": SIGMA,
        "switching": Signal("rad/s^2, m/s^2, rad/s^2 of each robot", "acceleration towards the surface", "independent"),
        **FILTER,
    }


@register("controller", "computed_torque_pi")
@by_module("coopmm_jax.control.computed_torque_pi")
class ComputedTorque(NamedTuple):
    """Computed torque on the nominal model, with PD on the joints' positions and PI on the forces."""

    k2: Annotated[Scalar, gain("lateral error's part in the forward one [s/rad]", (0.05, 100.0))] = 5.0
    K_p: Annotated[Vector, gain("position feedback [1/s^2]", (0.5, 2500.0), VELOCITY)] = (100.0,) * 6
    K_d: Annotated[Vector, gain("velocity feedback [1/s]", (0.2, 100.0), VELOCITY)] = (20.0,) * 6
    K_lambda: ForceFeedback = (0.3,) * 4
    K_I: ForceIntegral = (1.5,) * 4

    lateral = "k2"
    tuned = ("K_p", "K_d", "K_lambda", "K_I")
    shown = ("position_error", "velocity_error")
    signals = {  # noqa: RUF012 - a constant
        "position_error": Signal("rad, m, rad of each robot", "errors p of the joints' positions", "independent"),
        "velocity_error": Signal("rad/s, m/s, rad/s of each robot", "errors u^1 - r of their rates", "independent"),
        **FORCE,
    }


@register("controller", "pid")
@by_module("coopmm_jax.control.pid")
class Pid(NamedTuple):
    """PID of each wheel and independent arm joint, with gravity compensation and PI on the forces.

    The first two entries of each robot's gains are those of its right and left wheel.
    """

    k2: Annotated[Scalar, gain("lateral error's part in the forward one [s/rad]", (0.05, 100.0))] = 5.0
    K_p: Annotated[Vector, gain("proportional part [N m/rad]", (1.0, 5000.0), VELOCITY)] = (200.0,) * 6
    K_int: Annotated[Vector, gain("integral part [N m/(rad s)]", (0.1, 5000.0), VELOCITY)] = (200.0,) * 6
    K_d: Annotated[Vector, gain("derivative part [N m s/rad]", (0.5, 500.0), VELOCITY)] = (50.0,) * 6
    K_lambda: ForceFeedback = (0.3,) * 4
    K_I: ForceIntegral = (1.5,) * 4

    lateral = "k2"
    tuned = ("K_p", "K_int", "K_d", "K_lambda", "K_I")
    shown = ("joint_error", "joint_rate_error")
    signals = {  # noqa: RUF012 - a constant
        "joint_error": Signal("rad", "errors of wheels and independent arm joints", "independent"),
        "joint_rate_error": Signal("rad/s", "errors of their rates", "independent"),
        "error_integral": Signal("rad s", "integral of their errors", "independent"),
        **FORCE,
    }

"""The paper's controller as a kind: its gains, with the defaults of section IV; ``control/`` has its equations.

>>> Gains().k1
180.0
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from coopmm_jax.algebra.types import Vector
from coopmm_jax.kinds.controllers import ESTIMATE, Signal, by_module, gain
from coopmm_jax.kinds.registry import register
from coopmm_jax.kinds.shared_gains import (
    FILTER,
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


@register("controller", "robust_adaptive")
@by_module("coopmm_jax.control.robust_adaptive", "estimates")
class Gains(NamedTuple):
    """Robust adaptive controller of section III: (12)-(15), (18)-(24), and the force control below (17)."""

    k0: EtaDecay = 5.0
    k1: Heading = 180.0
    k2: Lateral = 5.0
    k3: Forward = 5.0
    k4: Steering = 5.0
    K_a: ArmFeedback = 2.0
    K_u: ArmIntegral = 1.0
    K_sigma: SigmaFeedback = (0.5,) * 6
    gamma: Annotated[Vector, gain("adaptation rates", (1e-3, 10.0), ESTIMATE)] = (0.1,) * 5
    c_hat0: Annotated[Vector, gain("initial bounds of the uncertainty", (0.01, 100.0), ESTIMATE, initial=True)] = (
        1.0,
    ) * 5
    K_lambda: ForceFeedback = (0.3,) * 4
    K_I: ForceIntegral = (1.5,) * 4
    beta: UpperInertia = 1.0
    lam_min: LowerInertia = 1.0
    delta_floor: DeltaFloor = 0.0

    lateral = "k2"
    tuned = ("K_sigma", "gamma", "K_lambda", "K_I")
    shown = ("sigma", "c_hat")
    signals = {  # noqa: RUF012 - a constant
        "sigma": SIGMA,
        "c_hat": Signal("-", "estimates of the uncertainty bounds (20)-(24)", "bound", "ĉ [N m per unit of f]"),
        **FILTER,
    }

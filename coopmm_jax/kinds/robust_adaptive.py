"""The paper's controller as a kind: its gains, with the defaults of section IV; ``control/`` has its equations.

>>> Gains().k1
180.0
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.kinds.controllers import ESTIMATE, ROW, VELOCITY, Signal, by_module, force_gain, gain
from coopmm_jax.kinds.registry import register


@register("controller", "robust_adaptive")
@by_module("coopmm_jax.control.robust_adaptive", "estimates")
class Gains(NamedTuple):
    """Robust adaptive controller of section III: (12)-(15), (18)-(24), and the force control below (17)."""

    k0: Annotated[Scalar, gain("decay of eta (14) [1/s]", (0.05, 500.0))] = 5.0
    k1: Annotated[Scalar, gain("backstepping gain of s1", (1.0, 2000.0))] = 180.0
    k2: Annotated[Scalar, gain("backstepping gain of s2", (0.05, 100.0))] = 5.0
    k3: Annotated[Scalar, gain("backstepping gain of s3", (0.05, 100.0))] = 5.0
    k4: Annotated[Scalar, gain("backstepping gain of s4, of platforms on two axles", (0.05, 100.0))] = 5.0
    K_a: Annotated[Scalar, gain("arm position feedback (13) [1/s]", (0.02, 100.0))] = 2.0
    K_u: Annotated[Scalar, gain("integral part of sigma, arm entries [1/s]", (0.01, 100.0))] = 1.0
    K_sigma: Annotated[Vector, gain("feedback of sigma [1/s]", (0.05, 50.0), VELOCITY)] = (0.5,) * 6
    gamma: Annotated[Vector, gain("adaptation rates", (1e-3, 10.0), ESTIMATE)] = (0.1,) * 5
    c_hat0: Annotated[Vector, gain("initial bounds of the uncertainty", (0.01, 100.0), ESTIMATE, initial=True)] = (
        1.0,
    ) * 5
    K_lambda: Annotated[Vector, force_gain("force feedback [-]", (0.0, 30.0))] = (0.3,) * 4
    K_I: Annotated[Vector, gain("integral force feedback [1/s]", (0.05, 200.0), ROW)] = (1.5,) * 4
    beta: Annotated[Scalar, gain("bound of Property 2.2 in (19) [-]", (0.01, 100.0))] = 1.0
    lam_min: Annotated[
        Scalar, gain("lower bound of the reduced inertia's eigenvalues, Property 2.1", (0.01, 100.0), above=0.0)
    ] = 1.0
    delta_floor: Annotated[Scalar, gain("lower bound of delta(t) in (19) [-]", (1e-4, 1.0), section="law")] = 0.0

    lateral = "k2"
    tuned = ("K_sigma", "gamma", "K_lambda", "K_I")
    shown = ("sigma", "c_hat")
    signals = {  # noqa: RUF012 - a constant
        "sigma": Signal(
            "rad/s, m/s, rad/s of each robot",
            "filtered tracking error",
            "independent",
            "\N{GREEK SMALL LETTER SIGMA} [rad/s, m/s]",
        ),
        "c_hat": Signal("-", "estimates of the uncertainty bounds (20)-(24)", "bound", "ĉ [N m per unit of f]"),
        "eta": Signal("rad/s", "eta of (15)", "robot"),
        "integral": Signal("rad", "integral of utilde in sigma", "independent_arm"),
        "force_integral": Signal("N s", "integral of the force error", "row"),
    }

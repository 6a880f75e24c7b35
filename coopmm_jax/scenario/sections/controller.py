"""The sections on the controller: the law in force, its gains, what it knows of the plant, what the robots should do.

A field's name is its symbol in ``parameters.py``, which also holds the defaults (section IV of the paper).

>>> GainsSection().K_lambda
0.3
"""

from __future__ import annotations

from typing import Literal

from coopmm_jax import parameters
from coopmm_jax.scenario.fields import (
    AboveMinusOne,
    Finite,
    NotNegative,
    Pair,
    PerChannel,
    PerEntry,
    Positive,
    Section,
    quantity,
)

_gains, _reference, _structure = parameters.Gains(), parameters.Reference(), parameters.Structure()


class LawSection(Section):
    """[law]: which reading of the control law is in force."""

    robust_term: Literal["proof", "printed"] = quantity(_structure.robust_term, "where c_hat stands in (19)")
    u26: Literal["printed", "corrected"] = quantity(_structure.u26, "form of U26 in (19)")
    feedforward: Literal["projected", "full"] = quantity(
        _structure.feedforward, "how U1 + U2 becomes a force, as after (40) or as in (17)"
    )
    delta_floor: NotNegative = quantity(_gains.delta_floor, "lower bound of delta(t) in (19) [-]")


class GainsSection(Section):
    """[gains]: the design parameters of (12)-(24) and of the force control."""

    K_sigma: PerEntry[NotNegative] = quantity(_gains.K_sigma[0], "feedback of sigma, per independent velocity [1/s]")
    gamma: PerChannel[NotNegative] = quantity(_gains.gamma[0], "adaptation rates of (20)-(24)")
    c_hat0: PerChannel[NotNegative] = quantity(_gains.c_hat0[0], "initial estimates of the uncertainty bounds")
    K_lambda: PerEntry[AboveMinusOne] = quantity(_gains.K_lambda[0], "force feedback, one per constraint row [-]")
    K_I: PerEntry[NotNegative] = quantity(_gains.K_I[0], "integral force feedback, one per constraint row [1/s]")
    K_u: NotNegative = quantity(_gains.K_u, "integral part of sigma, arm entries [1/s]")
    K_a: NotNegative = quantity(_gains.K_a, "arm position feedback (13) [1/s]")
    k0: NotNegative = quantity(_gains.k0, "decay of eta (14) [1/s]")
    k1: NotNegative = quantity(_gains.k1, "backstepping gain of s1")
    k2: NotNegative = quantity(_gains.k2, "backstepping gain of s2")
    k3: NotNegative = quantity(_gains.k3, "backstepping gain of s3")
    beta: NotNegative = quantity(_gains.beta, "bound of Property 2.2 in (19) [-]")
    lam_min: Positive = quantity(_gains.lam_min, "lower bound of the reduced inertia's eigenvalues, Property 2.1")


class NominalSection(Section):
    """[nominal]: the controller's masses and inertias; one left out is the plant's, times ``scale``."""

    scale: Positive = quantity(1.0, "factor on the plant's masses and inertias, object included [-]")
    m_p: Pair[Positive] | None = quantity(None, "mass of the platform [kg]")
    m1: Pair[Positive] | None = quantity(None, "mass of the column [kg]")
    m2: Pair[Positive] | None = quantity(None, "mass of link 2 [kg]")
    m3: Pair[Positive] | None = quantity(None, "mass of link 3 [kg]")
    I_w: Pair[Positive] | None = quantity(None, "moment of inertia of one wheel [kg m^2]")
    I_p: Pair[Positive] | None = quantity(None, "yaw moment of inertia of the platform [kg m^2]")
    I1: Pair[Positive] | None = quantity(None, "yaw moment of inertia of the column [kg m^2]")
    I2: Pair[Positive] | None = quantity(None, "moment of inertia of link 2 [kg m^2]")
    I3: Pair[Positive] | None = quantity(None, "moment of inertia of link 3 [kg m^2]")
    m_obj: NotNegative | None = quantity(None, "point mass of the object [kg]")


class ReferenceSection(Section):
    """[reference]: desired motion and contact force."""

    rate: Finite = quantity(_reference.rate, "yaw rate u_d1 of both platforms [rad/s]")
    radius: Pair[Finite] = quantity(_reference.radius, "radius z_d2 of the platform's circle [m]")
    arm_centre: Pair[Finite] = quantity(_reference.arm_centre, "a1_d = arm_centre - arm_swing cos(arm_rate t) [rad]")
    arm_swing: Pair[Finite] = quantity(_reference.arm_swing, "amplitude of a1_d [rad]")
    arm_rate: Finite = quantity(_reference.arm_rate, "angular frequency of a1_d [rad/s]")
    contact_force: Finite = quantity(_reference.contact_force, "desired normal contact force, pressing if positive [N]")

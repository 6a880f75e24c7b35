"""Gains and signals that several controllers have in common: those of (12)-(15), (17) and (19).

>>> SIGMA.unit
'rad/s, m/s, rad/s of each robot'
"""

from __future__ import annotations

from typing import Annotated, TypeAlias

from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.kinds.controllers import ROW, VELOCITY, Signal, force_gain, gain

EtaDecay: TypeAlias = Annotated[Scalar, gain("decay of eta (14) [1/s]", (0.05, 500.0))]
Heading: TypeAlias = Annotated[Scalar, gain("backstepping gain of s1", (1.0, 2000.0))]
Lateral: TypeAlias = Annotated[Scalar, gain("backstepping gain of s2", (0.05, 100.0))]
Forward: TypeAlias = Annotated[Scalar, gain("backstepping gain of s3", (0.05, 100.0))]
Steering: TypeAlias = Annotated[Scalar, gain("backstepping gain of s4, of platforms on two axles", (0.05, 100.0))]
ArmFeedback: TypeAlias = Annotated[Scalar, gain("arm position feedback (13) [1/s]", (0.02, 100.0))]
ArmIntegral: TypeAlias = Annotated[Scalar, gain("integral part of sigma, arm entries [1/s]", (0.01, 100.0))]
SigmaFeedback: TypeAlias = Annotated[Vector, gain("feedback of sigma [1/s]", (0.05, 50.0), VELOCITY)]
ForceFeedback: TypeAlias = Annotated[Vector, force_gain("force feedback [-]", (0.0, 30.0))]
ForceIntegral: TypeAlias = Annotated[Vector, gain("integral force feedback [1/s]", (0.05, 200.0), ROW)]
UpperInertia: TypeAlias = Annotated[Scalar, gain("bound of Property 2.2 in (19) [-]", (0.01, 100.0))]
LowerInertia: TypeAlias = Annotated[
    Scalar, gain("lower bound of the reduced inertia's eigenvalues, Property 2.1", (0.01, 100.0), above=0.0)
]
DeltaFloor: TypeAlias = Annotated[Scalar, gain("lower bound of delta(t) in (19) [-]", (1e-4, 1.0), section="law")]

SIGMA = Signal(
    "rad/s, m/s, rad/s of each robot",
    "filtered tracking error",
    "independent",
    "\N{GREEK SMALL LETTER SIGMA} [rad/s, m/s]",
)
FORCE = {"force_integral": Signal("N s", "integral of the force error", "row")}
FILTER = {
    "eta": Signal("rad/s", "eta of (15)", "robot"),
    "integral": Signal("rad", "integral of utilde in sigma", "independent_arm"),
    **FORCE,
}

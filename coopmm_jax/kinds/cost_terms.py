"""Terms of the tuner's cost as kinds: what should be small at a sample of a rollout, as ``tuning`` averages it.

>>> terms()["force"].made.weight
1.0
"""

from __future__ import annotations

from typing import Any

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.kinds.protocol import Attribute, Group, Kind, Method
from coopmm_jax.kinds.registry import declare, known, register_constants

COST_TERM = "cost_term"

declare(
    Group(
        COST_TERM,
        "a term of the tuner's cost",
        (Method("value", ("sample",), "its value at a sample, not negative; the cost has its time average", 0.0),),
        (
            Attribute("unit", "of its time average, as text", str),
            Attribute("floor", "the least value that it is scaled by: what is as good as zero", float),
            Attribute("weight", "of [tuning.weights], unless a scenario says otherwise", float),
            Attribute("after_start", "whether samples before tuning.tracking_from count as zero", bool, False),
        ),
    )
)


def terms() -> dict[str, Kind]:
    """Terms of the cost by name, built-in ones first."""
    return known(COST_TERM)


def _builtin(name: str, unit: str, floor: float, weight: float, meaning: str, after_start: bool = False) -> None:
    def value(self: Any, sample: Any) -> Scalar:
        return sample.terms[name]  # computed together, in ``tuning/cost/objective.py``

    about = {"unit": unit, "floor": floor, "weight": weight, "after_start": after_start}
    register_constants(COST_TERM, name, meaning, value=value, **about)


_builtin("object", "m^2", 1e-6, 1.0, "squared distance of the object from its desired point", after_start=True)
_builtin("relative", "m^2", 1e-6, 1.0, "likewise of tip I on the object's surface", after_start=True)
_builtin("posture", "rad^2, m^2", 1e-6, 1.0, "squared errors of both platforms and arms", after_start=True)
_builtin("force", "N^2", 1e-2, 1.0, "squared error of the normal contact force")
_builtin("internal", "N^2", 1e-2, 0.1, "squared other constraint forces")
_builtin("contact_loss", "N^2", 1e-2, 1.0, "squared pull that would be needed to keep the contact")
_builtin("effort", "N^2 m^2", 1e-2, 0.01, "squared torques")
# With 0.01 gains come out that chatter.
_builtin("torque_variation", "N m/s", 1.0, 0.1, "torque changes from sample to sample")
_builtin("saturation", "N^2 m^2", 1e-2, 0.1, "squared torque asked for beyond the actuators' limits")

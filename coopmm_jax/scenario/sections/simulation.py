"""The section [simulation] of a scenario: horizon, step, what is recorded, and the seed.

>>> SimulationSection().duration
20.0
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.fields import Count, Positive, Section, quantity

MOST_STEPS = 2**31  # they are counted on 32 bits


def is_whole(ratio: float) -> bool:
    """True if a ratio of two times [-] is a whole number, 1 at least, but for rounding errors."""
    return math.isfinite(ratio) and round(ratio) >= 1 and math.isclose(ratio, round(ratio), rel_tol=1e-9)


class SimulationSection(Section):
    """[simulation]: horizon, integration step, what is recorded."""

    duration: Positive = quantity(20.0, "simulated time [s]")
    step: Positive = quantity(0.001, "integration step of RK4 [s]")
    record_every: Count = quantity(1, "steps from one recorded sample to the next")
    precision: Literal["float64", "float32"] = quantity("float64", "floating point numbers of the run")
    seed: Annotated[int, Strict(), Field(ge=0, lt=2**32)] = quantity(0, "of everything random in the run")
    stream: Annotated[int, Strict(), Field(ge=0, lt=2**24)] = quantity(0, "of the seed's noise; in a sweep, the sample")

    @model_validator(mode="after")
    def _whole_samples(self) -> SimulationSection:
        if not self.duration / self.step < MOST_STEPS:
            raise UserError("duration", f"less than {MOST_STEPS} steps of {self.step:g} s", self.duration)
        sample = self.step * self.record_every
        if not is_whole(self.duration / sample):
            raise UserError("duration", f"a whole number of step * record_every ({sample:g} s)", self.duration)
        return self

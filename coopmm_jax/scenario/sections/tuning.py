"""The section [tuning] of a scenario: which gains are tuned, for what, on how many samples, for how long.

    [tuning]
    gains = ["K_lambda", "K_I"]
    bounds = { K_lambda = [0.0, 8.0] }
    weights = { force = 2.0 }

>>> tuning_section("robust_adaptive")().bounds.K_lambda
(0.0, 30.0)
"""

from __future__ import annotations

import functools
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, Strict, create_model, field_validator, model_validator

from coopmm_jax.errors import UserError, shown
from coopmm_jax.kinds import controllers, cost_terms
from coopmm_jax.scenario.fields import Count, Finite, NotNegative, Positive, Section, quantity
from coopmm_jax.scenario.validation import closest

Adversaries = Annotated[int, Strict(), Field(ge=0, le=32)]  # no search finds more different ones for certain
Knots = Annotated[int, Strict(), Field(ge=1, le=64)]
Population = Annotated[int, Strict(), Field(ge=4)]
Level = Annotated[float, Strict(), Field(ge=0, lt=1)]


def _range(offset: float) -> Any:
    bound = Annotated[Finite, Field(gt=0.0 - offset)]  # 0 - 0 is 0, in messages too
    return Annotated[tuple[bound, bound], Field(min_length=2, max_length=2)]


class Bounds(Section):
    """[tuning.bounds]: [low, high] of every entry of a gain; the search is logarithmic between them."""

    @model_validator(mode="after")
    def _low_before_high(self) -> Self:
        for name, (low, high) in self:
            if not low < high:
                raise UserError(name, "a lower and a higher bound", [low, high])
        return self


class OfTerms(Section, extra="allow"):
    """A number for each term of the cost; terms of plugins come on top of the declared fields."""

    table: ClassVar[str]

    @model_validator(mode="after")
    def _known_terms(self) -> Self:
        for name in self.__pydantic_extra__ or ():
            if name not in cost_terms.terms():
                must = f"a field of [{self.table}]{closest(name, cost_terms.terms())}, or a term of a --plugin"
                raise UserError(name, must, "unknown")
        return self


_weights: dict[str, Any] = {name: (NotNegative, kind.made.weight) for name, kind in cost_terms.terms().items()}
_Weights = create_model("_Weights", __base__=OfTerms, **_weights)
_scales: dict[str, Any] = dict.fromkeys(cost_terms.terms(), (Positive | None, None))
_Scales = create_model("_Scales", __base__=OfTerms, **_scales)


class Weights(_Weights):
    """[tuning.weights]: of the cost's terms, each of which is 1 under the starting gains."""

    table = "tuning.weights"
    # of the terms that plugins have registered
    __pydantic_extra__: dict[str, NotNegative] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    def of_all(self) -> dict[str, float]:
        """Weight of every term, also of those of plugins, in the order of ``cost_terms.terms()``."""
        own = dict(self)
        return {name: own.get(name, kind.made.weight) for name, kind in cost_terms.terms().items()}


class Scales(_Scales):
    """[tuning.scales]: what the cost's terms are divided by; one left out is its mean under the starting gains.

    Tunings that start elsewhere, or under another controller, have the same cost where these are given.
    """

    table = "tuning.scales"
    # of the terms that plugins have registered
    __pydantic_extra__: dict[str, Positive] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    def of_all(self) -> dict[str, float | None]:
        """Scale of every term, None where it is left out, in the order of ``cost_terms.terms()``."""
        own = dict(self)
        return {name: own.get(name) for name in cost_terms.terms()}


def minimised(goals: str) -> str:
    """Word for the number that a search with these goals minimises.

    >>> minimised("cost"), minimised("requirements")
    ('cost', "goals' value")
    """
    return "cost" if goals == "cost" else "goals' value"


class TuningSection(Section):
    """[tuning]: gains, cost, samples and duration of a tuning; see its .bounds, .weights and .scales."""

    path: ClassVar[str] = "tuning"
    gains: tuple[str, ...] = quantity((), "gains to tune, by name")
    channels: Literal["separate", "shared"] = quantity("separate", "entries of a gain tuned one by one or as one")
    schedule: Knots = quantity(1, "knots of every tuned gain, linear between them; 1: constant gains")
    schedule_over: Literal["time", "phase"] = quantity(
        "time", "what the knots are spread over: the duration, or one turn or the whole length of the path"
    )
    bounds: Bounds = quantity(Bounds(), "[low, high] by gain")
    weights: Weights = quantity(Weights(), "of the cost's terms, by name")
    scales: Scales = quantity(Scales(), "what the cost's terms are divided by, by name")
    adversaries: Adversaries = quantity(0, "worst samples searched for after an iteration, to train on from then on")
    goals: Literal["cost", "requirements"] = quantity(
        "cost", "what is minimised: the weighted terms, or soft [requirements] as far as the hard ones are kept"
    )
    hard_over: Literal["worst", "cvar", "fraction"] = quantity(
        "worst", "robots that keep hard requirements: the worst, the worst ones on average, or a share of all"
    )
    hard_level: Level = quantity(0.99, "share of the robots: cvar leaves out the best ones, fraction asks for so many")
    hard_reserve: NotNegative = quantity(0.05, "robustness asked of hard requirements in tuning, in units of the scale")
    risk: Literal["mean", "cvar", "soft_worst", "worst"] = quantity("mean", "how samples' costs become one")
    risk_level: Level = quantity(0.9, "cvar: share of the samples left out, the best ones")
    sharpness: Positive = quantity(2.0, "soft_worst: of the exponential; towards worst as it grows")
    tracking_from: NotNegative = quantity(1.5, "time before which tracking does not count, the start decides it [s]")
    validation_samples: Count = quantity(32, "fixed samples that scale the cost, and choose among what was found")
    test_samples: Count = quantity(128, "samples for the final figures alone")
    budget: Positive = quantity(180.0, "simulated steps of the search, its last iteration excepted [million]")
    starts: Count = quantity(256, "starting points: the scenario's gains and scrambled Sobol points")
    screening_samples: Count = quantity(4, "samples that choose among the starting points")
    samples: Count = quantity(
        4,
        "samples of a generation or descent, drawn anew; of a scan 2, of late generations up to 4 times as many",
    )
    precision: Literal["mixed", "float64"] = quantity(
        "mixed", "floating point numbers: mixed takes float32 where candidates lie far apart, twice as fast"
    )
    optimiser: str = quantity("auto", "auto (lbfgs from 100 numbers on, else cma), cma, lbfgs, or one of optax by name")
    population: Population = quantity(16, "cma: candidates of a generation")
    steps: Count = quantity(4, "of a descent on the same samples")
    patience: Count = quantity(3, "descents in a row without a better result after which they end")
    learning_rate: Positive = quantity(0.1, "of optax's optimisers")
    decay: Literal["constant", "cosine"] = quantity("constant", "of the learning rate")
    clip: Positive | None = quantity(None, "largest norm of the gradient given to optax's optimisers")

    @property
    def minimised(self) -> str:
        """Word for the number that the search minimises."""
        return minimised(self.goals)

    @property
    def coarse(self) -> str:
        """Floating point numbers where candidates lie far apart: screening, first scan, wide search, margins."""
        return "float32" if self.precision == "mixed" else "float64"

    @field_validator("gains", mode="before")
    @classmethod
    def _known_gains(cls, names: Any) -> Any:
        tunable: Any = cls.model_fields["bounds"].annotation
        fields = tunable.model_fields
        known = ", ".join(fields)
        names = [names] if isinstance(names, str) else names
        if not isinstance(names, list | tuple):
            raise UserError("", f"some of {known}", names)
        for name in names:
            if not isinstance(name, str) or name not in fields:
                raise UserError("", f"some of {known}{closest(shown(name), fields)}", name)
        if len(set(names)) < len(names) or not names:
            raise UserError("", "different names, at least one", list(names))
        return names


@functools.cache
def tuning_section(name: str) -> type[TuningSection]:
    """Class of the section [tuning] for the gains of a controller."""
    made = controllers.controller(name).made
    ranges: dict[str, Any] = {
        gain: (_range(about.offset), about.bounds) for gain, about in controllers.gains_of(made).items()
    }
    bounds = create_model("Bounds", __base__=Bounds, __doc__=Bounds.__doc__, **ranges)
    fields: dict[str, Any] = {
        "gains": (tuple[str, ...], quantity(controllers.tuned(made), "gains to tune, by name")),
        "bounds": (bounds, quantity(bounds(), "[low, high] by gain")),
    }
    return create_model("TuningSection", __base__=TuningSection, __doc__=TuningSection.__doc__, **fields)

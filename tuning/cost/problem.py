"""A scenario's tuning problem: what is minimised, and on which samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.scenario import plausible
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.variation import Variation, vary
from tuning.cost import evaluate
from tuning.cost.evaluate import Samples
from tuning.cost.gain_space import GainSpace
from tuning.cost.objective import Objective, coefficients
from tuning.cost.risk import risk
from tuning.search.method import Search

# First index of each set among the samples of the scenario's seed; the test set is the head of what a sweep would draw.
TEST, VALIDATION, RACE, TRAINING = 0, 1_000_000, 2_000_000, 3_000_000


@dataclass(frozen=True)
class Problem:
    """Everything a tuning run needs and does not change."""

    scenario: Scenario
    variation: Variation
    training: Search  # over [tuning] horizon
    validation: Search  # over the whole duration

    @property
    def space(self) -> GainSpace:
        """The tuned numbers."""
        return self.training.objective.space

    def starts(self) -> np.ndarray:
        """Where a search begins: the scenario's gains, then tuning.starts - 1 scrambled Sobol points (C, n)."""
        return self.space.starts(self.scenario.tuning.starts, self.scenario.simulation.seed)

    def samples(self, first: int, count: int) -> Samples:
        """The samples ``first`` to ``first + count - 1``."""
        return _draw(self.variation, first, count)


def build_problem(scenario: Scenario, descends: bool = False) -> Problem:
    """The problem of a scenario with [uncertainty]; runs the starting gains on the validation set for the scales.

    Args:
        descends: gradients over the training horizon will be needed, so that their compilation may as well begin.

    Raises:
        UserError: nothing varies, a set does not fit, a bound excludes the start, or no sample survives the start.
    """
    settings, duration = scenario.tuning, scenario.simulation.duration
    variation = vary(scenario)
    if not variation.numbers:
        raise UserError("uncertainty", "given, so that there is something to be robust against", "empty")
    if settings.horizon > duration:
        raise UserError("tuning.horizon", f"at most simulation.duration ({duration:g} s)", settings.horizon)
    if settings.tracking_from >= settings.horizon:
        must = f"before tuning.horizon ({settings.horizon:g} s)"
        raise UserError("tuning.tracking_from", must, settings.tracking_from)
    if round(settings.horizon / scenario.sample_time) < 1:
        raise UserError("tuning.horizon", f"at least one sample time ({scenario.sample_time:g} s)", settings.horizon)
    if settings.survivors > settings.starts:
        raise UserError("tuning.survivors", f"at most tuning.starts ({settings.starts})", settings.survivors)
    plausible.warn_of(scenario)
    fixed = _draw(variation, VALIDATION, settings.validation_samples)
    if descends:
        evaluate.compile_gradients(Objective.of(scenario, variation.structure(), settings.horizon), fixed)
    searches = (_search(scenario, variation, horizon, fixed) for horizon in (settings.horizon, duration))
    return Problem(scenario, variation, *searches)


def _draw(variation: Variation, first: int, count: int) -> Samples:
    indices = range(first, first + count)
    points = sampler("independent", variation.scenario.simulation.seed, len(variation.draws))(indices)
    return Samples(variation.batch(points, indices))


def _search(scenario: Scenario, variation: Variation, horizon: float, fixed: Samples) -> Search:
    """Terms scaled by what they are under the starting gains, over the fixed samples that complete."""
    settings = scenario.tuning
    objective = Objective.of(scenario, variation.structure(), horizon)
    found = evaluate.evaluate(objective, objective.space.start[None], fixed)
    completed = found.completed[0]
    if not completed.any():
        raise UserError("gains", "such that at least one validation sample completes", "none that does")
    scales = np.mean(found.terms[0][completed], axis=0)
    chosen = risk(settings.risk, settings.risk_level, settings.sharpness)
    return Search(objective, coefficients(dict(settings.weights), scales), chosen)

"""A scenario's tuning problem: gains as a vector, what they cost, and on which samples.

For an optimiser of your own:

    problem = tuning.build_problem("sensed")
    problem.names, problem.low, problem.high      # n numbers, logarithms of gains, and their bounds
    problem.costs(vectors)                        # (C, n) -> (C,): mean cost over 32 fixed robots, the whole duration
    problem.slopes(vectors)                       # -> (C,), (C, n): exact gradients
    tuning.report(problem, vector)                # before and after, on robots that nothing was chosen by
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from coopmm_jax.errors import UserError
from coopmm_jax.memory import check_memory
from coopmm_jax.scenario import plausible
from coopmm_jax.scenario.feasible import check_reference
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.variation import HIGHEST, LOWEST, Variation, vary
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost import evaluate
from tuning.cost.evaluate import Samples
from tuning.cost.gain_space import GainSpace
from tuning.cost.goals import Goals
from tuning.cost.objective import TERMS, Objective, coefficients
from tuning.cost.risk import risk
from tuning.cost.robust_cost import RobustCost

# First index of each set among the samples of the scenario's seed; the test set is the head of what a sweep would draw.
TEST, VALIDATION, TRAINING = 0, 1_000_000, 3_000_000
# Sobol sets drawn for a search are numbered from 0 on; these are fixed ones.
CHOICE, SCREENING = -1, -2
# Memory [byte] of a sample's parameters, several times over, and of what is kept of a rollout.
_PER_SAMPLE, _PER_ROLLOUT = 5000.0, 500.0
_SET = 4096  # room for the noise streams of a Sobol set


@dataclass(frozen=True)
class Problem:
    """Everything that tuning a scenario needs and does not change."""

    scenario: Scenario
    variation: Variation
    cost: RobustCost  # over the whole duration
    goals: Goals | None = None  # what is minimised where tuning.goals is "requirements"
    executor: Executor | None = None  # whose workers run it, see ``coopmm_jax/sweeps/engine.py``

    @property
    def space(self) -> GainSpace:
        """The tuned numbers."""
        return self.cost.objective.space

    @property
    def aim(self) -> RobustCost | Goals:
        """Cost or goals, whichever is minimised."""
        return self.cost if self.goals is None else self.goals

    @property
    def names(self) -> list[str]:
        """Name of each number (n,), as K_I[2]."""
        return self.space.labels()

    @property
    def start(self) -> np.ndarray:
        """The vector of the scenario's own gains (n,)."""
        return self.space.start

    @property
    def low(self) -> np.ndarray:
        """Lower bounds of vectors (n,)."""
        return np.array(self.space.low)

    @property
    def high(self) -> np.ndarray:
        """Upper bounds of vectors (n,)."""
        return np.array(self.space.high)

    def costs(self, vectors: np.ndarray, samples: Samples | None = None, precision: str = "float64") -> np.ndarray:
        """Risks (C,) of vectors (C, n), each of them moved between the bounds first.

        Args:
            vectors: logarithms of gains, see ``GainSpace``.
            samples: robots to try them on; the fixed ones that tuning chooses by if left out.
            precision: float64, or float32, which is twice as fast and tells candidates apart that are not close.
        """
        inside = self.space.inside(np.atleast_2d(vectors))
        with carried_by(self.executor):
            return self.aim.values(inside, self.fixed if samples is None else samples, precision)

    def slopes(self, vectors: np.ndarray, samples: Samples | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Risks (C,) of vectors (C, n) and their exact gradients (C, n), by reverse mode through the rollouts.

        Args:
            vectors: logarithms of gains, between the bounds.
            samples: as in ``costs``.
        """
        inside = self.space.inside(np.atleast_2d(vectors))
        with carried_by(self.executor):
            return self.aim.slopes(inside, self.fixed if samples is None else samples)

    def samples(self, first: int, count: int) -> Samples:
        """The independent samples ``first`` to ``first + count - 1``."""
        indices = range(first, first + count)
        points = sampler("independent", self.scenario.simulation.seed, len(self.variation.draws))(indices)
        return Samples(self.variation.batch(points, indices))

    def drawn(self, count: int, draw: int) -> Samples:
        """A scrambled Sobol set of samples; every ``draw`` is another one.

        The mean over 16 of them scatters a tenth as much as over 16 independent samples (``sensed``).
        """
        seed = (self.scenario.simulation.seed, draw - SCREENING)
        engine = qmc.Sobol(len(self.variation.draws), scramble=True, rng=np.random.default_rng(seed))
        points = engine.random_base2((count - 1).bit_length())[:count]
        first = TRAINING + _SET * (draw - SCREENING)
        return Samples(self.variation.batch(np.clip(points, LOWEST, HIGHEST), range(first, first + count)))

    @functools.cached_property
    def fixed(self) -> Samples:
        """The Sobol set that tuning chooses by."""
        return self.drawn(self.scenario.tuning.validation_samples, CHOICE)


def build_problem(scenario: Scenario | str | Path, executor: Executor | None = None) -> Problem:
    """The problem of a scenario with [uncertainty]; runs the starting gains on fixed samples for the scales.

    Args:
        scenario: a scenario, or the name or path of one.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.

    Raises:
        UserError: nothing varies, a setting does not fit, a bound excludes the start, or no sample survives the start.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    plausible.warn_of(scenario)
    check_reference(scenario)
    problem = replace(unscaled(scenario), executor=executor)
    return scaled(problem, problem.start)


def unscaled(scenario: Scenario) -> Problem:
    """The problem of a scenario before its terms are scaled: all have the weight 0. Nothing is compiled or run.

    Raises:
        UserError: as ``check_tuning``.
    """
    variation = check_tuning(scenario)
    return with_objective(
        scenario, variation, Objective.of(scenario, variation.structure(), scenario.simulation.duration)
    )


def check_tuning(scenario: Scenario) -> Variation:
    """Variation of a scenario that can be tuned; nothing is compiled or run.

    Raises:
        UserError: nothing varies, a setting does not fit, or more samples than memory has room for.
    """
    settings, duration = scenario.tuning, scenario.simulation.duration
    variation = vary(scenario)
    if not variation.numbers:
        raise UserError("uncertainty", "given, so that there is something to be robust against", "empty")
    if settings.tracking_from >= duration:
        raise UserError("tuning.tracking_from", f"before simulation.duration ({duration:g} s)", settings.tracking_from)
    if settings.goals == "requirements" and not scenario.requirements.parsed():
        raise UserError("requirements", "given where tuning.goals is requirements", "empty")
    for name in ("starts", "screening_samples", "samples", "validation_samples", "test_samples"):
        count = getattr(settings, name)
        check_count(count, f"tuning.{name}", settings.starts if name == "screening_samples" else 1)
    Objective.of(scenario, variation.structure(), duration)  # has bounds that can be wrong
    return variation


def check_count(count: int, field: str, candidates: int = 1) -> None:
    """Refuse more samples than memory has room for.

    Args:
        count: of the samples, or of vectors to begin a search at.
        field: what the user knows it as, for the error.
        candidates: vectors that are run on each.

    Raises:
        UserError: less than one, or too many.
    """
    if not 1 <= count < 2**31:
        raise UserError(field, "at least 1" if count < 1 else f"less than {2**31}", count)
    check_memory((_PER_SAMPLE + _PER_ROLLOUT * candidates) * count, field, "smaller", count)


def with_objective(scenario: Scenario, variation: Variation, objective: Objective) -> Problem:
    """The problem of any objective, before its terms are scaled."""
    settings = scenario.tuning
    chosen = risk(settings.risk, settings.risk_level, settings.sharpness)
    goals = Goals.of(objective, scenario) if settings.goals == "requirements" else None
    return Problem(scenario, variation, RobustCost(objective, np.zeros(len(TERMS)), chosen), goals)


def scaled(problem: Problem, start: np.ndarray) -> Problem:
    """The problem with its terms scaled as ``scales`` says, from the vector ``start`` (n,).

    Raises:
        UserError: as ``scales``.
    """
    return with_scales(problem, scales(problem, start))


def with_scales(problem: Problem, scales: Mapping[str, float]) -> Problem:
    """The problem with its terms (9,) divided by these scales, by name."""
    weights = problem.scenario.tuning.weights.of_all()
    return replace(problem, cost=replace(problem.cost, coefficients=coefficients(weights, scales)))


def scales(problem: Problem, start: np.ndarray) -> dict[str, float]:
    """Scale of every term by name: as [tuning.scales] says, or its mean under the vector ``start`` (n,).

    The means are over the fixed samples that complete, and not below the floors of ``TERMS``.

    Raises:
        UserError: a scale is left out, and no sample completes.
    """
    given = problem.scenario.tuning.scales.of_all()
    means = {} if all(given.values()) else _means(problem, start)
    return {name: scale or means[name] for name, scale in given.items()}


def _means(problem: Problem, start: np.ndarray) -> dict[str, float]:
    fixed = problem.samples(VALIDATION, problem.scenario.tuning.validation_samples)
    with carried_by(problem.executor):
        found = evaluate.evaluate(problem.cost.objective, start[None], fixed)
    completed = found.completed[0]
    if not completed.any():
        raise UserError("gains", "such that at least one validation sample completes, to scale the cost by", "none")
    means = np.mean(found.terms[0][completed], axis=0)
    return {name: max(float(mean), floor) for (name, (_, floor)), mean in zip(TERMS.items(), means, strict=True)}

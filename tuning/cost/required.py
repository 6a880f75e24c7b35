"""Robustness of a scenario's requirements over rollouts of candidates on samples, and its gradients.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> from tuning.cost.problem import unscaled
>>> required = Required.of(unscaled(load_scenario("sensed")).cost.objective, load_scenario("sensed"))
>>> required.limits[0]
('contact_loss_fraction', '<=')
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Bool, Scalar
from coopmm_jax.errors import UserError
from coopmm_jax.loop.rollout import rollout
from coopmm_jax.metrics import observer
from coopmm_jax.metrics.table import METRICS, registered
from coopmm_jax.parameters import Parameters
from coopmm_jax.scenario.sections.requirements import Requirement, robustness
from coopmm_jax.temporal_logic.sentence import Formula, Numbers, Sentences
from tuning.cost.evaluate import FEW, Kind, Layout, Samples, compile_pairs, on_pairs
from tuning.cost.gain_space import GainSpace
from tuning.cost.objective import Objective

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario

# Differences of margins, in units of a requirement's scale, over which sentences are smooth where slopes are asked for:
# a few samples share the slope of an extreme then, and the robustness is up to a tenth too low after 20,000 of them.
TEMPERATURE = 0.01


class Robustness(NamedTuple):
    """Rollouts of C candidates on N samples, and how far R requirements are from being broken."""

    values: np.ndarray  # (C, N, R) in units of each requirement's scale; below -1e6 of a rollout that failed
    completed: np.ndarray  # (C, N)


@dataclass(frozen=True)
class Required:
    """R requirements over a rollout with the gains of a vector; hashable, so that it can be static under jit.

    Limits, scales and the numbers of sentences are arguments: ``numbers`` has them, behind R weights for gradients.
    """

    objective: Objective  # whose gains, structure and horizon they are
    limits: tuple[tuple[str, str], ...]  # metric or sentence, and relation (R,)
    forms: tuple[tuple[str, Formula], ...]  # of the sentences among them
    lengths: tuple[int, ...]  # how many numbers each sentence has
    kinds: tuple[tuple[str, type], ...] = field(default_factory=registered)  # of all metrics

    @classmethod
    def of(
        cls, objective: Objective, scenario: Scenario, requirements: Sequence[Requirement] | None = None
    ) -> Required:
        """All requirements of a scenario, or some of them."""
        chosen = scenario.requirements.parsed() if requirements is None else requirements
        sentences = [(each.metric, each.sentence) for each in chosen if each.sentence]
        return cls(
            objective,
            tuple((each.metric, each.relation) for each in chosen),
            tuple((name, sentence.form) for name, sentence in sentences),
            tuple(len(sentence.numbers) for _, sentence in sentences),
        )

    @property
    def space(self) -> GainSpace:
        """Gains that a vector (n,) stands for."""
        return self.objective.space

    def numbers(self, requirements: Sequence[Requirement], weights: Any = 0.0) -> np.ndarray:
        """Argument of ``evaluate`` and ``cost`` (..., k): weights (..., R), limits, scales, numbers of sentences."""
        limits = [each.limit for each in requirements]
        scales = [each.scale for each in requirements]
        rest = [number for each in requirements if each.sentence for number in each.sentence.numbers]
        weights = np.broadcast_to(weights, (*np.shape(weights)[:-1], len(limits)))
        fixed = np.array([*limits, *scales, *rest])
        return np.concatenate([weights, np.broadcast_to(fixed, (*weights.shape[:-1], len(fixed)))], axis=-1)

    def evaluate(self, vector: Any, parameters: Parameters, numbers: Any, smoothly: bool = False) -> tuple[Any, Bool]:
        """Robustness (R,) in units of the scales, and whether the rollout completed.

        Args:
            vector: numbers of the gain space (n,).
            parameters: of one sample, scalars.
            numbers: as ``numbers`` makes them (k,).
            smoothly: static; sentences with smooth extremes, and the form that ``jax.grad`` runs fast.
        """
        one, count = self.objective, len(self.limits)
        limits, scales = numbers[count : 2 * count], numbers[2 * count : 3 * count]
        stated = [Requirement(*each, limits[i], scales[i]) for i, each in enumerate(self.limits)]
        names = tuple(dict.fromkeys(name for name, _ in self.limits if name in METRICS))
        about = {"duration": one.steps * one.step, "step": one.step, "names": names}
        about["sentences"] = self._sentences(numbers[3 * count :], {each.metric: each.scale for each in stated})
        parameters = one.space.applied(parameters, vector)
        watching = observer.observer(one.structure, parameters, **about, smoothly=smoothly)
        result = rollout(one.structure, parameters, one.step, one.steps, one.plan(smoothly), watching)
        temperature = TEMPERATURE if smoothly else None
        loop = (one.structure, parameters)
        found = observer.finish(result.total, **about, kept=result.kept, loop=loop, temperature=temperature)
        completed, survived = one.outcome(result)
        return robustness(stated, found, completed, survived), completed

    def cost(self, vector: Any, parameters: Parameters, numbers: Any) -> Scalar:
        """Sum of the smooth robustness of all requirements, each times its weight, at a vector of gains (n,)."""
        values, _ = self.evaluate(vector, parameters, numbers, smoothly=True)
        return jnp.dot(numbers[: len(self.limits)], values)

    def _sentences(self, numbers: Any, scales: dict[str, Any]) -> Sentences:
        ends = np.cumsum((0, *self.lengths))
        parts = (numbers[begin:end] for begin, end in pairwise(ends))
        own = (Numbers(part, scales[name]) for (name, _), part in zip(self.forms, parts, strict=True))
        return Sentences(self.forms, tuple(own))


def evaluate(
    required: Required, vectors: np.ndarray, samples: Samples, numbers: np.ndarray, precision: str = "float64"
) -> Robustness:
    """Robustness of every requirement for every candidate (C, n) on every sample.

    Args:
        required: the requirements.
        vectors: candidates (C, n).
        samples: N of them.
        numbers: of the requirements (k,).
        precision: float64 or float32.

    Raises:
        UserError: a plugin's metric or signal is not finite in a rollout that completes.
    """
    found = Robustness(*on_pairs(_VALUES, required, vectors, samples, numbers, precision))
    for i, (name, _) in enumerate(required.limits):
        values = found.values[..., i][found.completed]
        if not np.isfinite(values).all():
            raise UserError(f"requirements.{name}", "of what is finite in every rollout that completes", "not finite")
    return found


def gradients(required: Required, vectors: np.ndarray, samples: Samples, numbers: np.ndarray) -> np.ndarray:
    """Gradients of ``Required.cost`` (C, N, n) by reverse mode; numbers (C, N, k) have the weights of every pair."""
    return on_pairs(_GRADIENT, required, vectors, samples, numbers)[0]


def sensitivities(required: Required, vectors: np.ndarray, samples: Samples, numbers: np.ndarray) -> np.ndarray:
    """Gradients of ``Required.cost`` by the samples' own numbers (C, N, leaves), in the order of ``Samples.rows``."""
    return on_pairs(_SENSITIVITY, required, vectors, samples, numbers)[0]


def compile_values(required: Required, samples: Samples, numbers: np.ndarray, precision: str) -> None:
    """Compile what ``evaluate`` runs on samples of this structure, with numbers (k,)."""
    compile_pairs(_VALUES, required, samples, len(numbers), precision)


def compile_gradients(required: Required, samples: Samples, numbers: np.ndarray) -> None:
    """Compile what ``gradients`` runs on samples of this structure, with numbers (k,)."""
    compile_pairs(_GRADIENT, required, samples, len(numbers), "float64")


def _values(
    required: Required, layout: Layout, vector: jax.Array, own: jax.Array, numbers: jax.Array, common: jax.Array
) -> tuple:
    return required.evaluate(vector, layout.parameters(own, common), numbers)


def _gradient(*arguments: Any) -> tuple:
    return (jax.grad(_cost, 2)(*arguments),)


def _sensitivity(*arguments: Any) -> tuple:
    return (jax.grad(_cost, 3)(*arguments),)


def _cost(
    required: Required, layout: Layout, vector: jax.Array, own: jax.Array, numbers: jax.Array, common: jax.Array
) -> Scalar:
    return required.cost(vector, layout.parameters(own, common), numbers)


_VALUES, _GRADIENT = Kind(_values), Kind(_gradient, FEW)
_SENSITIVITY = Kind(_sensitivity, by_sample=True)

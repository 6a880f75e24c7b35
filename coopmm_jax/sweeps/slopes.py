"""Slopes of success probabilities by gains and tolerances, from the samples of one sweep.

A requirement is met where its robustness rho is not negative, so that its success probability P changes with a number
x by

    dP/dx = E[delta(rho) drho/dx],

the density of the robustness at 0 times the mean slope of the samples there. The sum over samples has a kernel in the
place of delta, Epanechnikov's, of a bandwidth by Silverman's rule; only the samples under it need a gradient.

>>> slope = Estimate.of(np.linspace(-1, 1, 4001), np.ones((4001, 1))).slope[0]  # of P(x + uniform(-1, 1) >= 0) at x = 0
>>> round(float(slope), 3)
0.5
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.errors import UserError
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.metrics import observer
from coopmm_jax.metrics.table import METRICS, registered
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.sections.requirements import Requirement, robustness
from coopmm_jax.scenario.variation import vary
from coopmm_jax.status import Status
from coopmm_jax.sweeps.batch import Device, Program, in_batches, run
from coopmm_jax.sweeps.engine import naming
from coopmm_jax.sweeps.statistics import Results, as_results
from coopmm_jax.temporal_logic.sentence import Numbers, Sentences

if TYPE_CHECKING:
    import xarray

ALL = "all together"
FEWEST = 2  # samples of a spread, and of a standard error
_BATCH = 4  # gradients in one call: few, since the reverse pass of each keeps much
_KEPT = 2000  # steps of which the reverse pass keeps all; of more it computes most again
# Silverman's rule for a normal kernel, and Epanechnikov's of the same variance of the estimate.
_SILVERMAN, _EPANECHNIKOV = 0.9, 2.214
# Quantities that are 0 or 1, or a time at which something ends: their metrics move in steps and have no slope.
_COUNTED = ("contact_lost", "airborne", "landing", "saturated", "unsettled_until")


class Estimate(NamedTuple):
    """Slopes of one success probability by k numbers."""

    slope: np.ndarray  # (k,)
    error: np.ndarray  # (k,) standard errors

    @classmethod
    def of(cls, rho: np.ndarray, slopes: np.ndarray) -> Estimate:
        """Slopes from robustness (n,), -infinity where a rollout failed, and its slopes (n, k)."""
        terms = weights(rho)[:, None] * slopes
        return cls(terms.mean(axis=0), terms.std(axis=0, ddof=1) / np.sqrt(len(rho)))


class Slope(NamedTuple):
    """Change of a requirement's success probability with one number."""

    requirement: str
    number: str
    value: float
    slope: float  # [1/unit of the number]
    error: float  # its standard error
    samples: int  # under the kernel


def weights(rho: np.ndarray) -> np.ndarray:
    """Kernel at 0 of robustness (n,): zero of samples farther away than the bandwidth, and of rollouts that failed."""
    finite = rho[np.isfinite(rho)]
    found = np.zeros(len(rho))
    if len(finite) < 2:
        return found
    low, high = np.quantile(finite, [0.25, 0.75])
    spread = min(finite.std(ddof=1), (high - low) / 1.34) or finite.std(ddof=1)
    bandwidth = _EPANECHNIKOV * _SILVERMAN * spread * len(finite) ** -0.2
    if bandwidth > 0.0:
        found[np.isfinite(rho)] = np.maximum(0.75 * (1.0 - (finite / bandwidth) ** 2), 0.0) / bandwidth
    return found


def is_counted(requirement: Requirement) -> bool:
    """True if a requirement's metric moves in steps, so that it has no slope."""
    if requirement.sentence is not None:
        return False
    metric = METRICS[requirement.metric]
    return metric.quantity in _COUNTED or metric.reduction in ("count", "time_if_complete")


def slopes(sweep: xarray.Dataset | Results) -> list[Slope]:
    """Slopes of each requirement's success probability, and of all together, by every gain and every tolerance.

    Requirements on metrics that count samples have none; the slopes of all together are without what those contribute.
    Rollouts that fail count as they are: how likely a failure is has no slope either.

    Args:
        sweep: its data set, or the results read from it.

    Raises:
        UserError: fewer than two samples computed, or a corrupt chunk.
    """
    results = as_results(sweep)
    if len(results.index) < FEWEST:
        raise UserError("samples", f"at least {FEWEST} computed ones for slopes", len(results.index))
    smooth = [each for each in results.requirements if not is_counted(each)]
    if not smooth:
        return []
    rho = np.stack([each.robustness(results.metrics[each.metric]) for each in smooth])
    rho = np.where(results.completed, rho, -np.inf)
    active = np.where(_counted_are_met(results), rho.min(axis=0), -np.inf)
    wanted = {(r, i) for r in range(len(smooth)) for i in np.flatnonzero(weights(rho[r])).tolist()}
    wanted |= {(int(rho[:, i].argmin()), i) for i in np.flatnonzero(weights(active)).tolist()}
    pairs = np.array(sorted(wanted), int).reshape(-1, 2)
    names, values, found = _gradients(results, smooth, pairs)
    by_pair = {(r, i): row for (r, i), row in zip(pairs.tolist(), found, strict=True)}
    rows: list[Slope] = []
    cases = [*((str(each), rho[r], np.full(rho.shape[1], r)) for r, each in enumerate(smooth))]
    for label, at, which in (*cases, (ALL, active, rho.argmin(axis=0))):
        near = np.flatnonzero(weights(at))
        moved = np.zeros((len(at), len(names)))
        for i in near.tolist():
            moved[i] = by_pair[int(which[i]), i]
        estimate = Estimate.of(at, moved)
        given = zip(names, values, estimate.slope.tolist(), estimate.error.tolist(), strict=True)
        rows += [Slope(label, *each, samples=len(near)) for each in given]
    return rows


def _counted_are_met(results: Results) -> np.ndarray:
    met = [results.met(each) for each in results.requirements if is_counted(each)]
    return np.logical_and.reduce([results.completed, *met])


def _gradients(
    results: Results, requirements: Sequence[Requirement], pairs: np.ndarray
) -> tuple[list[str], list[float], np.ndarray]:
    """Names and values of gains and tolerances (k,), and slopes (P, k) of the robustness of pairs.

    Args:
        results: of the sweep.
        requirements: those that have slopes.
        pairs: requirement and position among the computed samples (P, 2).
    """
    scenario = results.scenario
    variation = vary(scenario)
    points = sampler(results.data.attrs["sampling"], scenario.simulation.seed, len(results.draws))
    program, shared = _program(variation.structure(), scenario, requirements)
    eye = np.eye(len(requirements))

    def compute(device: Device, chosen: np.ndarray) -> Any:
        indices = results.index[pairs[chosen, 1]].tolist()
        parameters = jax.tree.map(lambda x: np.array(x, float, order="C"), variation.batch(points(indices), indices))
        with naming(f"gradients of samples {min(indices)} to {max(indices)}"):
            return run(program, device, (parameters, eye[pairs[chosen, 0]]), shared)

    own = list(_columns(scenario, requirements))
    names, values = [name for name, *_ in own], [value for _, value, _ in own]
    if not len(pairs):
        return names, values, np.zeros((0, len(own)))
    found = np.concatenate([np.reshape(x, (len(pairs), -1)) for x in in_batches(compute, len(pairs), _BATCH)], axis=1)
    return names, values, np.stack([found[:, places].sum(axis=1) for *_, places in own], axis=1)


def _columns(scenario: Any, requirements: Sequence[Requirement]) -> Iterator[tuple[str, float, list[int]]]:
    """Name and value of every gain and tolerance, and the columns of the gradient that belong to it."""
    parameters, at = scenario.parameters(), 0
    given = scenario.gains.model_dump()
    scheduled = parameters.schedule.values if parameters.schedule else {}
    for name in parameters.gains._fields:
        leaves = jax.tree.leaves(getattr(parameters.gains, name))
        alike = not isinstance(given.get(name), tuple | list)
        parts = [range(len(leaves))] if alike else [[i] for i in range(len(leaves))]
        for i, part in enumerate(parts):
            if name not in scheduled:
                label = f"gains.{name}" + ("" if alike else f"[{i + 1}]")
                yield label, float(leaves[part[0]]), [at + j for j in part]
        at += len(leaves)
    for each in requirements:
        if each.sentence is None:
            yield f"{each.metric} {each.relation}", each.limit, [at]
        at += 1
    for each in requirements:
        for label, number in zip(
            *(each.sentence.labels, each.sentence.numbers) if each.sentence else ((), ()), strict=True
        ):
            if label is not None:
                yield f"{each.metric}: {label}", number, [at]
            at += 1


def _program(structure: Structure, scenario: Any, requirements: Sequence[Requirement]) -> tuple[Program, tuple]:
    """Program of the gradients of one pair, and its arguments that all pairs share."""
    sentences = [(each, each.sentence) for each in requirements if each.sentence]
    forms = tuple((each.metric, sentence.form) for each, sentence in sentences)
    about = tuple((each.metric, each.relation, each.scale) for each in requirements)
    plan = Plan.gradient(scenario.steps, checkpoint=scenario.steps > _KEPT)
    numbers = tuple(np.array(sentence.numbers) for _, sentence in sentences)
    limits = np.array([each.limit for each in requirements])
    extent = (np.asarray(scenario.sample_time, float), np.asarray(scenario.steps, np.int32))
    return Program(_slopes_of, (structure, plan, (registered(), forms, about))), (*extent, numbers, limits)


def _slopes_of(
    structure: Structure,
    plan: Plan,
    asked: Any,
    parameters: Parameters,
    chosen: jax.Array,
    step: Scalar,
    steps: Scalar,
    numbers: Any,
    limits: jax.Array,
) -> tuple[jax.Array, ...]:
    """Slopes of the chosen requirement's robustness: gains, limits and numbers of sentences, each flat."""
    _, forms, about = asked
    names = tuple(dict.fromkeys(name for name, *_ in about if name in METRICS))

    def weighed(gains: Any, limits: jax.Array, numbers: Any) -> Scalar:
        own = parameters._replace(gains=gains)
        sentences = Sentences(forms, tuple(Numbers(values, 1.0) for values in numbers))
        horizon: dict[str, Any] = {"duration": steps * step, "step": step, "sentences": sentences, "names": names}
        result = rollout(structure, own, step, steps, plan, observer.observer(structure, own, **horizon))
        found = observer.finish(result.total, **horizon, kept=result.kept, loop=(structure, own))
        stated = [Requirement(*each, scale=scale) for each, scale in _traced(about, limits)]
        completed = result.health.status == Status.OK.value
        return jnp.dot(chosen, robustness(stated, found, completed, 1.0))

    by_gains, by_limits, by_numbers = jax.grad(weighed, (0, 1, 2))(parameters.gains, limits, numbers)
    return tuple(map(jnp.ravel, (*jax.tree.leaves(by_gains), by_limits, *by_numbers)))


def _traced(about: Any, limits: Any) -> Iterator[tuple[tuple[str, str, Any], float]]:
    """Metric, relation and traced limit of each requirement, and its scale."""
    for (name, relation, scale), limit in zip(about, limits, strict=True):
        yield (name, relation, limit), scale

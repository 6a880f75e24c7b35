"""The sample of a scenario's uncertainty that hurts most, found by climbing the cost through the simulator.

The search runs through the unit cube of the draws behind the uncertain numbers (``coopmm_jax/scenario/variation.py``):
all of it where distributions end, and the middle 99 % of those that do not. What is climbed is the cost of [tuning]
under the scenario's own gains, over the whole duration, as tuning reports it, or how far a requirement is from being
kept. A rollout that fails is worse than any other and ends the search. Noise is not searched: every rollout has the
scenario's own.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.scenario.validation import closest
from coopmm_jax.scenario.variation import HIGHEST, LOWEST, Variation, batched
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost.evaluate import Samples
from tuning.cost.objective import FAILED
from tuning.cost.problem import Problem, build_problem, check_count, unscaled
from tuning.cost.shortfall import Shortfall
from tuning.search.ascent import LADDER, Ascent, Mark, Peak, ascend

ROLLOUTS = 409  # a tenth of 4,096
STARTS = 32
CLIMBERS = 2  # at a time: more starts are tried than climbs could end
TAIL = 0.005  # of an unbounded distribution, left out at either end
REVERSE = 10  # rollouts that one gradient by reverse mode costs (measured: 8.5 to 11)
# Draws up to which gradients come from differences: exact enough to climb by, and their program is compiled already,
# while that of reverse mode takes the better part of a minute. More draws would leave the budget too few rounds.
DIFFERENCES = 32
# First index of the random samples that a found one is compared with: no set of ``tuning/problem.py`` reaches it.
RANDOM = 2_000_000
_STEP = 1e-6  # of one-sided differences, in widths of the cube


class Cost(Protocol):
    """Cost of every rollout, ``FAILED`` or more of one that fails."""

    def each(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Costs (N,) of a vector (n,)."""
        ...

    def by_sample(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Slopes of these costs by every sample's own numbers (N, leaves), of a vector (n,)."""
        ...


class SampleCost:
    """Cost of one vector of gains as a function of the point of the unit cube that a sample lies at.

    A ``Landscape`` for ``search.ascent``; gradients come from one-sided differences, or by reverse mode where draws are
    many.
    """

    def __init__(self, cost: Cost, variation: Variation, vector: np.ndarray):
        self.cost, self.variation, self.vector = cost, variation, vector
        self.low, self.high = box(variation)
        self.reversed = len(variation.draws) > DIFFERENCES
        self.slope_price = REVERSE if self.reversed else len(variation.draws)

    def samples(self, points: np.ndarray) -> Samples:
        """The samples at ``points`` (N, D), with the scenario's own noise."""
        return Samples(self.variation.batch(points, [self.variation.scenario.simulation.stream] * len(points)))

    def values(self, points: np.ndarray) -> np.ndarray:
        """Costs (N,) at points (N, D)."""
        return self.cost.each(self.vector, self.samples(points))

    def slopes(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Gradients (N, D) at points (N, D) whose costs are ``values`` (N,)."""
        return self.reverse(points) if self.reversed else self.differences(points, values)

    def differences(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Gradients (N, D) by one-sided differences, each into the half of the cube that has more room."""
        steps = np.where(points > 0.5, -_STEP, _STEP)
        moved = points[:, None] + steps[:, None] * np.eye(points.shape[1])
        costs = self.values(moved.reshape(-1, points.shape[1]))
        return (costs.reshape(points.shape) - values[:, None]) / steps

    def reverse(self, points: np.ndarray) -> np.ndarray:
        """Gradients (N, D) by reverse mode: through the rollout, then through the map from draws to its parameters."""
        slopes = self.cost.by_sample(self.vector, self.samples(points))
        with jax.enable_x64(True):
            return np.asarray(self._pulled_back(points, slopes))

    @functools.cached_property
    def _pulled_back(self) -> Callable[[np.ndarray, np.ndarray], jax.Array]:
        """Slopes by points (N, D) of slopes by numbers of their samples (N, leaves), compiled as a whole."""

        def row(point: jax.Array) -> jax.Array:
            return jnp.stack([jnp.asarray(leaf, float) for leaf in jax.tree.leaves(self.variation.parameters(point))])

        return jax.jit(lambda points, slopes: jax.vjp(jax.vmap(row), points)[1](slopes)[0])


@dataclass(frozen=True)
class Falsification:
    """The worst sample found and what it took."""

    scenario: Scenario  # of that sample alone, without uncertainty
    numbers: dict[str, float]  # its uncertain numbers by name, in the scenario's units
    nominal: dict[str, float]  # the scenario's own values of these
    cost: float  # or what it falls short of the requirement, in scales; at least ``FAILED`` if its rollout fails
    nominal_cost: float  # of the scenario without uncertainty
    trail: list[Mark]  # rollouts spent and highest cost, after the starts and after every round
    rollouts: int  # spent, gradients included
    steps: int  # simulated in them
    requirement: Requirement | None = None  # that was climbed against; None: the cost was

    @property
    def failed(self) -> bool:
        """True if its rollout fails."""
        return self.cost >= FAILED

    @property
    def violated(self) -> bool:
        """True if it breaks the requirement."""
        return self.requirement is not None and self.cost > 0.0


def falsify(
    scenario: Scenario | str | Path,
    rollouts: int = ROLLOUTS,
    starts: int = STARTS,
    problem: Problem | None = None,
    executor: Executor | None = None,
    requirement: str | None = None,
) -> Falsification:
    """Search a scenario's [uncertainty] for the sample of the highest cost, or that is furthest from a requirement.

    The result depends on the scenario, its seed and the arguments alone.

    Args:
        scenario: a scenario, or the name or path of one; needs [uncertainty].
        rollouts: budget, over the whole duration each; a gradient counts as the rollouts it costs.
        starts: number of scrambled Sobol points from which the climbs set out, the highest first.
        problem: of this scenario, if built already.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.
        requirement: metric or name of a sentence in the scenario's [requirements] whose robustness is brought down;
            left out, the cost is driven up.

    Raises:
        UserError: the scenario has no uncertainty, cannot be tuned or has no such requirement, or the budget has no
            room for a climb.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    check_count(starts, "starts")
    broken = None if requirement is None else requirement_of(scenario, requirement)
    with carried_by(executor):
        if problem is None:
            problem = build_problem(scenario) if broken is None else unscaled(scenario)
        found = climbed(problem, problem.space.start, rollouts, starts, cost_of(problem, broken))
        return sample_found(problem, found.peaks[0], found, broken)


def requirement_of(scenario: Scenario, name: str) -> Requirement:
    """Requirement of a scenario by its metric or the name of its sentence.

    Raises:
        UserError: it has no such requirement.
    """
    known = {each.metric: each for each in scenario.requirements.parsed()}
    if not known:
        raise UserError("--requirement", "of a scenario with [requirements]", name)
    if name not in known:
        raise UserError("--requirement", f"one of {', '.join(known)}{closest(name, known)}", name)
    return known[name]


def cost_of(problem: Problem, requirement: Requirement | None) -> Cost:
    """Height that is climbed: a requirement's shortfall, or what tuning minimises."""
    return problem.aim if requirement is None else Shortfall.of(problem, requirement)


def sample_found(problem: Problem, peak: Peak, search: Ascent, requirement: Requirement | None) -> Falsification:
    """The sample at a point that a search has found.

    Args:
        problem: whose samples were searched.
        peak: the point.
        search: that found it.
        requirement: that it climbed against; None: the cost.
    """
    scenario, variation, objective = problem.scenario, problem.variation, problem.cost.objective
    numbers = {name: float(value) for name, value in variation.values(peak.point).items()}
    nominal = Samples(batched(scenario.parameters(), 1)).beside(problem.samples(RANDOM, 1))
    height = f"cost {peak.value:.6g}" if requirement is None else said(requirement, peak.value)
    horizon = objective.steps * objective.step
    origin = f"Worst sample found of: {scenario.description} ({height} over {horizon:g} s)"
    return Falsification(
        scenario=variation.sample(scenario.simulation.stream, numbers).with_overrides({"description": origin}),
        numbers=numbers,
        nominal={number.name: number.base for number in variation.numbers},
        cost=peak.value,
        nominal_cost=float(cost_of(problem, requirement).each(problem.space.start, nominal)[0]),
        trail=search.trail,
        rollouts=search.spent,
        steps=search.spent * objective.steps,
        requirement=requirement,
    )


def said(requirement: Requirement, shortfall: float) -> str:
    """Words on how far a rollout is from a requirement, from its shortfall in units of the scale [-]."""
    if shortfall >= FAILED:
        return f"{requirement.short} violated: the rollout fails"
    outcome = "violated" if shortfall > 0.0 else "kept"
    return f"{requirement.short} {outcome}, robustness {-shortfall * requirement.scale:.6g}"


def worst_samples(
    problem: Problem, vector: np.ndarray, count: int, rollouts: int = ROLLOUTS, starts: int = STARTS
) -> Samples:
    """Up to ``count`` worst samples found against the gains of ``vector`` (n,): different ones, the worst first.

    Most are ends of climbs, and the rest starts; there are fewer where climbs end at the same point. Under
    ``problem.aim``, as ``falsify``.

    Raises:
        UserError: the budget has no room for a climb.
    """
    peaks = climbed(problem, vector, rollouts, starts, problem.aim).peaks
    landscape = SampleCost(problem.aim, problem.variation, vector)
    return landscape.samples(np.stack([peak.point for peak in peaks[:count]]))


def random_costs(problem: Problem, count: int, requirement: Requirement | None = None) -> np.ndarray:
    """Costs (count,) of random samples under the scenario's gains, as a sweep would draw them.

    Args:
        problem: whose samples they are.
        count: of the samples.
        requirement: whose shortfall is wanted in place of the cost, in units of its scale.
    """
    return cost_of(problem, requirement).each(problem.space.start, problem.samples(RANDOM, count))


def table(found: Falsification, random: np.ndarray | None = None) -> str:
    """The found sample as lines of text; random: costs (N,) of random samples, to compare with."""
    width = max(map(len, found.numbers))
    lines = [f"{'number':{width}} {'scenario':>12} {'found':>12}"]
    lines += [
        f"{name:{width}} {found.nominal[name]:12.6g} {round(value, 12):12.6g}" for name, value in found.numbers.items()
    ]
    spent = f"{found.rollouts} rollouts, {found.steps} steps"
    heights = (found.cost, found.nominal_cost)
    if found.requirement is None:
        own, nominal = ("the rollout fails" if height >= FAILED else f"{height:.6g}" for height in heights)
        lines += ["", f"cost of the sample found: {own} ({spent}); of the scenario itself: {nominal}"]
    else:
        own, nominal = (said(found.requirement, height) for height in heights)
        lines += ["", f"sample found: {own} ({spent})", f"scenario itself: {nominal}"]
    if random is not None:
        lines.append(f"worst of {len(random)} random samples: {_worst(found, random)}")
    return "\n".join(lines) + "\n"


def _worst(found: Falsification, random: np.ndarray) -> str:
    failures, worst = int(np.sum(random >= FAILED)), float(np.max(random))
    if failures:
        return f"{failures} fail"
    if found.requirement is not None:
        return f"{said(found.requirement, worst)}; {int(np.sum(random > 0.0))} violate it"
    return f"{worst:.6g}; the found one costs {found.cost / worst:.4g} times as much"


def climbed(problem: Problem, vector: np.ndarray, rollouts: int, starts: int, cost: Cost) -> Ascent:
    """Climb a cost over a problem's samples, under the gains of a vector (n,).

    Raises:
        UserError: the budget has no room for a climb.
    """
    landscape = SampleCost(cost, problem.variation, vector)
    least = starts + landscape.slope_price + len(LADDER)
    if rollouts < least:
        raise UserError("rollouts", f"at least {least}, for {starts} starts and one step of a climb", rollouts)
    engine = qmc.Sobol(len(landscape.low), scramble=True, rng=problem.scenario.simulation.seed)
    points = engine.random_base2((starts - 1).bit_length())[:starts]
    inside = landscape.low + (landscape.high - landscape.low) * points
    return ascend(landscape, inside, rollouts, CLIMBERS, enough=FAILED)


def box(variation: Variation) -> tuple[np.ndarray, np.ndarray]:
    """Ends (D,) of the search: of the cube, but for draws behind a normal distribution."""
    endless = {number.draw for number in variation.numbers if number.distribution.distribution == "normal"}
    low = np.array([TAIL if draw in endless else LOWEST for draw in variation.draws])
    return low, np.where(low == TAIL, 1.0 - TAIL, HIGHEST)

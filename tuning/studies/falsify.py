"""The sample of a scenario's uncertainty that hurts most, found by climbing the cost through the simulator.

The search runs through the unit cube of the draws behind the uncertain numbers (``coopmm_jax/scenario/variation.py``):
all of it where distributions end, and the middle 99 % of those that do not. What is climbed is the cost of [tuning]
under the scenario's own gains, over the whole duration, as tuning reports it. A rollout that fails is worse than any
other and ends the search. Noise is not searched: every rollout has the scenario's own.
"""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.variation import HIGHEST, LOWEST, Variation, batched
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost import evaluate
from tuning.cost.evaluate import Samples
from tuning.cost.objective import FAILED
from tuning.cost.problem import Problem, build_problem, check_count
from tuning.cost.robust_cost import RobustCost
from tuning.search.ascent import LADDER, Ascent, Mark, ascend

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


class SampleCost:
    """Cost of one vector of gains as a function of the point of the unit cube that a sample lies at.

    A ``Landscape`` for ``search.ascent``; gradients come from one-sided differences, or by reverse mode where draws are
    many.
    """

    def __init__(self, cost: RobustCost, variation: Variation, vector: np.ndarray):
        self.cost, self.variation, self.vector = cost, variation, vector
        self.low, self.high = box(variation)
        self.reversed = len(variation.draws) > DIFFERENCES
        self.slope_price = REVERSE if self.reversed else len(variation.draws)

    def samples(self, points: np.ndarray) -> Samples:
        """The samples at ``points`` (N, D), with the scenario's own noise."""
        return Samples(self.variation.batch(points, [self.variation.scenario.simulation.stream] * len(points)))

    def values(self, points: np.ndarray) -> np.ndarray:
        """Costs (N,) at points (N, D)."""
        return costs(self.cost, self.vector, self.samples(points))

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
        cost = self.cost
        _, slopes = evaluate.sensitivities(cost.objective, self.vector[None], self.samples(points), cost.coefficients)

        def row(point: jax.Array) -> jax.Array:
            return jnp.stack([jnp.asarray(leaf, float) for leaf in jax.tree.leaves(self.variation.parameters(point))])

        with jax.enable_x64(True):
            _, pull_back = jax.vjp(jax.vmap(row), jnp.asarray(points))
            return np.asarray(pull_back(jnp.asarray(slopes[0]))[0])


def costs(cost: RobustCost, vector: np.ndarray, samples: Samples) -> np.ndarray:
    """Cost of the gains of ``vector`` (n,) on every sample (N,)."""
    return evaluate.evaluate(cost.objective, vector[None], samples).costs(cost.coefficients)[0]


@dataclass(frozen=True)
class Falsification:
    """The worst sample found and what it took."""

    scenario: Scenario  # of that sample alone, without uncertainty
    numbers: dict[str, float]  # its uncertain numbers by name, in the scenario's units
    nominal: dict[str, float]  # the scenario's own values of these
    cost: float  # at least ``FAILED`` if its rollout fails
    nominal_cost: float  # of the scenario without uncertainty
    trail: list[Mark]  # rollouts spent and highest cost, after the starts and after every round
    rollouts: int  # spent, gradients included
    steps: int  # simulated in them

    @property
    def failed(self) -> bool:
        """True if its rollout fails."""
        return self.cost >= FAILED


def falsify(
    scenario: Scenario | str | Path,
    rollouts: int = ROLLOUTS,
    starts: int = STARTS,
    problem: Problem | None = None,
    executor: Executor | None = None,
) -> Falsification:
    """Search a scenario's [uncertainty] for the sample of the highest cost.

    The result depends on the scenario, its seed and the arguments alone.

    Args:
        scenario: a scenario, or the name or path of one; needs [uncertainty].
        rollouts: budget, over the whole duration each; a gradient counts as the rollouts it costs.
        starts: number of scrambled Sobol points from which the climbs set out, the highest first.
        problem: of this scenario, if built already.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.

    Raises:
        UserError: the scenario has no uncertainty or cannot be tuned, or the budget has no room for a climb.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    check_count(starts, "starts")
    with carried_by(executor):
        return _falsified(scenario, rollouts, starts, build_problem(scenario) if problem is None else problem)


def _falsified(scenario: Scenario, rollouts: int, starts: int, problem: Problem) -> Falsification:
    cost, variation = problem.cost, problem.variation
    found = _climbed(problem, problem.space.start, rollouts, starts)
    worst = found.peaks[0]
    numbers = {name: float(value) for name, value in variation.values(worst.point).items()}
    nominal = Samples(batched(scenario.parameters(), 1))
    origin = f"Worst sample found of: {scenario.description} (cost {worst.value:.6g} over {_horizon(cost):g} s)"
    return Falsification(
        scenario=variation.sample(scenario.simulation.stream, numbers).with_overrides({"description": origin}),
        numbers=numbers,
        nominal={number.name: number.base for number in variation.numbers},
        cost=worst.value,
        nominal_cost=float(costs(cost, problem.space.start, nominal)[0]),
        trail=found.trail,
        rollouts=found.spent,
        steps=found.spent * cost.objective.steps,
    )


def worst_samples(
    problem: Problem, vector: np.ndarray, count: int, rollouts: int = ROLLOUTS, starts: int = STARTS
) -> Samples:
    """Up to ``count`` worst samples found against the gains of ``vector`` (n,): different ones, the worst first.

    Most are ends of climbs, and the rest starts; there are fewer where climbs end at the same point. Under
    ``problem.cost``, as ``falsify``.

    Raises:
        UserError: the budget has no room for a climb.
    """
    peaks = _climbed(problem, vector, rollouts, starts).peaks
    landscape = SampleCost(problem.cost, problem.variation, vector)
    return landscape.samples(np.stack([peak.point for peak in peaks[:count]]))


def random_costs(problem: Problem, count: int) -> np.ndarray:
    """Costs (count,) of random samples under the scenario's gains, as a sweep would draw them."""
    return costs(problem.cost, problem.space.start, problem.samples(RANDOM, count))


def table(found: Falsification, random: np.ndarray | None = None) -> str:
    """The found sample as lines of text; random: costs (N,) of random samples, to compare with."""
    width = max(map(len, found.numbers))
    lines = [f"{'number':{width}} {'scenario':>12} {'found':>12}"]
    lines += [
        f"{name:{width}} {found.nominal[name]:12.6g} {round(value, 12):12.6g}" for name, value in found.numbers.items()
    ]
    outcome = "the rollout fails" if found.failed else f"{found.cost:.6g}"
    spent = f"{found.rollouts} rollouts, {found.steps} steps"
    lines += ["", f"cost of the sample found: {outcome} ({spent}); of the scenario itself: {found.nominal_cost:.6g}"]
    if random is not None:
        failures, worst = int(np.sum(random >= FAILED)), float(np.max(random))
        said = (
            f"{failures} fail"
            if failures
            else f"{worst:.6g}; the found one costs {found.cost / worst:.4g} times as much"
        )
        lines.append(f"worst of {len(random)} random samples: {said}")
    return "\n".join(lines) + "\n"


def _horizon(cost: RobustCost) -> float:
    return cost.objective.steps * cost.objective.step


def _climbed(problem: Problem, vector: np.ndarray, rollouts: int, starts: int) -> Ascent:
    landscape = SampleCost(problem.cost, problem.variation, vector)
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

"""Tuners that are compared: every one is given a meter, the training robots and a seed, and notes its best gains.

All search the same unconstrained numbers (see ``tuning.cost.gain_space``), from the same Sobol points between the same
bounds; those that end before the budget does begin again from the next point. Our own draws robots as ``coopmm tune``
does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import optimize

from experiments.benchmarks.tuner_problem import OWN, Meter, samples
from tuning.cost.evaluate import Samples
from tuning.search import method
from tuning.search.method import Candidate

Tuner = Callable[[Meter, Samples, int], None]
# STARTS serves the local methods too. The rest is ours, for a budget smaller than what the defaults of [tuning] are
# meant for: half the batch elements, half the steps.
STARTS, RACE, SURVIVORS, LANES, STEPS, VALIDATION = 64, 4, 4, 32, 2, 16
_DIFFERENCE = 1e-4  # step of finite differences, a factor on a gain
_SPREAD = 1.5  # first standard deviation of CMA-ES: a factor of 4.5 on a gain


class _Spent(Exception):
    """Raised when the budget is used up, to leave a library's optimiser."""


def _costs(meter: Meter, robots: Samples) -> Callable[[np.ndarray], np.ndarray]:
    """Function that gives the costs of candidates (C, n) on all training robots and notes the best so far."""
    best = [np.inf]

    def costs(vectors: np.ndarray) -> np.ndarray:
        if meter.spent:
            raise _Spent
        found = meter.values(vectors, robots)
        if found.min() < best[0]:
            best[0] = float(found.min())
            meter.note(vectors[int(found.argmin())])
        return found

    return costs


def _local(minimise: Callable[[Callable, np.ndarray], object]) -> Tuner:
    """Tuner from a local method, begun again and again: from the starting gains with seed 0, else from Sobol points."""

    def tuner(meter: Meter, robots: Samples, seed: int) -> None:
        costs = _costs(meter, robots)
        for start in meter.search.objective.space.starts(STARTS, seed)[min(seed, 1) :]:
            try:
                minimise(costs, start)
            except _Spent:
                return

    return tuner


def _nelder_mead(costs: Callable, start: np.ndarray) -> None:
    simplex = np.concatenate([start[None], start + np.eye(start.size)])
    options = {"initial_simplex": simplex, "adaptive": True, "maxfev": 100_000, "maxiter": 100_000}
    optimize.minimize(lambda x: costs(x[None])[0], start, method="Nelder-Mead", options=options)


def _powell(costs: Callable, start: np.ndarray) -> None:
    optimize.minimize(lambda x: costs(x[None])[0], start, method="Powell")


def _lbfgs(costs: Callable, start: np.ndarray) -> None:
    def cost_and_slope(x: np.ndarray) -> tuple[float, np.ndarray]:
        middle, *ahead = costs(np.concatenate([x[None], x + _DIFFERENCE * np.eye(x.size)]))
        return middle, (np.array(ahead) - middle) / _DIFFERENCE

    optimize.minimize(cost_and_slope, start, method="L-BFGS-B", jac=True)


def cma_es(meter: Meter, robots: Samples, seed: int) -> None:
    """CMA-ES from the starting gains, again with twice the population where it stops early."""
    import cma

    costs, size = _costs(meter, robots), None
    while not meter.spent:
        options = {"seed": seed + 1, "verbose": -9} | ({} if size is None else {"popsize": size})
        strategy = cma.CMAEvolutionStrategy(meter.search.objective.space.start, _SPREAD, options)
        size = 2 * strategy.popsize
        while not (strategy.stop() or meter.spent):
            population = strategy.ask()
            strategy.tell(population, list(costs(np.array(population))))


def optuna_tpe(meter: Meter, robots: Samples, seed: int) -> None:
    """Optuna's tree-structured Parzen estimator, the starting gains first."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    space, costs = meter.search.objective.space, _costs(meter, robots)
    reach = np.array(space.high) - np.array(space.low)  # two per cent short of the bounds, as the Sobol points
    names = space.labels()
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    study.enqueue_trial(dict(zip(names, space.start.tolist(), strict=True)))
    while not meter.spent:
        trial = study.ask()
        x = np.array([trial.suggest_float(name, -r, r) for name, r in zip(names, reach, strict=True)])
        study.tell(trial, float(costs(x[None])[0]))


def coopmm(meter: Meter, robots: Samples, seed: int) -> None:
    """``coopmm tune``'s race and descent, on robots of its own instead of the training set."""
    lbfgs, fixed = method.LBFGS(), samples(OWN + RACE, VALIDATION, seed + 1)
    starts = meter.search.objective.space.starts(STARTS, seed)
    survivors = method.race(meter, starts, samples(OWN, RACE, seed + 1), SURVIVORS)
    meter.note(survivors[0])
    candidates = [Candidate(vector, lbfgs.start(vector)) for vector in survivors]
    best, first = np.inf, OWN + RACE + VALIDATION
    while not meter.spent:
        drawn = samples(first, LANES // len(candidates), seed + 1)
        first += LANES
        candidates, _, _ = method.descend(meter, lbfgs, candidates, drawn, STEPS)
        found = meter.values(np.stack([c.vector for c in candidates]), fixed)
        candidates = method.better_half(candidates, found)
        if found.min() < best:
            best = float(found.min())
            meter.note(candidates[0].vector)


TUNERS: dict[str, Tuner] = {
    "coopmm": coopmm,
    "cma_es": cma_es,
    "nelder_mead": _local(_nelder_mead),
    "powell": _local(_powell),
    "lbfgs_differences": _local(_lbfgs),
    "optuna_tpe": optuna_tpe,
}

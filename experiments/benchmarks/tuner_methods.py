"""The tuners that are compared: each is given a meter and a seed, and notes its best gains until time is up.

All begin at the best of the same 256 Sobol points, on the same batches; those that end before their time begin again at
the next best. Ours draws robots anew for every generation; the others minimise over one fixed Sobol set of 16, which is
what a library's function wants.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import optimize

from tuning.cost.problem import SCREENING, Problem
from tuning.search.stages import plan
from tuning.studies.result import Row
from tuning.studies.tune import Driver

ROBOTS = 16  # of the fixed set
FIXED = 1_000_000  # number of the first seed's fixed set, which no search draws
BATCH = 8  # trials of Optuna at a time
SPREAD = 0.5  # first standard deviation of CMA-ES: a factor of 1.6 on a gain
# Our search counts steps, so it has to know how far it will come: a step of the second half takes twice as long as one
# of screening, which is in float32 too.
HALVES = 1.5


class Spent(Exception):
    """Time is up: how to leave a library's optimiser."""


class Improvement(NamedTuple):
    """The best gains of a run so far, and when they were known."""

    seconds: float
    vector: np.ndarray  # (n,)


@dataclass
class Meter:
    """The problem, and a clock."""

    problem: Problem
    seconds: float  # that a tuner has
    seed: int
    began: float = field(default_factory=time.monotonic)
    trail: list[Improvement] = field(default_factory=list)
    best: float = np.inf

    @property
    def taken(self) -> float:
        """Time since the beginning [s]."""
        return time.monotonic() - self.began

    @property
    def robots(self) -> object:
        """The fixed set of this seed."""
        return self.problem.drawn(ROBOTS, FIXED + self.seed)

    def costs(self, vectors: np.ndarray) -> np.ndarray:
        """Costs (C,) of vectors (C, n) on the fixed set."""
        found = self.problem.costs(vectors, self.robots)
        self._note(vectors, found)
        return found

    def slope(self, vector: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost of a vector (n,) on the fixed set, and its exact gradient (n,)."""
        (value,), (slope,) = self.problem.slopes(vector[None], self.robots)
        self._note(vector[None], np.array([value]))
        return float(value), slope

    def note(self, vector: np.ndarray) -> None:
        """Take a vector (n,) for the best from here on, unless time is up and there is one already."""
        if self.trail and self.taken > self.seconds:
            raise Spent
        self.trail.append(Improvement(self.taken, np.array(vector)))

    def starts(self) -> Iterable[np.ndarray]:
        """The Sobol points, the best first, each (n,)."""
        settings = self.problem.scenario.tuning
        points = self.problem.space.starts(settings.starts, self.seed)
        robots = self.problem.drawn(settings.screening_samples, SCREENING)
        costs = self.problem.costs(points, robots, settings.coarse)
        self.note(points[np.argmin(costs)])
        return points[np.argsort(costs, kind="stable")]

    def _note(self, vectors: np.ndarray, costs: np.ndarray) -> None:
        if self.trail and self.taken > self.seconds:
            raise Spent
        if costs.min() < self.best:
            self.best = float(costs.min())
            self.note(vectors[int(costs.argmin())])


Tuner = Callable[[Meter], None]


def coopmm(meter: Meter, optimiser: str = "auto") -> None:
    """``coopmm tune`` with its defaults, or another optimiser."""
    settings = {"simulation.seed": meter.seed, "tuning.optimiser": optimiser}
    problem = replace(meter.problem, scenario=meter.problem.scenario.with_overrides(settings))
    run = Driver(None, problem, None, lambda name: None).begin()
    meter.note(run.vectors[0])
    budget = run.trials.spent / meter.taken * meter.seconds / HALVES
    problem = replace(problem, scenario=problem.scenario.with_overrides({"tuning.budget": budget / 1e6}))
    run.trials.problem = problem

    def told(row: Row) -> None:
        if not np.array_equal(run.vectors[0], meter.trail[-1].vector):
            meter.note(run.vectors[0])

    chosen = plan(problem)
    Driver(None, problem, told, lambda name: None).search(run, chosen, meter.seconds - meter.taken)


def cma_es(meter: Meter) -> None:
    """CMA-ES of the package ``cma``."""
    import cma

    low, high = meter.problem.low, meter.problem.high
    for start in meter.starts():
        options = {"seed": meter.seed + 1, "verbose": -9, "bounds": [low, high], "popsize": 16}
        strategy = cma.CMAEvolutionStrategy(np.clip(start, low + 1e-9, high - 1e-9), SPREAD, options)
        while not strategy.stop():
            population = np.array(strategy.ask())
            strategy.tell(population, list(meter.costs(population)))


def optuna_tpe(meter: Meter) -> None:
    """Optuna's tree-structured Parzen estimator, eight trials at a time."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    problem = meter.problem
    bounds = list(zip(problem.names, problem.low, problem.high, strict=True))
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=meter.seed, constant_liar=True))
    for start in list(meter.starts())[:BATCH]:
        study.enqueue_trial(dict(zip(problem.names, start.tolist(), strict=True)))
    while True:
        trials = [study.ask() for _ in range(BATCH)]
        vectors = [[trial.suggest_float(*bound) for bound in bounds] for trial in trials]
        for trial, cost in zip(trials, meter.costs(np.array(vectors)), strict=True):
            study.tell(trial, float(cost))


def _local(minimise: Callable[[Meter, np.ndarray], object]) -> Tuner:
    """A local method, begun again and again."""

    def tuner(meter: Meter) -> None:
        for start in meter.starts():
            minimise(meter, start)

    return tuner


def _nelder_mead(meter: Meter, start: np.ndarray) -> None:
    simplex = np.concatenate([start[None], start + 0.5 * np.eye(start.size)])
    options = {"initial_simplex": simplex, "adaptive": True, "maxfev": 100_000, "maxiter": 100_000}
    optimize.minimize(lambda x: meter.costs(x[None])[0], start, method="Nelder-Mead", options=options)


def _powell(meter: Meter, start: np.ndarray) -> None:
    bounds = list(zip(meter.problem.low, meter.problem.high, strict=True))
    optimize.minimize(lambda x: meter.costs(x[None])[0], start, method="Powell", bounds=bounds)


def _lbfgs(meter: Meter, start: np.ndarray) -> None:
    bounds = list(zip(meter.problem.low, meter.problem.high, strict=True))
    optimize.minimize(meter.slope, start, method="L-BFGS-B", jac=True, bounds=bounds)


TUNERS: dict[str, Tuner] = {
    "coopmm": coopmm,
    "coopmm_cma": partial(coopmm, optimiser="cma"),
    "coopmm_lbfgs": partial(coopmm, optimiser="lbfgs"),
    "cma_es": cma_es,
    "nelder_mead": _local(_nelder_mead),
    "powell": _local(_powell),
    "optuna_tpe": optuna_tpe,
    "lbfgs_exact": _local(_lbfgs),
}

"""Several controllers tuned with equal effort, then compared on the same untouched samples: ``tune --controllers``.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> try:
...     under(load_scenario("sensed"), ["robust_adaptive", "robust_adaptive"])
... except UserError as error:
...     print(error)
--controllers: must be different names, was robust_adaptive, robust_adaptive
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import controller
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost import problem
from tuning.studies import state
from tuning.studies.compare import ComparedGains, compare_scenarios
from tuning.studies.result import TuningResult
from tuning.studies.tune import Progress, tune

OPTION = "--controllers"


class TunedControllers(NamedTuple):
    """Outcome of tuning several controllers."""

    results: dict[str, TuningResult]  # by name of the controller
    compared: ComparedGains  # their tuned gains, in the same order


def tune_controllers(
    scenario: Scenario,
    names: Sequence[str],
    out: Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    stage: Callable[[str], None] | None = None,
    time_budget: float = np.inf,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> TunedControllers:
    """Tune each controller for the same cost, on the same samples, with the same budget; then compare all.

    Args:
        scenario: whose own gains scale the cost, and start the controller that they belong to; others start at their
            defaults.
        names: of controllers; at least two.
        out: folder in which each gets one of its own name, as ``tune`` fills it.
        resume: go on with what is found there.
        progress: called with each row of each history.
        stage: called with the name of what begins.
        time_budget: of each [s].
        overwrite: begin anew where there are runs.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.

    Raises:
        UserError: an unknown controller, one given twice, fewer than two, or as ``tune``.
    """
    under(scenario, names)  # what is wrong with names and folders is told before anything runs
    begun = [name for name in names if out is not None and (out / name / state.NAME).exists()]
    if begun and not (resume or overwrite):
        raise UserError("--out", "a folder without a tuning run, or --resume or --overwrite given", out)
    if resume and not begun:
        raise UserError("--resume", f"used with a folder that has a run of {', '.join(names)}", out)
    with jax.enable_x64(True), carried_by(executor):
        unscaled = problem.unscaled(scenario)
        scales = problem.scales(unscaled, unscaled.start)
    results, scaled = {}, scenario.with_overrides({"tuning.scales": scales})
    for name, one in zip(names, under(scaled, names), strict=True):
        if stage is not None:
            stage(name)
        folder = None if out is None else out / name
        results[name] = tune(one, folder, resume and name in begun, progress, stage, time_budget, overwrite, executor)
    with carried_by(executor):
        return TunedControllers(results, compare_scenarios(scaled, [r.scenario for r in results.values()], names))


def under(scenario: Scenario, names: Sequence[str]) -> list[Scenario]:
    """The scenario under each controller.

    Raises:
        UserError: an unknown controller, one given twice, or fewer than two.
    """
    if len(names) < 2:
        raise UserError(OPTION, "at least two names, separated by commas", ", ".join(names) or "none")
    if len(set(names)) < len(names):
        raise UserError(OPTION, "different names", ", ".join(names))
    return [scenario.with_overrides({"law.controller": controller(name, OPTION).name}) for name in names]

"""Results of requirements in the tuner that only real rollouts can show, for test_required.py."""

import contextlib
import io
import json

import jax
import numpy as np

import coopmm_jax as cm
from coopmm_jax import cli
from tests import falsify_results
from tuning.cost import required
from tuning.cost.problem import unscaled
from tuning.cost.required import Required
from tuning.cost.shortfall import Shortfall
from tuning.studies.falsify import RANDOM, falsify
from tuning.studies.modes import modes

OWN = """
from typing import NamedTuple
import coopmm_jax as cm

@cm.register("signal", "spread")
class Spread(NamedTuple):
    unit, meaning = "rad/s", "yaw rate of robot I less that of robot II"

    def value(self, sample):
        one, two = sample.signals.velocity
        return one[0] - two[0]

@cm.register("metric", "spread_worst")
class SpreadWorst(NamedTuple):
    unit, meaning, reduction = "rad/s", "largest square of the spread", "max"

    def quantity(self, sample):
        one, two = sample.signals.velocity
        return (one[0] - two[0]) ** 2

@cm.register("cost_term", "spread")
class SpreadTerm(NamedTuple):
    unit, floor, weight = "(rad/s)^2", 1e-6, 1.0

    def value(self, sample):
        one, two = sample.signals.velocity
        return (one[0] - two[0]) ** 2
"""
PRESSES = "always[0.02, inf] contact_force >= 13.5"
REQUIREMENTS = {
    "presses": {"require": PRESSES, "scale": 2.0},
    "spread_small": "always spread <= 0.5",
    "spread_worst": "<= 0.25",
    "torque_rms": "<= 50",
}
STEP = 1e-5  # of central differences


def scenario():
    """The scenario of falsify's tests, with requirements of a metric, of sentences and of a plugin's own."""
    return cm.load_scenario("paper", **falsify_results.SCENARIO, requirements=REQUIREMENTS)


def results(folder):
    """Robustness along a run, gradients, a search, different failures, and a folder that is checked."""
    (folder / "own.py").write_text(OWN, encoding="utf-8")
    cm.load_plugin(folder / "own.py")
    one = scenario()
    problem = unscaled(one)
    found = falsify(one, 80, 16, problem, requirement="presses")
    several = modes(one, 2, "presses", 80, 16)
    for i, each in enumerate((found, *several.found)):
        (folder / f"found_{i}.toml").write_text(each.scenario.to_toml(), encoding="utf-8")
    shortfall = Shortfall.of(problem, found.requirement)
    random = shortfall.each(problem.start, problem.samples(RANDOM, 200))
    return gradients(problem) | {
        "found": found,
        "modes": several,
        "random": random,
        "run": cm.simulate(found.scenario),
        "checked": [
            check(folder, *more) for more in ([], ["--requirements.presses", "always[0.02, inf] contact_force >= 0"])
        ],
        "folder": folder,
    }


def check(folder, *more):
    """Exit code, lines and table of ``coopmm check``."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        out = folder / "checked.json"
        arguments = ["check", str(folder), "--out", str(out), "--overwrite", *more]
        code = cli.main(arguments)
    return code, printed.getvalue(), json.loads(out.read_text())


def gradients(problem):
    """Slopes by reverse mode and by differences: of a metric and a sentence by draws, of all by numbers of samples."""
    stated = problem.scenario.requirements.parsed()
    shortfall, of_metric = (Shortfall.of(problem, each) for each in (stated[0], stated[-1]))
    mine = Required.of(problem.cost.objective, problem.scenario)
    weights = np.array([1.0, 0.5, 0.25, 2.0])
    samples = problem.samples(0, 2)
    numbers = np.broadcast_to(mine.numbers(stated, weights), (1, 2, len(mine.numbers(stated))))
    slopes = required.sensitivities(mine, problem.start[None], samples, numbers)[0]
    places = jax.tree.unflatten(samples.structure, range(samples.rows.shape[1]))
    columns = [*(inertia.m_p for inertia in places.plant.inertia), *(start.th for start in places.start)]
    steps = STEP * np.array([1.0, -1.0])[:, None, None, None] * np.eye(samples.rows.shape[1])[columns][:, None]
    moved = samples.extended((samples.rows + steps).reshape(-1, samples.rows.shape[1]))
    values = required.evaluate(mine, problem.start[None], moved, numbers[0, 0]).values[0, 2:] @ weights
    ahead, behind = values.reshape(2, len(columns), 2)
    return {
        "of_metric": falsify_results.slopes(of_metric, problem),
        "of_sentence": [falsify_results.slopes(shortfall, problem)[kind] for kind in ("reverse", "central")],
        "of_all": [slopes[:, columns], (ahead - behind).T / (2.0 * STEP)],
    }

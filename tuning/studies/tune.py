"""Tune a scenario's gains: screen, search, choose, and measure on samples that nothing was chosen by.

What is minimised is what is reported: the risk over the whole duration, in the units of the report.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

import jax
import numpy as np

from coopmm_jax.files import write_text
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.sweeps.batch import elsewhere
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost import evaluate, required
from tuning.cost.problem import SCREENING, Problem, build_problem, unscaled
from tuning.cost.trials import DrawnTrials, Kept, steps_of
from tuning.search.stages import Descents, Place, Plan, plan
from tuning.studies import comparison, state
from tuning.studies.conflict import conflict_of
from tuning.studies.falsify import ROLLOUTS, worst_samples
from tuning.studies.margins import sturdiest
from tuning.studies.result import Row, TuningResult, gains_file, report

FINALISTS = 4  # best vectors checked so far
_IDLE = 2  # stages in a row that improve nothing, after which the search ends

Progress = Callable[[Row], None]


@dataclass
class Run:
    """A search under way."""

    trials: DrawnTrials
    place: Place
    vectors: np.ndarray  # the best that were checked, the best first (F, n)
    values: np.ndarray  # their risks on the fixed samples (F,)
    stale: int = 0  # checks since the best one
    idle: int = 0  # stages in a row that have improved nothing; -1 while one has
    history: list[Row] = field(default_factory=list)

    @classmethod
    def at(cls, vector: np.ndarray, trials: DrawnTrials) -> Run:
        """A search that begins at a vector (n,)."""
        return cls(trials, Place(vector, -1, 0, 0, ()), np.empty((0, vector.size)), np.empty(0))

    def check(self, vectors: np.ndarray) -> None:
        """Offer vectors (K, n) to the finalists."""
        space = self.trials.problem.space
        vectors = space.inside(vectors)
        found = np.concatenate([self.values, self.trials.check(vectors)])
        order = np.argsort(found, kind="stable")[:FINALISTS]
        improved = len(self.values) == 0 or order[0] >= len(self.values)
        self.vectors, self.values = np.concatenate([self.vectors, vectors])[order], found[order]
        self.stale, self.idle = (0, -1) if improved else (self.stale + 1, self.idle)


def tune(
    scenario: Scenario | str | Path,
    out: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
    stage: Callable[[str], None] | None = None,
    time_budget: float = np.inf,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> TuningResult:
    """Tune the gains that the scenario's [tuning] names.

    The course of the run depends on the scenario and its seed alone; killed and resumed it ends with the same bits.

    Args:
        scenario: a scenario, or the name or path of one; needs [uncertainty].
        out: folder for scenario.toml, the scenario as it was given, history.csv, the state after every iteration, and
            gains.toml.
        resume: go on with the state found there.
        progress: called with each row of the history.
        stage: called with the name of what begins: compiling, screening, scanning, searching, choosing, measuring.
        time_budget: after which no iteration begins [s]; the search can be resumed.
        overwrite: begin anew where there is a run.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.

    Raises:
        UserError: settings that cannot be met, a folder that already has a run, or a resume with other settings.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    say = stage or (lambda name: None)
    with jax.enable_x64(True), carried_by(executor), state.run_folder(out, resume, overwrite) as folder:
        before = unscaled(scenario)
        chosen = plan(before)
        found = state.read(folder, scenario.to_toml()) if resume and folder else None
        say("compiling")
        if not elsewhere.get():  # workers compile what they meet
            jax.local_devices()  # where there are none, that is raised here, not in a thread of its own
            threading.Thread(target=compile_ahead, args=(before, chosen), name="compile ahead").start()
        problem = build_problem(scenario)
        if folder is not None and not resume:
            state.clear(folder)
        driver = Driver(folder, problem, progress, say)
        run = driver.begin() if found is None else _unpacked(problem, chosen, found)
        if folder is not None:
            write_text(folder / state.SETTINGS, scenario.to_toml())
            state.write_history(folder, run.history)  # one that was killed may lack its last line
        stopped, early = driver.search(run, chosen, time_budget)
        say("choosing")
        vector = sturdiest(problem, run.vectors, run.values)
        say("measuring")
        result = report(problem, vector, run.history, stopped, early, conflict_of(problem, vector, run.trials.kept))
        if folder is not None:
            write_text(folder / state.GAINS, gains_file(result))
        return result


def compile_ahead(problem: Problem, chosen: Plan) -> None:
    """Compile everything but the costs in float64, which begin a run, in the order in which a run needs it.

    LLVM keeps one core busy, mostly with one function: meanwhile another compiles the rest and runs what the search
    begins with. What goes wrong here shows when it is needed.

    Args:
        problem: need not be scaled.
        chosen: the stages.
    """
    objective, samples, coarse = problem.cost.objective, problem.samples(0, 1), problem.scenario.tuning.coarse
    descends, goals = isinstance(chosen.wide, Descents), problem.goals
    if goals is None:
        evaluate.compile_costs(objective, samples, coarse)
        if descends:
            evaluate.compile_gradients(objective, samples)
    else:
        for precision in dict.fromkeys((coarse, "float64")):  # the scales of the cost need another program
            required.compile_values(goals.required, samples, goals.numbers, precision)
        if descends:
            required.compile_gradients(goals.required, samples, goals.numbers)
    comparison.compile_ahead(problem)


@dataclass
class Driver:
    """A search's driver: whatever it does is on disk before it is told."""

    folder: Path | None
    problem: Problem
    progress: Progress | None
    say: Callable[[str], None]

    def begin(self) -> Run:
        """Screen the scenario's gains and Sobol points."""
        self.say("screening")
        began, s = time.monotonic(), self.problem.scenario.tuning
        trials = DrawnTrials(self.problem)
        starts = self.problem.space.starts(s.starts, self.problem.scenario.simulation.seed)
        risks = trials.values(starts, s.screening_samples, SCREENING, s.coarse)
        run = Run.at(starts[int(np.argmin(risks))], trials)
        run.check(np.stack([self.problem.start, run.place.vector]))
        self.note(run, "screening", float(risks.min()), 0, time.monotonic() - began)
        return run

    def search(self, run: Run, chosen: Plan, time_budget: float) -> tuple[str, bool]:
        """Search until the budget or convergence ends it, or time.

        Args:
            run: goes on from where it is.
            chosen: the stages.
            time_budget: [s]

        Returns:
            Why it ended, and whether that was early.
        """
        settings, began = self.problem.scenario.tuning, time.monotonic()
        before, told = run.history[-1].seconds, ""
        while run.trials.spent < 1e6 * settings.budget:
            if run.idle >= _IDLE:
                return f"{_IDLE} stages in a row improved nothing", False
            if time.monotonic() - began >= time_budget:
                return f"the time budget of {time_budget:g} s is used up", True
            if run.place.stage < 0:
                run.place = _next(run, chosen)
            stage = chosen.stage(run.place.stage)
            if stage.name != told:
                self.say(stage.name)
                told = stage.name
            value, rejected = self._advance(run, chosen)
            self.note(run, stage.name, value, rejected, before + time.monotonic() - began)
        return f"the budget of {settings.budget:g} million simulated steps is used up", False

    def _advance(self, run: Run, chosen: Plan) -> tuple[float, int]:
        """One step of the stage, and the next stage where it ends."""
        settings, stage = self.problem.scenario.tuning, chosen.stage(run.place.stage)
        outcome = stage.advance(run.place, run.trials)
        run.place = outcome.place
        spent = run.trials.spent >= 1e6 * settings.budget * stage.until
        if spent or stage.due(run.place) or stage.ended(run.place, run.stale):
            run.check(stage.offer(run.place))
            if settings.adversaries:
                _add_worst(run, settings.adversaries)
        if spent or stage.ended(run.place, run.stale):
            run.place = _next(run, chosen)
        return outcome.value, outcome.rejected

    def note(self, run: Run, stage: str, value: float, rejected: int, seconds: float) -> None:
        """Write the state and a line of history, then tell; the search has taken so many seconds [s]."""
        row = Row(len(run.history), stage, value, float(run.values[0]), rejected, run.trials.spent, round(seconds, 3))
        run.history.append(row)
        if self.folder is not None:
            space = self.problem.space  # for whoever watches
            told = {"labels": np.array(space.labels()), "gains": np.asarray(space.values(run.vectors[0]))}
            state.write(self.folder, _packed(run) | told, self.problem.scenario.to_toml())
            state.append_history(self.folder, row)
        if self.progress is not None:
            self.progress(row)


def _next(run: Run, chosen: Plan) -> Place:
    """The begin of the next stage, at the best vector so far."""
    run.stale, run.idle = 0, run.idle + 1
    number = run.place.stage + 1
    return Place(run.vectors[0], number, 0, run.place.draw + 1, chosen.stage(number).begin(run.vectors[0]))


def _add_worst(run: Run, count: int) -> None:
    """Train on the worst samples against the best gains too, and on those found at the last check."""
    found = worst_samples(run.trials.problem, run.vectors[0], count)
    older = found.rows[:0] if run.trials.worst is None else run.trials.worst[-count:]
    run.trials.worst = np.concatenate([older, found.rows])
    run.trials.spent += ROLLOUTS * steps_of(run.trials.problem)


def _packed(run: Run) -> dict[str, np.ndarray]:
    arrays = {"vectors": run.vectors, "values": run.values, "counts": np.array([run.stale, run.idle])}
    arrays |= {f"place_{i}": np.asarray(leaf) for i, leaf in enumerate(jax.tree.leaves(run.place))}
    arrays |= {name: np.array([getattr(row, name) for row in run.history]) for name in Row._fields}
    arrays["spent"] = np.array(run.trials.spent)
    if run.trials.worst is not None:
        arrays["worst"] = run.trials.worst
    if run.trials.problem.goals is not None:
        arrays |= {f"kept_{name}": np.array(sorted(sets)) for name, sets in run.trials.kept._asdict().items()}
    return arrays


def _unpacked(problem: Problem, chosen: Plan, arrays: dict[str, np.ndarray]) -> Run:
    start, number = problem.start, int(arrays["place_1"])
    template = Place(start, number, 0, 0, chosen.stage(number).begin(start) if number >= 0 else ())
    leaves, structure = jax.tree.flatten(template)
    found = [arrays[f"place_{i}"] for i in range(len(leaves))]
    restored = [x if isinstance(leaf, np.ndarray) else type(leaf)(x) for leaf, x in zip(leaves, found, strict=True)]
    place = jax.tree.unflatten(structure, restored)
    rows = zip(*(arrays[name].tolist() for name in Row._fields), strict=True)
    sets = (arrays.get(f"kept_{name}", np.empty((0, 0))) for name in Kept._fields)
    kept = Kept(*(set(map(tuple, each.tolist())) for each in sets))
    trials = DrawnTrials(problem, int(arrays["spent"]), arrays.get("worst"), kept)
    stale, idle = (int(x) for x in arrays["counts"])
    return Run(trials, place, arrays["vectors"], arrays["values"], stale, idle, [Row(*row) for row in rows])

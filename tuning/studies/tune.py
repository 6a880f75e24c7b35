"""Tune a scenario's gains: race, descend, validate, and measure on samples that nothing was chosen by."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.files import locked_folder, resolve_path, write_csv, write_text
from coopmm_jax.scenario.gains_file import gains_text
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.sections.controller import gain_tables
from tuning.cost.problem import RACE, TEST, TRAINING, VALIDATION, Problem, build_problem
from tuning.search import method
from tuning.search.method import Candidate
from tuning.studies import state
from tuning.studies.comparison import Comparison, compare
from tuning.studies.falsify import worst_samples

Progress = Callable[["Row"], None]


class Row(NamedTuple):
    """One line of the history."""

    iteration: int  # 0: the starting gains
    training: float  # lowest risk on this iteration's samples
    validation: float  # lowest risk on the validation samples, over the whole duration
    best: float  # lowest validation risk so far
    rejected: int  # steps that were rejected or shortened
    seconds: float  # of wall time since the start, without what came before a resume


@dataclass
class Progressing:
    """What changes from iteration to iteration."""

    candidates: list[Candidate]
    best: np.ndarray  # vector of the lowest validation risk (n,)
    worst: np.ndarray  # rows of the samples found against earlier gains (W, leaves), see ``tiles.Samples``
    history: list[Row] = field(default_factory=list)

    @property
    def stale(self) -> int:
        """Iterations since the best one."""
        return len(self.history) - 1 - int(np.argmin([row.validation for row in self.history]))


@dataclass(frozen=True)
class TuningResult:
    """The tuned gains, how they were found, and what they are worth."""

    scenario: Scenario  # with the tuned gains
    labels: list[str]  # of the tuned numbers
    before: np.ndarray  # their values under the starting gains
    after: np.ndarray
    history: list[Row]
    comparison: Comparison  # on the untouched test samples

    @property
    def gains(self) -> Any:
        """The tuned gains, ``coopmm_jax.parameters.Gains``."""
        return self.scenario.parameters().gains

    def _repr_html_(self) -> str:
        from tuning.reports.html import page  # what it needs is slow to import, and only a notebook asks

        return page(self)


def tune(
    scenario: Scenario | str | Path,
    out: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> TuningResult:
    """Tune the gains that the scenario's [tuning] names.

    The course of the run depends on the scenario and its seed alone; killed and resumed it ends with the same bits.

    Args:
        scenario: a scenario, or the name or path of one; needs [uncertainty]. out: folder for gains.toml, history.csv
            and the state after every iteration. resume: go on with the state found there. progress: called with each
            row of the history.

    Raises:
        UserError: settings that cannot be met, a folder that already has a run, or a resume with other settings.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    with jax.enable_x64(True), _folder(out, resume) as folder:
        chosen = _method(scenario)
        found = state.read(folder, scenario.to_toml()) if resume else None
        problem = build_problem(scenario, descends=True)
        run = _start(problem, chosen) if found is None else _unpacked(problem, chosen, found)
        _iterate(problem, chosen, run, folder, progress)
        result = _result(problem, run)
        if folder is not None:
            write_text(folder / "gains.toml", gains_file(result))
            write_csv(folder / "history.csv", Row._fields, run.history)
    return result


def gains_file(result: TuningResult) -> str:
    """The text of gains.toml: every gain, tuned or not."""
    return gains_text(result.gains)


def _method(scenario: Scenario) -> method.LBFGS | method.Optax:
    s = scenario.tuning
    return method.method(s.optimiser, s.learning_rate, s.schedule, s.clip, s.iterations * s.steps)


def _start(problem: Problem, chosen: method.LBFGS | method.Optax) -> Progressing:
    """Race the scenario's gains against scrambled Sobol points."""
    s, space = problem.scenario.tuning, problem.space
    survivors = method.race(problem.training, problem.starts(), problem.samples(RACE, s.race_samples), s.survivors)
    fixed = problem.samples(VALIDATION, s.validation_samples)
    value = float(problem.validation.values(space.start[None], fixed)[0])
    training = float(problem.training.values(space.start[None], fixed)[0])
    candidates = [Candidate(vector, chosen.start(vector)) for vector in survivors]
    return Progressing(candidates, space.start, fixed.rows[:0], [Row(0, training, value, value, 0, 0.0)])


def _iterate(
    problem: Problem,
    chosen: method.LBFGS | method.Optax,
    run: Progressing,
    folder: Path | None,
    progress: Progress | None,
) -> None:
    """Iterate until a plateau or a budget ends it; the state on disk is never older than one iteration."""
    s, began = problem.scenario.tuning, time.monotonic()
    fixed = problem.samples(VALIDATION, s.validation_samples)
    while len(run.history) <= s.iterations and run.stale < s.patience and time.monotonic() - began < s.time_budget:
        number, lanes = len(run.history), s.survivors * s.samples
        samples = problem.samples(TRAINING + (number - 1) * lanes, lanes // len(run.candidates)).extended(run.worst)
        candidates, training, rejected = method.descend(problem.training, chosen, run.candidates, samples, s.steps)
        validation = problem.validation.values(np.stack([c.vector for c in candidates]), fixed)
        best = run.history[-1].best
        if validation.min() < best:
            best, run.best = float(validation.min()), candidates[int(validation.argmin())].vector
        run.candidates = method.better_half(candidates, validation)
        if s.adversaries:
            found = worst_samples(problem, run.candidates[0].vector, s.adversaries)
            run.worst = np.concatenate([run.worst, found.rows])
        seconds = round(time.monotonic() - began, 3)
        row = Row(number, float(training.min()), float(validation.min()), best, rejected, seconds)
        run.history.append(row)
        if folder is not None:
            state.write(folder, _packed(run), problem.scenario.to_toml())
        if progress is not None:
            progress(row)


def _packed(run: Progressing) -> dict[str, np.ndarray]:
    arrays = {"best": run.best, "worst": run.worst, "history": np.array(run.history, dtype=float)}
    arrays["count"] = np.array(len(run.candidates))
    for i, candidate in enumerate(run.candidates):
        for j, leaf in enumerate(jax.tree.leaves(candidate)):
            arrays[f"candidate_{i}_{j}"] = np.asarray(leaf)
    return arrays


def _unpacked(problem: Problem, chosen: method.LBFGS | method.Optax, arrays: dict[str, np.ndarray]) -> Progressing:
    structure = jax.tree.structure(Candidate(problem.space.start, chosen.start(problem.space.start)))
    candidates = []
    for i in range(int(arrays["count"])):
        leaves = [arrays[f"candidate_{i}_{j}"] for j in range(structure.num_leaves)]
        candidate = jax.tree.unflatten(structure, leaves)
        candidates.append(candidate._replace(reach=float(candidate.reach)))
    history = [Row(int(r[0]), *map(float, r[1:4]), int(r[4]), float(r[5])) for r in arrays["history"]]
    return Progressing(candidates, arrays["best"], arrays["worst"], history)


def _result(problem: Problem, run: Progressing) -> TuningResult:
    space, s = problem.space, problem.scenario.tuning
    gains = space.gains(run.best)
    vectors = np.stack([space.start, run.best])
    comparison = compare(problem, vectors, TEST, s.test_samples)
    before, after = (np.asarray(space.values(vector)) for vector in vectors)
    tuned = problem.scenario.with_overrides(gain_tables(gains, space.names))
    return TuningResult(tuned, space.labels(), before, after, run.history, comparison)


@contextlib.contextmanager
def _folder(out: str | Path | None, resume: bool) -> Iterator[Path | None]:
    """The folder of a run, which is this process's alone; a new one goes again if nothing is written."""
    if out is None:
        yield None
        return
    folder = resolve_path(out, "--out")
    if resume and not folder.is_dir():
        raise UserError("--resume", f"used with a folder that has a {state.NAME}", folder)
    with locked_folder(folder):
        if not resume and (folder / state.NAME).exists():
            raise UserError("--out", "a folder without a tuning run, or --resume given", folder)
        yield folder

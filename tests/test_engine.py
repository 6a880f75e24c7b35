"""Batches on other processes: the same bits, whatever carries them, and one line for what goes wrong."""

import multiprocessing
import os
import pickle
import signal
import threading
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from http.server import HTTPServer, SimpleHTTPRequestHandler

import jax
import numpy as np
import pytest

from coopmm_jax import load_plugin, load_scenario
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.kinds import software
from coopmm_jax.sweeps import dask, engine
from coopmm_jax.sweeps.batch import Program, in_batches, run, slots
from coopmm_jax.sweeps.engine import carried_by
from coopmm_jax.sweeps.run import sweep
from tuning.cost import evaluate
from tuning.cost.objective import Objective
from tuning.cost.problem import unscaled

PLUGIN = """
from typing import Annotated, NamedTuple
import coopmm_jax as cm

@cm.register("disturbance", "knock")
class Knock(NamedTuple):
    "A parabola."
    top: Annotated[float, cm.quantity("time of its top [s]")] = 0.01

    def value(self, t):
        return 1.0 - (t - self.top) ** 2
"""

VARIED = {"plant.masses": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}}
SHORT = {"simulation": {"duration": 0.03}}
BATCH, SAMPLES, KILLED_AT = 8, 96, 8


def squared(offset, x, shift):
    return (x + offset) ** 2 + shift


class Killing:
    """An executor that kills one of its workers when it is given a certain batch."""

    def __init__(self, executor):
        self.executor, self.given, self.killed = executor, 0, []
        self._client = executor._client  # by which the number of workers is known

    def submit(self, function, order):
        self.given += 1
        if self.given == KILLED_AT:
            pids = self._client.run(os.getpid)
            self.killed.append(min(pids.values()))
            os.kill(self.killed[0], signal.SIGKILL)
        return self.executor.submit(function, order)


def test_two_workers_of_which_one_is_killed_find_the_same_bits(registered, tmp_path, monkeypatch):
    """With a kind of a plugin, whose file the workers cannot read any more."""
    plugin = tmp_path / "plugin.py"
    plugin.write_text(PLUGIN)
    load_plugin(plugin)
    plugin.unlink()
    scenario = load_scenario("paper", uncertainty=VARIED, disturbance=[{"kind": "knock", "wheel": 5.0}], **SHORT)
    alone = sweep(scenario, SAMPLES, batch=BATCH, keep=0)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", jax.config.jax_compilation_cache_dir)
    with dask.connected("local:2") as executor:
        killing = Killing(executor)
        shared = sweep(scenario, SAMPLES, batch=BATCH, keep=0, executor=killing)
    assert len(killing.killed) == 1
    assert killing.given == SAMPLES // BATCH  # what was finished is not asked for again
    np.testing.assert_array_equal(alone.metrics.values, shared.metrics.values)
    np.testing.assert_array_equal(alone.status.values, shared.status.values)
    assert len(np.unique(alone.metrics.sel(metric="force_min").values)) > SAMPLES // 2


def test_any_executor_carries_batches():
    program, x = Program(squared, (0.5,)), np.arange(10.0)

    def compute(device, rows):
        return run(program, device, (x[rows],), (np.float64(2.0),))

    with ThreadPoolExecutor(3) as pool, carried_by(pool):
        assert len(slots()) == 6  # one at work and one waiting for each worker
        np.testing.assert_array_equal(in_batches(compute, 10, 4), (x + 0.5) ** 2 + 2.0)
    assert not isinstance(slots()[0], engine.Elsewhere)


def test_what_goes_to_a_worker_is_small_and_comes_back_equal():
    scenario = load_scenario("sensed")
    objective = Objective.of(scenario, scenario.structure(), 20.0)
    samples = unscaled(scenario).samples(0, 2)
    programs = [kind.program(objective, kind.layout(samples)) for kind in (evaluate._TERMS, evaluate._GRADIENT)]
    content = engine._pickled((*programs, jax.tree.structure(scenario.parameters())))
    assert len(content) < 20_000
    assert pickle.loads(content) == (*programs, jax.tree.structure(scenario.parameters()))


class Broken(Executor):
    """Loses its worker."""

    _max_workers = 1

    def submit(self, function, order):
        future = Future()
        future.set_exception(ConnectionError("the worker\nhas gone"))
        return future


def test_a_failure_names_its_samples():
    with pytest.raises(UserError) as caught:
        sweep(load_scenario("paper", uncertainty=VARIED), 100, keep=0, executor=Broken())
    assert str(caught.value) == (
        "executor: must be one whose workers can run a batch, "
        "was ConnectionError: the worker has gone, for samples 0 to 63"
    )


def test_a_worker_that_would_find_other_bits_refuses(monkeypatch):
    order = engine.Order((), software.versions() | {"coopmm_jax": "9.9"}, "", b"")
    refusal = engine.work(order)
    assert refusal.must == "one whose workers have coopmm_jax 9.9, as this process has"
    refusal = engine.work(engine.Order((), software.versions(), "--xla_other=1", b""))
    assert refusal.must == "one whose workers have XLA_FLAGS=--xla_other=1"
    monkeypatch.setattr(engine, "work", lambda order: refusal)
    with ThreadPoolExecutor(1) as pool, carried_by(pool), pytest.raises(UserError) as caught:
        in_batches(lambda device, rows: run(Program(squared, (0.5,)), device, (rows * 1.0,), (0.0,)), 3, 3)
    assert (caught.value.field, caught.value.must) == ("executor", refusal.must)


def test_a_pool_that_forks_is_refused():
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork"))
    with pytest.raises(UserError, match=r'get_context\("spawn"\)\), was a pool that forks'), carried_by(pool):
        pass


class Silent(SimpleHTTPRequestHandler):
    """A server whose thread writes nothing into the output of the tests that follow."""

    def log_message(self, *_):
        pass


def test_what_answers_and_is_no_scheduler_is_one_line(monkeypatch):
    monkeypatch.setattr(dask, "_PATIENCE", 0.5)
    with HTTPServer(("127.0.0.1", 0), Silent) as server:
        threading.Thread(target=server.handle_request, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.server_port}"
        with pytest.raises(UserError, match="--dask: must be the address of a Dask scheduler"), dask.connected(address):
            pass


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere", "local:0", "local:many", "head:99999"])
def test_an_address_without_a_scheduler_is_one_line(monkeypatch, capsys, tmp_path, address):
    monkeypatch.setattr(dask, "_PATIENCE", 0.5)
    command = ["sweep", "sensed", "--dask", address, "--out", str(tmp_path / "never.zarr")]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert f"--dask: must be the address of a Dask scheduler, as tcp://head:8786, or local:N, was {address}" in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


class Scheduler:
    """Stands in for a client of Dask's."""

    def __init__(self, answer):
        self.answer = answer

    def wait_for_workers(self, count, timeout):
        if self.answer is None:
            raise TimeoutError

    def run(self, function):
        if isinstance(self.answer, Exception):
            raise self.answer
        return {"tcp://there:1": self.answer}


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "a scheduler that has workers, was tcp://head:1 without"),
        (
            ModuleNotFoundError("No module named 'coopmm_jax'"),
            "a scheduler whose workers have coopmm_jax, was tcp://head",
        ),
        ({"coopmm_jax": "9.9"}, ", as this process has, was none at tcp://there:1"),
        (software.versions() | {"jax": "0.1"}, ", as this process has, was 0.1 at tcp://there:1"),
        (
            ValueError("no\nanswer"),
            "whose workers answer, with the versions of this process, was tcp://head:1 (ValueError",
        ),
    ],
)
def test_workers_that_cannot_compute_the_same_are_told(answer, message):
    with pytest.raises(UserError) as caught:
        dask._check_workers(Scheduler(answer), "tcp://head:1")
    assert message in str(caught.value)


def test_a_job_array_runs_every_share(tmp_path, capsys):
    command = ["sweep", "sensed", "--samples", "128", "--gains.K-lambda", "2", "--out", str(tmp_path / "s.zarr")]
    assert main([*command, "--slurm", "4"]) == 0
    script = (tmp_path / "s.slurm").read_text()
    assert "#SBATCH --array=0-3\n" in script
    assert script.endswith(f'exec coopmm {" ".join(command)} --resume --rank "$SLURM_ARRAY_TASK_ID" --size 4\n')
    capsys.readouterr()
    assert main([*command, "--slurm", "4"]) == 2
    assert "--slurm: must be used where no script is yet" in capsys.readouterr().err
    for more, message in (
        (["--slurm", "0"], "--slurm: must be from 1 to 10000 jobs, was 0"),
        (["--slurm", "2", "--dask", "local:2"], "--dask: must be left out where --slurm is given"),
    ):
        assert main([*command, *more]) == 2
        assert message in capsys.readouterr().err

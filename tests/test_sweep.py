"""Sweeps: the same bits however they are run, the metrics of single simulations, failures, work on all cores."""

import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import xarray

import coopmm_jax as cm
from coopmm_jax.cli import main
from coopmm_jax.commands import sweep as command
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.variation import vary
from coopmm_jax.status import Status
from coopmm_jax.sweeps import measure
from coopmm_jax.sweeps.processes import Share
from coopmm_jax.sweeps.store import chunk_file
from tests import compiled_by_sweep
from tests.sweeps import BATCH, MANY, SENTENCES, bits
from tests.workers import environment


def test_variables_are_labelled_and_have_units(many, scenario):
    metrics = (*METRICS, *SENTENCES)
    assert dict(many.sizes) == {"sample": MANY, "parameter": 21, "metric": len(metrics), "kept": 0, "t": 51}
    assert many.metric.values.tolist() == list(metrics)
    force = many.metrics.sel(metric="force_min")
    assert (str(force.metric_unit.values), str(force.metric_meaning.values)) == METRICS["force_min"][1:3]
    mass = many.parameters.sel(parameter="plant.m_p.2")
    assert str(mass.parameter_unit.values) == "kg"
    assert 4.0 <= mass.values.min() < 4.1 < 5.9 < mass.values.max() <= 6.0
    assert many.contact_force.attrs["units"] == "N"
    assert json.loads(many.attrs["versions"])["jax"] == jax.__version__
    assert cm.load_scenario("paper", **scenario.model_dump(exclude_none=True)) == scenario


def test_a_sweep_alone_is_the_head_of_a_larger_one(sweep, many):
    assert bits(sweep(100)) == bits(many.isel(sample=slice(100)))


def test_a_store_grows_without_computing_again_what_is_complete(sweep, many, tmp_path):
    store = tmp_path / "sweep.zarr"
    assert bits(sweep(12, out=store)) == bits(many.isel(sample=slice(12)))
    complete, cut = (chunk_file(store, "status", batch, 1).stat().st_mtime_ns for batch in (0, 1))
    grown = sweep(30, out=store, resume=True)
    assert bits(grown) == bits(many.isel(sample=slice(30)))
    assert chunk_file(store, "status", 0, 1).stat().st_mtime_ns == complete
    assert chunk_file(store, "status", 1, 1).stat().st_mtime_ns > cut
    assert sweep(out=store, resume=True).sizes["sample"] == 30


def test_kept_series_grow_with_the_store(sweep, kept, tmp_path):
    assert bits(sweep(12, keep=20, out=tmp_path / "sweep.zarr")) == bits(kept.isel(sample=slice(12), kept=slice(12)))
    grown = sweep(30, keep=20, out=tmp_path / "sweep.zarr", resume=True)
    assert bits(grown) == bits(kept.isel(sample=slice(30)))


def test_killed_and_resumed_is_as_if_nothing_had_happened(start, sweep, many, tmp_path):
    store = tmp_path / "sweep.zarr"
    process = start("--samples", str(MANY), "--out", "sweep.zarr")
    while not chunk_file(store, "status", 3, 1).exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    written = {path: path.stat().st_mtime_ns for path in store.rglob("c/*/*") if path.suffix != ".partial"}
    others = len(os.sched_getaffinity(0)) - 1  # each can still be at one of the first three batches
    assert max(1, 4 - others) <= sum(path.parent.parent.parent.name == "metrics" for path in written) < MANY // BATCH
    resumed = sweep(MANY, out=store, resume=True)
    assert bits(resumed) == bits(many)
    # Each of the two cores can have had one batch half written, of four arrays.
    assert sum(path.stat().st_mtime_ns != then for path, then in written.items()) <= 2 * len(os.sched_getaffinity(0))


def test_the_compilers_options_of_the_command_change_nothing(tmp_path):
    """As shipped, with every loop over 64 robots vectorised, against machine code as it comes."""
    command = [sys.executable, "-m", compiled_by_sweep.__name__, str(tmp_path / "shipped.npz")]
    subprocess.run(command, env=environment(shipped=True), check=True, capture_output=True)
    shipped = np.load(tmp_path / "shipped.npz")
    assert "vectorize-memory-check-threshold" in str(shipped["options"])
    np.testing.assert_allclose(shipped["moved"], compiled_by_sweep.moved(), rtol=1e-12, atol=1e-14)


def test_two_processes_share_a_sweep(start, many, tmp_path, monkeypatch, capsys):
    common = ("--samples", "100", "--out", "sweep.zarr", "--size", "2")
    other = start(*common, "--rank", "1")
    number, compute = itertools.count(), measure.measure

    def waiting(*given):
        """Keep pace with the other process: begin when it has begun, end after it, to find all of it complete."""
        batch = next(number)
        while batch == 0 and other.poll() is None and not chunk_file(tmp_path / "sweep.zarr", "status", 1, 1).exists():
            time.sleep(0.002)
        if batch == 100 // BATCH // 2:
            other.wait(timeout=600)
        return compute(*given)

    reported = []
    monkeypatch.setattr(measure, "measure", waiting)
    monkeypatch.setattr(command, "publish_and_print", lambda folder, data, **_: reported.append((folder, bits(data))))
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "scenario.toml", "--keep", "0", "--batch", str(BATCH), *common, "--rank", "0"]) == 0
    said = other.communicate()
    assert other.returncode == 0, said
    assert "samples are left to other processes" in said[0]
    shared = xarray.open_zarr(tmp_path / "sweep.zarr")
    assert bits(shared) == bits(many.isel(sample=slice(100)))
    assert reported == [(Path("sweep-report"), bits(shared))]
    assert "written to sweep.zarr and sweep-report" in capsys.readouterr().out


def test_processes_find_each_other_through_a_coordinator():
    with socket.socket() as free:
        free.bind(("localhost", 0))
        coordinator = f"localhost:{free.getsockname()[1]}"
    code = "import sys; from coopmm_jax.sweeps.processes import share; print(share(int(sys.argv[1]), 2, sys.argv[2]))"
    command = [sys.executable, "-c", code]
    pipe = {"stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen([*command, str(rank), coordinator], **pipe) for rank in range(2)]
    said = [process.communicate(timeout=600)[0].strip() for process in processes]
    assert said == [str(Share(0, 2)), str(Share(1, 2))]


def test_ranks_compute_their_own_tiles(sweep, many, tmp_path):
    half = sweep(30, out=tmp_path / "s.zarr", share=Share(0, 2))
    computed = half.status.values >= 0
    assert computed.tolist() == [sample // BATCH % 2 == 0 for sample in range(30)]
    assert bits(sweep(30, out=tmp_path / "s.zarr", share=Share(1, 2))) == bits(many.isel(sample=slice(30)))


def test_metrics_are_those_of_single_simulations(many):
    failed = np.flatnonzero(many.status.values)[:2]
    for sample in (*range(6), *failed):
        run = cm.simulate(cm.replay(many, int(sample)))
        row = many.isel(sample=sample)
        assert Status(int(row.status)) is run.status
        assert run.ok or float(row.status_time) == run.status_time
        expected = np.array([run.metrics[name] for name in many.metric.values])
        # Rounding is all that there is of the constraint residual.
        rounding = np.where(many.metric.values == "constraint_residual_max", 1e-14, 0.0)
        np.testing.assert_array_equal(np.isnan(row.metrics), np.isnan(expected))
        beyond = np.abs(row.metrics.values - expected) > 1e-10 * np.abs(expected) + rounding
        assert not beyond.any()


def test_kept_series_are_those_of_single_simulations(kept):
    failed = int(np.flatnonzero(kept.status.values[:20])[0])
    for sample in (0, 19, failed):
        run = cm.simulate(cm.replay(kept, sample))
        force = kept.contact_force.values[sample]
        np.testing.assert_allclose(force[: len(run.t)], run.constraint_force[:, 0], rtol=1e-9)
        assert np.isnan(force[len(run.t) :]).all()
        np.testing.assert_allclose(np.nanmax(kept.torque.values[sample]), run.metrics["torque_peak"], rtol=1e-12)
        np.testing.assert_allclose(np.nanmax(kept.c_hat.values[sample]), run.metrics["c_hat_max"], rtol=1e-12)
    np.testing.assert_array_equal(kept.t.values, run.scenario.sample_time * np.arange(51))


def test_a_failing_sample_changes_no_bit_of_its_neighbours(scenario):
    variation, device = vary(scenario), jax.devices()[0]
    horizon = measure.Horizon(1e-3, 50, "float64")
    points = np.full((BATCH, len(variation.draws)), 0.3)
    points += np.linspace(0.0, 0.1, BATCH)[:, None]
    healthy = variation.batch(points, range(BATCH))
    scale, x = healthy.disturbance[0].scale.copy(), healthy.start[0].x.copy()
    scale[2], x[5] = 1e7, 9.0
    start = (healthy.start[0]._replace(x=x), healthy.start[1])
    broken = healthy._replace(disturbance=(healthy.disturbance[0]._replace(scale=scale),), start=start)
    common = variation.structure(), horizon, device
    spoken = scenario.requirements.sentences()  # as in the sweeps, whose program this is then
    before, after = (measure.measure(*common, parameters, spoken) for parameters in (healthy, broken))
    assert before.status.tolist() == [Status.OK] * BATCH
    assert np.flatnonzero(after.status).tolist() == [2, 5]
    assert after.status[5] == Status.UNREACHABLE
    assert np.isnan(after.metrics[5, : len(METRICS)]).all()
    assert np.all(after.metrics[5, len(METRICS) :] < 0.0)  # what ends in failure breaks every sentence
    others = np.array([0, 1, 3, 4, 6, 7])
    assert np.array_equal(before.metrics[others], after.metrics[others])


def test_sobol_sweep_uses_sobol_points(sweep, scenario):
    data = sweep(20, sampling="sobol", seed=3)
    variation = vary(scenario)
    values = variation.values(sampler("sobol", 3, len(variation.draws))(range(20)))
    np.testing.assert_array_equal(data.parameters.sel(parameter="disturbance.phase"), values["disturbance.phase"])


def test_memory_sweeps_leave_no_files(sweep, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sweep(8).sizes["sample"] == 8
    assert list(tmp_path.iterdir()) == []

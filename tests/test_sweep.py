"""Sweeps: the same bits however they are run, failures, statistics, figures, stores that go wrong."""

import doctest
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time

import jax
import numpy as np
import pytest
import xarray
from scipy import stats

import coopmm_jax as cm
from coopmm_jax import distributed, metric_table, plotting, sweep_report, sweep_statistics, sweep_tiles
from coopmm_jax.cli import main
from coopmm_jax.distributed import Share, concurrently
from coopmm_jax.errors import UserError
from coopmm_jax.metric_table import METRICS
from coopmm_jax.sampling import sampler
from coopmm_jax.status import Status
from coopmm_jax.sweep_statistics import read_results
from coopmm_jax.sweep_store import chunk_file
from coopmm_jax.uncertainty import vary

TILE = 8
ENTRIES = {
    "plant.masses": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True, "each": True},
    "disturbance.scale": {"distribution": "log_uniform", "low": 0.1, "high": 1e6},  # the strongest end in failure
    "disturbance.phase": {"distribution": "uniform", "low": 0.0, "high": 6.0},
}
REQUIRED = {"force_min": ">= -90", "torque_peak": "<= 200"}


def bits(data):
    """Everything a sweep has computed, as bytes by name."""
    names = ("parameters", "metrics", "status", "status_time", *sweep_tiles.SERIES)
    return {name: data[name].values.tobytes() for name in names}


@pytest.fixture(scope="session")
def scenario():
    """The paper's first 50 ms, so that ``cm.simulate`` shares the program of other tests."""
    settings = {"duration": 0.05, "step": 0.001}
    return cm.load_scenario("paper", simulation=settings, uncertainty=ENTRIES, requirements=REQUIRED)


@pytest.fixture(scope="session")
def sweep(scenario):
    """``cm.sweep`` with tiles of one size, so that all tests share its programs."""

    def run(samples=None, scenario=scenario, keep=0, **options):
        return cm.sweep(scenario, samples, keep=keep, tile=TILE, **options)

    return run


@pytest.fixture(scope="session")
def thousand(sweep):
    return sweep(1000)


@pytest.fixture(scope="session")
def kept(sweep):
    return sweep(100, keep=20)


@pytest.fixture
def start(scenario, tmp_path):
    """Start ``coopmm sweep`` on the scenario in a process of its own, which shares the programs of this one."""
    (tmp_path / "scenario.toml").write_text(scenario.to_toml())
    cache = {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir}
    environment = os.environ | cache | {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}
    code = "import sys; from coopmm_jax.cli import main; sys.exit(main(sys.argv[1:]))"
    fixed = [sys.executable, "-c", code, "sweep", "scenario.toml", "--keep", "0", "--tile", str(TILE)]
    processes = []

    def run(*arguments):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        processes.append(subprocess.Popen([*fixed, *arguments], cwd=tmp_path, env=environment, **pipes))
        return processes[-1]

    yield run
    for process in processes:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("module", [distributed, metric_table, sweep_statistics], ids=lambda module: module.__name__)
def test_examples_in_docstrings(module):
    assert doctest.testmod(module).failed == 0


def test_variables_are_labelled_and_have_units(thousand, scenario):
    assert dict(thousand.sizes) == {"sample": 1000, "parameter": 21, "metric": len(METRICS), "kept": 0, "t": 51}
    force = thousand.metrics.sel(metric="force_min")
    assert (str(force.metric_unit.values), str(force.metric_meaning.values)) == METRICS["force_min"]
    mass = thousand.parameters.sel(parameter="plant.m_p.2")
    assert str(mass.parameter_unit.values) == "kg"
    assert 4.0 <= mass.values.min() < 4.1 < 5.9 < mass.values.max() <= 6.0
    assert thousand.contact_force.attrs["units"] == "N"
    assert thousand.attrs["versions"]["jax"] == jax.__version__
    assert cm.load_scenario("paper", **scenario.model_dump(exclude_none=True)) == scenario


def test_a_sweep_alone_is_the_head_of_a_larger_one(sweep, thousand):
    assert bits(sweep(300)) == bits(thousand.isel(sample=slice(300)))


def test_a_store_grows_without_computing_again_what_is_complete(sweep, thousand, tmp_path):
    store = tmp_path / "sweep.zarr"
    assert bits(sweep(12, out=store)) == bits(thousand.isel(sample=slice(12)))
    complete, cut = (chunk_file(store, "status", tile, 1).stat().st_mtime_ns for tile in (0, 1))
    grown = sweep(30, out=store, resume=True)
    assert bits(grown) == bits(thousand.isel(sample=slice(30)))
    assert chunk_file(store, "status", 0, 1).stat().st_mtime_ns == complete
    assert chunk_file(store, "status", 1, 1).stat().st_mtime_ns > cut
    assert sweep(out=store, resume=True).sizes["sample"] == 30


def test_kept_series_grow_with_the_store(sweep, kept, tmp_path):
    assert bits(sweep(12, keep=20, out=tmp_path / "sweep.zarr")) == bits(kept.isel(sample=slice(12), kept=slice(12)))
    grown = sweep(30, keep=20, out=tmp_path / "sweep.zarr", resume=True)
    assert bits(grown) == bits(kept.isel(sample=slice(30)))


def test_killed_and_resumed_is_as_if_nothing_had_happened(start, sweep, thousand, tmp_path):
    store = tmp_path / "sweep.zarr"
    process = start("--samples", "1000", "--out", "sweep.zarr")
    while not chunk_file(store, "status", 3, 1).exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    written = {path: path.stat().st_mtime_ns for path in store.rglob("c/*/*") if path.suffix != ".partial"}
    assert 4 <= sum(path.parent.parent.parent.name == "metrics" for path in written) < 125
    resumed = sweep(1000, out=store, resume=True)
    assert bits(resumed) == bits(thousand)
    # Each of the two cores can have had one tile half written, of four arrays.
    assert sum(path.stat().st_mtime_ns != then for path, then in written.items()) <= 2 * len(os.sched_getaffinity(0))


def test_two_processes_share_a_sweep(start, thousand, tmp_path):
    common = ("--samples", "300", "--out", "sweep.zarr", "--size", "2")
    processes = [start(*common, "--rank", rank) for rank in "01"]
    said = [process.communicate(timeout=600) for process in processes]
    assert [process.returncode for process in processes] == [0, 0], said
    shared = xarray.open_zarr(tmp_path / "sweep.zarr", consolidated=False)
    assert bits(shared) == bits(thousand.isel(sample=slice(300)))
    assert any("written to sweep.zarr and sweep-report" in out for out, _ in said)
    assert (tmp_path / "sweep-report" / "requirements.png").stat().st_size > 10_000


def test_processes_find_each_other_through_a_coordinator():
    with socket.socket() as free:
        free.bind(("localhost", 0))
        coordinator = f"localhost:{free.getsockname()[1]}"
    code = "import sys; from coopmm_jax.distributed import share; print(share(int(sys.argv[1]), 2, sys.argv[2]))"
    command = [sys.executable, "-c", code]
    pipe = {"stdout": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen([*command, str(rank), coordinator], **pipe) for rank in range(2)]
    said = [process.communicate(timeout=600)[0].strip() for process in processes]
    assert said == [str(Share(0, 2)), str(Share(1, 2))]


def test_ranks_compute_their_own_tiles(sweep, thousand, tmp_path):
    half = sweep(30, out=tmp_path / "s.zarr", share=Share(0, 2))
    computed = half.status.values >= 0
    assert computed.tolist() == [sample // TILE % 2 == 0 for sample in range(30)]
    assert bits(sweep(30, out=tmp_path / "s.zarr", share=Share(1, 2))) == bits(thousand.isel(sample=slice(30)))


def test_metrics_are_those_of_single_simulations(thousand):
    failed = np.flatnonzero(thousand.status.values)[:2]
    for sample in (*range(6), *failed):
        run = cm.simulate(cm.replay(thousand, int(sample)))
        row = thousand.isel(sample=sample)
        assert Status(int(row.status)) is run.status
        assert run.ok or float(row.status_time) == run.status_time
        expected = np.array([run.metrics[name] for name in METRICS])
        # Rounding is all that there is of the constraint residual.
        rounding = np.where(np.array(list(METRICS)) == "constraint_residual_max", 1e-14, 0.0)
        assert np.all(np.abs(row.metrics.values - expected) <= 1e-10 * np.abs(expected) + rounding)


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
    horizon = sweep_tiles.Horizon(1e-3, 50, "float64")
    points = np.full((TILE, len(variation.draws)), 0.3)
    points += np.linspace(0.0, 0.1, TILE)[:, None]
    healthy = variation.batch(points, range(TILE))
    scale, x = healthy.disturbance.scale.copy(), healthy.start[0].x.copy()
    scale[2], x[5] = 1e7, 9.0
    start = (healthy.start[0]._replace(x=x), healthy.start[1])
    broken = healthy._replace(disturbance=healthy.disturbance._replace(scale=scale), start=start)
    before, after = (sweep_tiles.measure(variation.structure(), horizon, device, p) for p in (healthy, broken))
    assert before.status.tolist() == [Status.OK] * TILE
    assert np.flatnonzero(after.status).tolist() == [2, 5]
    assert after.status[5] == Status.UNREACHABLE
    assert np.isnan(after.metrics[5]).all()
    assert np.isfinite(after.metrics[2]).all()
    others = np.array([0, 1, 3, 4, 6, 7])
    assert np.array_equal(before.metrics[others], after.metrics[others])


def test_items_are_taken_only_when_a_slot_is_free():
    taken = []

    def items():
        for i in range(20):
            taken.append(i)
            yield i

    slots = ["a", "b", "a", "b"]
    finished = 0
    for slot, _ in concurrently(lambda slot, item: (slot, item), items(), slots):
        assert slot in slots
        finished += 1
        assert len(taken) <= finished + len(slots) + 1
    assert finished == 20


def test_an_exception_ends_the_work():
    def fail(slot, item):
        raise ValueError(item)

    with pytest.raises(ValueError, match=r"^0$"):
        list(concurrently(fail, range(10**9), [None]))


def test_report_numbers(thousand):
    results = read_results(thousand)
    table = dict(zip(thousand.metric.values, thousand.metrics.values.T, strict=True))
    ok = thousand.status.values == Status.OK
    pressing = ok & (table["force_min"] >= -90)
    calm = ok & (table["torque_peak"] <= 200)
    rows = sweep_statistics.outcomes(results)
    assert [row.passed for row in rows] == [ok.sum(), pressing.sum(), calm.sum(), (pressing & calm).sum()]
    assert 0 < rows[3].passed < rows[0].passed < 1000
    force = table["force_min"][ok]
    summary = sweep_statistics.spread(results, "force_min")
    assert summary[:4] == (np.median(force), *np.quantile(force, [0.05, 0.95]), force.min())
    assert table["force_min"][summary.worst_sample] == force.min()
    assert sweep_statistics.spread(results, "force_max").worst == table["force_max"][ok].max()


def test_what_matters_is_found(thousand):
    results = read_results(thousand)
    assert sweep_statistics.telling(results) == ["completed", *REQUIRED]
    for metric in sweep_statistics.telling(results):
        strongest, interval = next(iter(sweep_statistics.sensitivities(results, metric).items()))
        assert strongest == "disturbance.scale"
        assert interval.low < interval.estimate < interval.high
    assert (
        sweep_statistics.worst_samples(results, "completed", 3).tolist()
        == results.index[~results.completed][:3].tolist()
    )


def test_intervals_of_rank_correlation_cover_the_truth():
    rng = np.random.default_rng(0)
    r = 0.6
    truth = 6 / np.pi * np.arcsin(r / 2)  # Spearman's of a bivariate normal distribution
    pairs = rng.multivariate_normal([0, 0], [[1, r], [r, 1]], (400, 100))
    intervals = [sweep_statistics.rank_correlation(x, y) for x, y in pairs.transpose(0, 2, 1)]
    assert intervals[0].estimate == pytest.approx(stats.spearmanr(*pairs[0].T).statistic, rel=1e-14)
    covered = sum(interval.low <= truth <= interval.high for interval in intervals)
    assert 366 <= covered <= 392  # 95 % of 400, give or take three standard deviations


def test_report_text_and_files(kept, tmp_path):
    results = read_results(kept)
    text = sweep_report.text(results)
    assert "100 samples of 0.05 s, seed 0" in text
    failed = int((~results.completed | ~np.logical_and.reduce([results.met(r) for r in results.requirements])).sum())
    assert f"failed samples: {failed}\n" in text
    first = int(results.index[~results.completed][0])
    assert f"\n  {first:8}  SPEED at t = " in text
    sweep_report.write_report(tmp_path, kept)
    assert (tmp_path / "report.txt").read_text() == text + "\n"
    assert len((tmp_path / "failed.csv").read_text().splitlines()) == 1 + failed
    for name in ("bands", "importance", "requirements", "worst"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000


def test_figures_show_the_numbers(kept):
    bands = plotting.sweep_bands(kept)
    median = bands.axes[2].lines[0]
    np.testing.assert_allclose(median.get_ydata(), np.nanmedian(kept.contact_force.values, axis=0), rtol=1e-12)
    limits = plotting.sweep_requirements(kept).axes
    assert [axes.get_xlabel() for axes in limits] == ["force_min [N]", "torque_peak [N m]"]
    assert limits[0].get_title().startswith("force_min >= -90\nmet by 0.")
    assert sum(patch.get_height() for patch in limits[0].containers[0]) == (kept.status.values == 0).sum()
    importance = plotting.sweep_importance(kept).axes
    assert importance[1].get_yticklabels()[-1].get_text() == "disturbance.scale"
    worst = plotting.sweep_worst(kept).axes[2]
    assert worst.get_title() == "10 worst of torque_peak"
    assert worst.lines[-1].get_xdata().min() > 0.5


def test_figures_refuse_what_they_cannot_draw(thousand, sweep, scenario):
    with pytest.raises(UserError, match=r"^keep: must be at least 1 for bands over time, was 0$"):
        plotting.sweep_bands(thousand)
    quiet = sweep(8, scenario.with_overrides({"requirements": {"contact_loss_fraction": "<= 1"}}), sampling="sobol")
    assert sweep_statistics.telling(read_results(quiet.isel(sample=slice(2)))) == []
    with pytest.raises(UserError, match=r"^sweep: must be one with samples that differ"):
        plotting.sweep_worst(quiet.isel(sample=slice(2)))


def test_sobol_sweep_uses_sobol_points(sweep, scenario):
    data = sweep(20, sampling="sobol", seed=3)
    variation = vary(scenario)
    values = variation.values(sampler("sobol", 3, len(variation.draws))(range(20)))
    np.testing.assert_array_equal(data.parameters.sel(parameter="disturbance.phase"), values["disturbance.phase"])


def test_simulate_from_a_store(sweep, thousand, tmp_path, capsys):
    sweep(8, out=tmp_path / "sweep.zarr")
    assert main(["simulate", "--from", str(tmp_path / "sweep.zarr"), "--sample", "5"]) == 0
    *_, calm = lines = capsys.readouterr().out.splitlines()
    force, torque = (float(thousand.metrics.sel(metric=name)[5]) for name in ("force_min", "torque_peak"))
    assert dict(line.split()[:2] for line in lines[2:])["force_min"] == f"{force:.6g}"
    assert calm == f"  requirement torque_peak <= 200: {'met' if torque <= 200 else 'not met'}"


def test_report_with_other_requirements(sweep, tmp_path, capsys):
    sweep(40, out=tmp_path / "sweep.zarr")
    assert main(["report", str(tmp_path / "sweep.zarr"), "--requirements.force-max", ">= 1e9"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^force_max >= 1e\+09 +0 of 40 +0.0000  0.0000 to 0.0881$", out, re.MULTILINE)
    assert out.endswith(f"written to {tmp_path / 'sweep-report'}\n")


def test_a_store_by_other_settings_is_refused(sweep, scenario, tmp_path):
    store = tmp_path / "sweep.zarr"
    sweep(8, out=store)
    before = {path: path.read_bytes() for path in store.rglob("*") if path.is_file()}
    other = scenario.with_overrides({"gains.k0": 4.0})
    wider = scenario.with_overrides({"uncertainty.disturbance.phase.high": 7.0})
    for options, message in (
        ({"scenario": other}, f"gains.k0: must be 5.0, as {store} was made with, was 4.0"),
        ({"scenario": wider}, f"uncertainty.disturbance.phase.high: must be 6.0, as {store} was made with, was 7.0"),
        ({"seed": 1}, f"simulation.seed: must be 0, as {store} was made with, was 1"),
        ({"sampling": "sobol"}, f"sampling: must be independent, as {store} was made with, was sobol"),
        ({"keep": 1}, f"keep: must be 0, as {store} was made with, was 1"),
        ({"samples": 4}, f"samples: must be at least 8, as {store} has, was 4"),
        ({"resume": False}, f"out: must be a path where nothing is, or a sweep's store to --resume, was {store}"),
    ):
        with pytest.raises(UserError) as error:
            sweep(**{"out": store, "resume": True} | options)
        assert str(error.value) == message
    assert {path: path.read_bytes() for path in store.rglob("*") if path.is_file()} == before


def test_a_corrupt_chunk_is_named_and_can_be_computed_again(sweep, thousand, tmp_path, capsys):
    store = tmp_path / "sweep.zarr"
    sweep(24, out=store)
    chunk = chunk_file(store, "metrics", 1, 2)
    spoilt = bytearray(chunk.read_bytes())
    spoilt[len(spoilt) // 2] ^= 255
    chunk.write_bytes(spoilt)
    assert main(["report", str(store)]) == 2
    message = "coopmm: error: metrics/c/1 of the store: must be readable (delete the file, and sweep --resume"
    assert capsys.readouterr().err.startswith(message)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sweep.zarr"]
    chunk.unlink()
    assert bits(sweep(24, out=store, resume=True)) == bits(thousand.isel(sample=slice(24)))


def test_a_full_disk_loses_nothing(sweep, thousand, tmp_path):
    store = tmp_path / "sweep.zarr"
    sweep(8, out=store)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    largest = max(path.stat().st_size for path in store.rglob("zarr.json") if path.parent != store)
    assert largest < chunk_file(store, "metrics", 0, 2).stat().st_size
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))  # no more than this into one file
    try:
        with pytest.raises(UserError, match=r"^out: must be a place with room .* \(File too large\); complete tiles"):
            sweep(40, out=store, resume=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert bits(sweep(40, out=store, resume=True)) == bits(thousand.isel(sample=slice(40)))


def test_memory_sweeps_leave_no_files(sweep, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert sweep(8).sizes["sample"] == 8
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--samples", "-3"], "samples: must be from 1 to 16777216, was -3"),
        (["--keep", "-1"], "keep: must be from 0 to 16777216, was -1"),
        (["--tile", "0"], "tile: must be from 1 to 16777216, was 0"),
        (["--seed", "-1"], "simulation.seed: must be at least 0, was -1"),
        (["--sampling", "halton"], "sampling: must be independent or sobol, was halton"),
        (["--requirements.force-rms", "<= 2"], "requirements.force_rms: must be a metric, as coopmm simulate"),
        (["--uncertainty", "none.toml"], "--uncertainty: must be a file that can be read, was none.toml (No such file"),
        (
            ["--uncertainty", "gains.toml"],
            "--uncertainty gains.toml: must be a file of [uncertainty] and [requirements]",
        ),
        (["--uncertainty", "bad.toml"], "--uncertainty: must be a TOML file, was bad.toml ("),
        (
            ["--out", "gains.toml"],
            "out: must be a path where nothing is, or a sweep's store to --resume, was gains.toml",
        ),
        (["--out", "gains.toml", "--resume"], "store: must be the store of a sweep, was gains.toml ("),
        (
            ["--out", "gains.toml/s.zarr"],
            "out: must be a place that can be written, was gains.toml/s.zarr (File exists)",
        ),
        (["--rank", "0"], "--rank: must be given together with --size, was given alone"),
        (["--rank", "2", "--size", "2"], "--rank: must be from 0 to --size - 1 (1), was 2"),
        (["--coordinator", "localhost:1"], "--coordinator: must be given together with --rank and --size, was given"),
        (
            ["--rank", "0", "--size", "2", "--distributed"],
            "--distributed: must be left out where --rank and --size are",
        ),
        (["--sample", "3"], "--sample: must be an option of coopmm sweep (did you mean --samples?), was unknown"),
    ],
)
def test_bad_input_is_one_line_and_code_2(arguments, message, scenario, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenario.toml").write_text(scenario.to_toml())
    (tmp_path / "gains.toml").write_text("[gains]\nk0 = 4\n")
    (tmp_path / "bad.toml").write_text("[gains\n")
    assert main(["sweep", "scenario.toml", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"coopmm: error: {message}")
    assert captured.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.toml", "gains.toml", "scenario.toml"]


def test_other_bad_input(sweep, tmp_path, capsys):
    with pytest.raises(UserError, match=r"^uncertainty: must be a section that names what varies, was empty$"):
        sweep(8, cm.load_scenario("paper"))
    sweep(8, out=tmp_path / "s.zarr")
    store = str(tmp_path / "s.zarr")
    for arguments, message in (
        (["report", str(tmp_path)], f"store: must be the store of a sweep, was {tmp_path} (not there)"),
        (["report", store, "--gains.k0", "2"], "--gains.k0: must be one of --requirements.METRIC"),
        (["simulate", "--from", store, "--sample", "8"], "sample: must be from 0 to 7, was 8"),
        (["simulate", "--from", store], "--sample: must be given together with --from, was missing"),
        (["simulate", "paper", "--from", store], "--from: must be given in place of SCENARIO, was given with paper"),
        (["simulate", "paper", "--sample", "1"], "--sample: must be given together with --from, was given alone"),
    ):
        assert main(arguments) == 2
        assert capsys.readouterr().err.startswith(f"coopmm: error: {message}")


def test_a_sample_that_is_not_there_yet(sweep, tmp_path):
    half = sweep(16, out=tmp_path / "s.zarr", share=Share(0, 2))
    with pytest.raises(UserError, match=r"^sample: must be one that has been computed .*, was 9$"):
        cm.replay(half, 9)
    results = read_results(half)
    assert results.index.tolist() == list(range(8))
    assert "8 of 16 samples (the rest is not there yet)" in sweep_report.text(results)
    with pytest.raises(UserError, match=r"^store: must be a sweep with at least one computed tile, was empty$"):
        read_results(half.isel(sample=slice(8, None)))

"""Sweeps that cannot be made, gone on with or read: what the user is told, and what is left alone."""

import resource

import pytest

import coopmm_jax as cm
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.sweeps import report
from coopmm_jax.sweeps import store as store_module
from coopmm_jax.sweeps.processes import Share
from coopmm_jax.sweeps.statistics import read_results
from coopmm_jax.sweeps.store import chunk_file
from tests.sweeps import bits


def test_a_store_by_other_settings_is_refused(sweep, scenario, tmp_path, capsys):
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
        (
            {"resume": False},
            f"out: must be a path where nothing is, or a sweep's store to --resume or --overwrite, was {store}",
        ),
    ):
        with pytest.raises(UserError) as error:
            sweep(**{"out": store, "resume": True} | options)
        assert str(error.value) == message
    assert {path: path.read_bytes() for path in store.rglob("*") if path.is_file()} == before
    anew = sweep(8, scenario=other, out=store, overwrite=True)
    assert bits(anew) == bits(sweep(8, scenario=other))
    assert store_module.computed(store) == (8, 8)
    assert main(["watch", str(store)]) == 0
    assert capsys.readouterr().out == f"{store}: 8 of 8 samples (100%)\n"


def test_a_corrupt_chunk_is_named_and_can_be_computed_again(sweep, many, tmp_path, capsys):
    store = tmp_path / "sweep.zarr"
    sweep(24, out=store)
    chunk = chunk_file(store, "metrics", 1, 2)
    spoilt = bytearray(chunk.read_bytes())
    spoilt[len(spoilt) // 2] ^= 255
    chunk.write_bytes(spoilt)
    assert main(["report", str(store)]) == 2
    must = "must be whole (coopmm sweep --resume computes the rest again)"
    captured = capsys.readouterr()
    said = f"coopmm: error: store: {must}, was {store} (samples 8 to 15: metrics/c/1/0 is corrupt)\n"
    assert captured.err == said
    assert "\n16 of 24 samples (the rest is not there yet) of " in captured.out
    assert bits(sweep(24, out=store, resume=True)) == bits(many.isel(sample=slice(24)))


@pytest.mark.parametrize("growing", [True, False])
def test_a_full_disk_loses_nothing(sweep, many, tmp_path, growing):
    """Neither while the store grows, nor while a batch is written."""
    store = tmp_path / "sweep.zarr"
    sweep(8 if growing else 40, out=store)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    largest = max(path.stat().st_size for path in store.rglob("zarr.json") if path.parent != store)
    assert largest < chunk_file(store, "metrics", 0, 2).stat().st_size
    if not growing:
        chunk_file(store, "metrics", 1, 2).unlink()
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, limits[1]))  # no more than this into one file
    try:
        with pytest.raises(UserError, match=r"^out: must be a place with room .* \(File too large\); complete batches"):
            sweep(40, out=store, resume=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert bits(sweep(40, out=store, resume=True)) == bits(many.isel(sample=slice(40)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--samples", "-3"], "samples: must be from 1 to 16777216, was -3"),
        (["--keep", "-1"], "keep: must be from 0 to 16777216, was -1"),
        (["--batch", "0"], "batch: must be from 1 to 16777216, was 0"),
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
            "out: must be a path where nothing is, or a sweep's store to --resume or --overwrite, was gains.toml",
        ),
        (["--out", "gains.toml", "--resume"], "store: must be the store of a sweep, was gains.toml ("),
        (
            ["--out", "gains.toml/s.zarr"],
            "--out: must be a folder that can be written, was ",
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
        (["report", str(tmp_path)], f"store: must be the store of a sweep, was {tmp_path} (not a store)"),
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
    assert "8 of 16 samples (the rest is not there yet)" in report.text(results)
    with pytest.raises(UserError, match=r"^store: must be a sweep with at least one computed batch, was empty$"):
        read_results(half.isel(sample=slice(8, None)))

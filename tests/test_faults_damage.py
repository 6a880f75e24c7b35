"""Damaged data never reads as good: sweeps' stores, runs, states, whole or with any of their files spoilt."""

import json
import shutil

import numpy as np
import pytest
import zarr

import coopmm_jax
import coopmm_jax as cm
from coopmm_jax.cli import main
from coopmm_jax.errors import UserError
from coopmm_jax.plotting import style
from coopmm_jax.runs.store import read_run, write_run
from coopmm_jax.sweeps.statistics import read_results
from coopmm_jax.sweeps.store import open_sweep
from tests.sweeps import BATCH, bits
from tuning.studies import state

JUNK = {"missing": None, "empty": b"", "words": b"no such thing", "null": b"null", "list": b"[[]]", "table": b"{}"}
SPOILT = 1  # the one that is spoilt, of three; the first has series


@pytest.fixture(scope="module")
def whole(sweep, tmp_path_factory):
    """A store of three batches, never to be changed."""
    path = tmp_path_factory.mktemp("whole") / "s.zarr"
    sweep(3 * BATCH, keep=BATCH, out=path)
    return path


@pytest.fixture(scope="module")
def complete(whole):
    """Its results, and the scenario of its first sample."""
    return read_results(open_sweep(whole)), cm.replay(whole, 0)


@pytest.fixture
def store(whole, tmp_path, monkeypatch):
    """A copy of it, in the working folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(style, "publish", lambda *_: None)
    shutil.copytree(whole, "s.zarr")
    return tmp_path / "s.zarr"


def spoil(path, how):
    """Change one bit in the midst of a file, or replace the file."""
    if how == "flipped":
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    elif JUNK[how] is None:
        path.unlink()
    else:
        path.write_bytes(JUNK[how])


def reported(capsys, *more):
    """Counts and complaints of a report."""
    code = main(["report", "s.zarr", *more])
    captured = capsys.readouterr()
    assert captured.err.count("\n") == (code == 2)
    return code, captured.out, captured.err


CHUNKS = [f"{name}/c/{SPOILT}" for name in ("parameters", "metrics", "status", "status_time")]
CHUNKS[:2] = [f"{chunk}/0" for chunk in CHUNKS[:2]]


@pytest.mark.parametrize(
    ("chunk", "how"),
    [*((chunk, how) for chunk in CHUNKS for how in ("flipped", "missing")), (CHUNKS[1], "empty"), (CHUNKS[2], "words")],
)
def test_a_spoilt_batch_is_named_and_not_counted(chunk, how, store, complete, capsys):
    spoil(store / chunk, how)
    code, out, err = reported(capsys)
    assert code == 2
    assert f"samples 8 to 15: {chunk} is {'missing' if how == 'missing' else 'corrupt'})" in err
    assert f"damaged, and not counted: samples 8 to 15: {chunk} is " in out
    data, (expected, first) = open_sweep(store), complete
    spoilt = read_results(data)
    others = [i for i in range(3 * BATCH) if i // BATCH != SPOILT]
    assert spoilt.index.tolist() == others
    for name, values in spoilt.metrics.items():
        np.testing.assert_array_equal(values, expected.metrics[name][others])
    with pytest.raises(UserError, match=rf"sample: must be one that has been .*, was 9 \(samples 8 to 15: {chunk}"):
        cm.replay(store, 9)
    assert cm.replay(data, 0) == first


def test_series_are_part_of_a_batch(store, capsys):
    (store / "torque" / "c" / "0" / "0").unlink()
    assert "samples 0 to 7: torque/c/0/0 is missing" in reported(capsys)[2]


def test_what_was_swapped_is_found_too(store, capsys):
    shutil.copy(store / "metrics" / "c" / "0" / "0", store / "metrics" / "c" / "1" / "0")
    assert "samples 8 to 15: another content than was written" in reported(capsys)[2]


def test_resuming_computes_damaged_batches_again(store, whole, sweep):
    spoil(store / "metrics" / "c" / "1" / "0", "flipped")
    spoil(store / "status" / "c" / "2", "missing")
    again = sweep(3 * BATCH, keep=BATCH, out=store, resume=True)
    assert again.attrs["damaged"] == "{}"
    assert bits(again) == bits(open_sweep(whole))


@pytest.mark.parametrize(
    ("name", "how"),
    [
        *((name, "flipped") for name in ("parameter", "parameter_unit", "metric", "metric_meaning", "t")),
        *((name, how) for name in ("parameter", "t") for how in ("missing", "words")),
    ],
)
def test_spoilt_coordinates_are_no_store(name, how, store, capsys):
    spoil(store / name / "c" / "0", how)
    code, _, err = reported(capsys)
    assert code == 2
    assert err.startswith("coopmm: error: store: must be the store of a sweep, was s.zarr (")


@pytest.mark.parametrize(
    ("folder", "how"),
    [
        *((folder, how) for folder in (".", "metrics") for how in JUNK),
        *((folder, how) for folder in ("status", "torque", "t", "checksums") for how in ("missing", "table")),
    ],
)
def test_spoilt_descriptions_are_no_store(folder, how, store, capsys):
    spoil(store / folder / "zarr.json", how)
    code, _, err = reported(capsys)
    assert code == 2
    assert err.startswith("coopmm: error: store: must be the store of a sweep, was s.zarr (")
    assert main(["simulate", "--from", "s.zarr", "--sample", "0"]) == 2


def test_settings_that_were_changed_are_no_store(store, capsys):
    about = json.loads((store / "zarr.json").read_text())
    about["attributes"]["scenario"] = about["attributes"]["scenario"].replace("k0 = 5.0", "k0 = 6.0")
    (store / "zarr.json").write_text(json.dumps(about))
    assert reported(capsys)[0] == 2


def test_what_a_file_manager_leaves_does_no_harm(store, capsys):
    for place in (store, store / "metrics", store / "metrics" / "c"):
        (place / ".DS_Store").write_bytes(b"\0\0\0\1Bud1")
    assert reported(capsys)[0] == 0


@pytest.fixture(scope="module")
def uninterrupted(sweep):
    return bits(sweep(40, keep=20))


@pytest.mark.parametrize("writes", [0, 1, 3, 11])
def test_growth_that_is_interrupted_is_made_up_for(writes, sweep, uninterrupted, tmp_path, monkeypatch):
    """Growing a store of one and a half batches ends after so many arrays; what is there stays, and it can go on."""
    path = tmp_path / "s.zarr"
    sweep(12, keep=20, out=path)
    left, resize = [writes], zarr.Array.resize

    def limited(array, shape):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        resize(array, shape)

    with monkeypatch.context() as patch:
        patch.setattr(zarr.Array, "resize", limited)
        with pytest.raises(KeyboardInterrupt):
            sweep(40, keep=20, out=path, resume=True)
    half = open_sweep(path)
    assert half.sizes["sample"] == 40
    assert half.sizes["kept"] == 20
    assert np.flatnonzero(half.status.values >= 0).tolist() == list(range(8))
    assert bits(sweep(40, keep=20, out=path, resume=True)) == uninterrupted


def test_a_store_of_other_code_is_not_resumed(store, sweep, monkeypatch):
    monkeypatch.setattr(coopmm_jax, "__version__", "9.9")
    with pytest.raises(UserError, match=r"^versions\.coopmm_jax: must be .*, as .*s\.zarr was made with, was 9\.9$"):
        sweep(3 * BATCH, keep=BATCH, out=store, resume=True)


@pytest.fixture
def folder(simulated_paper, tmp_path, monkeypatch):
    """Results of a run, in the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    write_run(tmp_path / "run", simulated_paper.scenario, simulated_paper)
    return tmp_path / "run"


@pytest.mark.parametrize(
    ("name", "how"),
    [
        *(("trajectory.npz", how) for how in [*JUNK, "flipped"]),
        *(("summary.json", how) for how in JUNK),
        *(("scenario.toml", how) for how in JUNK if how != "empty"),
    ],
)
def test_a_spoilt_run_is_refused_in_one_line(name, how, folder, capsys):
    spoil(folder / name, how)
    assert main(["animate", "run", "--out", "film.gif"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("coopmm: error: run: must be a folder that coopmm simulate --out has written, was ")
    assert err.count("\n") == 1


@pytest.mark.parametrize("wrong", [np.zeros((3, 2)), np.zeros(1001, int), np.full((1001, 2, 5), np.nan), np.array("x")])
def test_arrays_of_another_kind_are_refused(wrong, folder, simulated_paper):
    arrays = {name: value for name, value in vars(simulated_paper).items() if isinstance(value, np.ndarray)}
    for name in ("t", "torque"):
        np.savez(folder / "trajectory.npz", **arrays | {name: wrong})
        with pytest.raises(UserError, match=r"^run: must be a folder that coopmm simulate --out has written, was "):
            read_run(folder)


@pytest.mark.parametrize("how", [*JUNK, "flipped"])
def test_a_spoilt_state_is_refused_in_one_line(how, tmp_path):
    state.write(tmp_path, {"best": np.arange(3.0)}, "k0 = 1\n")
    spoil(tmp_path / state.NAME, how)
    with pytest.raises(UserError, match=r"^--resume: must be used with a "):
        state.read(tmp_path, "k0 = 1\n")


def test_a_state_of_other_software_is_not_resumed(tmp_path, monkeypatch):
    state.write(tmp_path, {"best": np.arange(3.0)}, "k0 = 1\n")
    assert state.read(tmp_path, "k0 = 1\n")["best"].tolist() == [0.0, 1.0, 2.0]
    with monkeypatch.context() as patch:
        patch.setattr(coopmm_jax, "__version__", "9.9")
        with pytest.raises(UserError, match=r"the settings of the run: # coopmm_jax .*, was # coopmm_jax 9\.9$"):
            state.read(tmp_path, "k0 = 1\n")
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_enable_fast_math=true")
    with pytest.raises(UserError, match=r"was # XLA_FLAGS --xla_cpu_enable_fast_math=true$"):
        state.read(tmp_path, "k0 = 1\n")

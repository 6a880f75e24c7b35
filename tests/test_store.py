"""Result folders are complete or not there, and leave other people's files alone."""

import json
import math

import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.errors import UserError
from coopmm_jax.runs.store import read_run, result_folder, versions, write_json, write_run
from coopmm_jax.runs.trajectory import ARRAYS


def test_new_folder_appears_whole_with_its_parents(tmp_path):
    target = tmp_path / "a" / "b"
    with result_folder(target) as folder:
        (folder / "one.txt").write_text("1")
        assert not target.exists()
    assert [path.name for path in target.iterdir()] == ["one.txt"]
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert target.stat().st_mode == (tmp_path / "a").stat().st_mode


def test_existing_folder_keeps_what_is_not_replaced(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "one.txt").write_text("old")
    with result_folder(tmp_path) as folder:
        (folder / "one.txt").write_text("new")
        (folder / "figures").mkdir()
        (folder / "figures" / "two.txt").write_text("2")
        assert (tmp_path / "one.txt").read_text() == "old"
    found = {str(path.relative_to(tmp_path)): path.read_text() for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {"notes.txt": "mine", "one.txt": "new", "figures/two.txt": "2"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figures", "notes.txt", "one.txt"]


@pytest.mark.parametrize("existing", [True, False])
def test_nothing_is_left_of_a_failed_run(tmp_path, existing):
    target = tmp_path / "run"
    if existing:
        target.mkdir()

    def fail_half_way():
        with result_folder(target) as folder:
            (folder / "one.txt").write_text("1")
            raise RuntimeError("blew up")

    with pytest.raises(RuntimeError, match="blew up"):
        fail_half_way()
    assert [path.name for path in tmp_path.rglob("*")] == ["run"] * existing


@pytest.mark.parametrize("name", ["file", "file/run"])
def test_target_that_cannot_be_a_folder(tmp_path, name):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(UserError, match=r"--out: must be a folder that can be written, was .*file.* \(Not a dir"),
        result_folder(tmp_path / name),
    ):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_json_is_strict(tmp_path):
    content = {"a": np.float64(0.1), "b": np.arange(2), "c": (float("nan"), np.inf), "d": {"e": None, "f": np.True_}}
    write_json(tmp_path / "x.json", content)
    text = (tmp_path / "x.json").read_text()
    assert json.loads(text) == {"a": 0.1, "b": [0, 1], "c": [None, None], "d": {"e": None, "f": True}}


def test_versions_name_what_decides_the_digits():
    assert set(versions()) == {"python", "coopmm_jax", "jax", "jaxlib", "numpy"}


@pytest.fixture(scope="module")
def run():
    return cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.02}))


@pytest.mark.parametrize("failing", [False, True])
def test_run_is_read_as_it_was_written(failing, run, tmp_path):
    if failing:
        run = cm.simulate(run.scenario.with_overrides({"gains.beta": 126.7, "gains.lam_min": 0.63}))
        assert not run.ok
    run.metrics["settling_time"] = math.nan  # as null in the file
    write_run(tmp_path, run.scenario, run)
    read = read_run(tmp_path)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(read, name), getattr(run, name), strict=True)
    assert (read.status, read.status_time, read.scenario) == (run.status, run.status_time, run.scenario)
    np.testing.assert_equal(read.metrics, run.metrics)


@pytest.mark.parametrize("spoiled", ["trajectory.npz", "summary.json", "scenario.toml"])
@pytest.mark.parametrize("content", [None, "[1, 2"])
def test_what_is_not_a_run_is_refused_in_one_line(spoiled, content, run, tmp_path):
    write_run(tmp_path, run.scenario, run)
    (tmp_path / spoiled).unlink()
    if content is not None:
        (tmp_path / spoiled).write_text(content)
    with pytest.raises(UserError, match=r"^run: must be a folder that coopmm simulate --out has written, was .*"):
        read_run(tmp_path)


def test_run_of_a_version_with_other_arrays_is_refused(run, tmp_path):
    write_run(tmp_path, run.scenario, run)
    np.savez(tmp_path / "trajectory.npz", t=run.t)
    with pytest.raises(UserError, match="run: must be a folder that coopmm simulate --out has written"):
        read_run(tmp_path)

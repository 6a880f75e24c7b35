"""A run's folder is read as it was written, and nothing else is taken for one."""

import math

import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.errors import UserError
from coopmm_jax.runs.store import read_run, write_run


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
    for name in run.arrays:
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

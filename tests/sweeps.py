"""Sweeps of a short scenario with one batch size, made once for all test files: a plugin that ``conftest.py`` names."""

import os
import subprocess
import sys

import jax
import pytest

import coopmm_jax as cm
from coopmm_jax.sweeps import measure

BATCH = 8
MANY = 500  # samples
ENTRIES = {
    "plant.masses": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True, "each": True},
    "disturbance.scale": {"distribution": "log_uniform", "low": 0.1, "high": 1e6},  # the strongest end in failure
    "disturbance.phase": {"distribution": "uniform", "low": 0.0, "high": 6.0},
}
# One whose robustness is gathered while a rollout goes on, one that needs all samples.
SENTENCES = {
    "presses": "always[0.01, 0.04] contact_force >= -80",
    "recovers": "always[0, 0.03] (contact_force <= -60 implies eventually[0, 0.02] contact_force >= -20)",
}
REQUIRED = {"force_min": ">= -90", "torque_peak": "<= 200"} | SENTENCES


def bits(data):
    """Everything a sweep has computed, as bytes by name."""
    names = ("parameters", "metrics", "status", "status_time", *measure.SERIES)
    return {name: data[name].values.tobytes() for name in names}


@pytest.fixture(scope="session")
def scenario():
    """The paper's first 50 ms, so that ``cm.simulate`` shares the program of other tests."""
    settings = {"duration": 0.05, "step": 0.001}
    return cm.load_scenario("paper", simulation=settings, uncertainty=ENTRIES, requirements=REQUIRED)


@pytest.fixture(scope="session")
def sweep(scenario):
    """``cm.sweep`` with batches of one size, so that all tests share its programs."""

    def run(samples=None, scenario=scenario, keep=0, **options):
        return cm.sweep(scenario, samples, keep=keep, batch=BATCH, **options)

    return run


@pytest.fixture(scope="session")
def many(sweep):
    return sweep(MANY)


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
    fixed = [sys.executable, "-c", code, "sweep", "scenario.toml", "--keep", "0", "--batch", str(BATCH)]
    processes = []

    def run(*arguments):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        processes.append(subprocess.Popen([*fixed, *arguments], cwd=tmp_path, env=environment, **pipes))
        return processes[-1]

    yield run
    for process in processes:
        process.kill()
        process.communicate()

"""Comparisons of gains on real rollouts: run by test_compare.py in a process of its own, as ``runs_apart`` explains.

The folder that it is given has stiff.toml, other.toml, certain.toml and short.toml, a scenario; the answer is pickled
to answer.pkl.
"""

import contextlib
import io
import pickle
import sys
from pathlib import Path

import numpy as np

import coopmm_jax as cm
from coopmm_jax.cli import main as coopmm
from coopmm_jax.scenario.gains_file import read_gains
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.variation import vary
from tests.workers import start_worker
from tuning.studies.compare import OWN, compare_gains

SAMPLE = 2


def main(folder):
    """Three sets; with one of another controller; in another order; one sample alone; simulated; the command."""
    start_worker()
    scenario = cm.load_scenario(folder / "short.toml")
    stiff, other, certain = (folder / f"{name}.toml" for name in ("stiff", "other", "certain"))
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        arguments = [
            OWN,
            str(stiff),
            str(other),
            "--scenario",
            str(folder / "short.toml"),
            "--out",
            str(folder / "out"),
        ]
        code = coopmm(["compare", *arguments])
    answer = {
        "compared": compare_gains(scenario, [OWN, stiff, other]),
        "controllers": compare_gains(scenario, [certain, OWN, stiff, other]),
        "permuted": compare_gains(scenario, [other, OWN, stiff, other]),
        "alone": compare_gains(scenario, [OWN, stiff], samples=1),
        "simulated": [cm.simulate(single).metrics for single in _singles(scenario, stiff, other, certain)],
        "command": (code, printed.getvalue()),
    }
    (folder / "answer.pkl").write_bytes(pickle.dumps(answer))


def _singles(scenario, *files):
    """One sample's scenario under the scenario's gains and under those of files."""
    variation = vary(scenario)
    point = sampler("independent", scenario.simulation.seed, len(variation.draws))([SAMPLE])
    drawn = {number: float(np.squeeze(value)) for number, value in variation.values(point).items()}
    single = variation.sample(SAMPLE, drawn)
    return [single, *(single.with_overrides(read_gains(file)) for file in files)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))

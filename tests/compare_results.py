"""Comparisons of gains on real rollouts, for test_compare.py.

The folder that they are given has stiff.toml, other.toml, certain.toml and short.toml, a scenario.
"""

import contextlib
import io

import numpy as np

import coopmm_jax as cm
from coopmm_jax.cli import main as coopmm
from coopmm_jax.scenario.gains_file import read_gains
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.variation import vary
from tuning.studies.compare import OWN, compare_gains

SAMPLE = 2


def results(folder):
    """Three sets; a fourth of another controller; a scenario with that; permuted; on one sample; simulated; printed."""
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
    return {
        "compared": compare_gains(scenario, [OWN, stiff, other]),
        "controllers": compare_gains(scenario, [certain, OWN, stiff, other]),
        "controlled": compare_gains(scenario.with_overrides(read_gains(certain)), [OWN, stiff]),
        "permuted": compare_gains(scenario, [other, OWN, stiff, other]),
        "alone": compare_gains(scenario, [OWN, stiff], samples=1),
        "simulated": [cm.simulate(single).metrics for single in _singles(scenario, stiff, other)],
        "command": (code, printed.getvalue()),
    }


def _singles(scenario, *files):
    """One sample's scenario under the scenario's gains and under those of files."""
    variation = vary(scenario)
    point = sampler("independent", scenario.simulation.seed, len(variation.draws))([SAMPLE])
    drawn = {number: float(np.squeeze(value)) for number, value in variation.values(point).items()}
    single = variation.sample(SAMPLE, drawn)
    return [single, *(single.with_overrides(read_gains(file)) for file in files)]

"""Fingerprints of what every shipped scenario computes, to show that a change of the code changes no bit.

    python -m experiments.fingerprints [--scenarios paper sensed] [--parts trajectory sweep gradient tuning]

Run it on two commits and compare the lines. One line is a SHA-256 of all bytes of a run's arrays and metrics, of a
sweep's parameters, metrics and series, of a tuning cost's gradient, or of the gains after one tuning iteration. The
compiler's optimisations are off, so that compiling takes a third of the time; the options are part of the bits.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from typing import Any

import numpy as np

import coopmm_jax as cm

_QUICK = "--xla_backend_optimization_level=0 --xla_cpu_parallel_codegen_split_count=1"
_MASS = {"plant.masses": {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}}
# Small enough that one iteration is a matter of seconds, once its gradient has compiled.
_TUNING = {"tracking_from": 0.03, "starts": 4, "screening_samples": 2, "samples": 2, "budget": 0.01}
_TUNING |= {"validation_samples": 2, "test_samples": 2}


def digest(*arrays: Any) -> str:
    """First 16 digits of the SHA-256 of arrays of any shape (...), byte by byte."""
    total = hashlib.sha256()
    for array in arrays:
        total.update(np.ascontiguousarray(array).tobytes())
    return total.hexdigest()[:16]


def trajectory(scenario: cm.Scenario) -> str:
    """Digest of one second of the scenario: every recorded array, and the metrics."""
    run = cm.simulate(scenario.with_overrides({"simulation.duration": 1.0}))
    return digest(*_arrays(vars(run).values()), list(run.metrics.values()))


def _arrays(values: Iterable[Any]) -> Iterator[np.ndarray]:
    """Arrays of a run, with those of its controller in their place."""
    for value in values:
        if isinstance(value, np.ndarray):
            yield value
        elif isinstance(value, dict):
            yield from _arrays(value.values())


def sweep(scenario: cm.Scenario) -> str:
    """Digest of four samples of 0.2 s: parameters, metrics, status and series."""
    size = next(name for name in ("batch", "tile") if name in inspect.signature(cm.sweep).parameters)  # its older name
    data = cm.sweep(_varied(scenario, 0.2), samples=4, keep=2, **{size: 4})
    return digest(*(data[name].values for name in sorted(data.data_vars)))


def gradient(scenario: cm.Scenario) -> str:
    """Digest of the cost of two samples over 0.1 s, and of its gradient by every tuned gain."""
    problem = _module("tuning.cost.problem", "tuning.problem").build_problem(_varied(scenario, 0.1, tuning=_TUNING))
    return digest(*problem.cost.slopes(problem.space.start[None], problem.samples(0, 2)))


def tuning(scenario: cm.Scenario) -> str:
    """Digest of the gains after one iteration."""
    tuned = import_module("tuning").tune(_varied(scenario, 0.1, tuning=_TUNING))
    return digest(tuned.after, [row.best for row in tuned.history])


PARTS: dict[str, Callable[[cm.Scenario], str]] = {
    "trajectory": trajectory,
    "sweep": sweep,
    "gradient": gradient,
    "tuning": tuning,
}


def _varied(scenario: cm.Scenario, duration: float, **changes: Any) -> cm.Scenario:
    uncertainty = {} if scenario.uncertainty.model_extra else {"uncertainty": _MASS}
    return scenario.with_overrides({"simulation.duration": duration} | uncertainty | changes)


def _module(*names: str) -> Any:
    """First module of these that exists, so that older commits can be asked too."""
    for name in names[:-1]:
        try:
            return import_module(name)
        except ModuleNotFoundError:
            continue
    return import_module(names[-1])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each scenario and part; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenarios", nargs="+", default=list(cm.list_scenarios()))
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    options = parser.parse_args(arguments)
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {_QUICK}"
    cm.runtime.use_fast_compilation()
    cm.runtime.use_compilation_cache()
    for name in options.scenarios:
        for part in options.parts:
            print(f"{name:12} {part:12} {PARTS[part](cm.load_scenario(name))}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

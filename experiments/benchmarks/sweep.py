"""Time and memory of sweeps: 4,096 rollouts of 20 s against a limit, and memory as the number of samples grows.

    python -m experiments.benchmarks.sweep --out results/benchmarks

runs ``coopmm sweep`` in processes of its own, after a first small one that fills the compilation cache, and writes
sweep.csv. It takes some four minutes on two cores.
"""

from __future__ import annotations

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from coopmm_jax.scenario.scenario import load_scenario

SCENARIO = "paper_full"
UNCERTAINTY = """
[uncertainty]
plant.masses = { distribution = "uniform", low = 0.8, high = 1.2, relative = true, each = true }

[requirements]
contact_loss_fraction = "== 0"
error_late = "<= 0.01"
"""
LONGEST = 75.0  # [s] for 4,096 samples of 20 s, warm, on two cores
LARGEST = 1000.0  # [MB]
MORE = 1.1  # peak memory of 100,000 samples over that of 1,000: the allocator's noise, where growth would be manifold


class Case(NamedTuple):
    """One sweep."""

    samples: int
    duration: float  # [s] simulated


class Measurement(NamedTuple):
    """Time and memory that a sweep took."""

    samples: int
    duration_s: float
    steps_millions: float
    wall_s: float
    cpu_s: float
    peak_memory_mb: float


FIRST, SCALE = Case(64, 20.0), Case(4096, 20.0)
SHORT_FIRST, FEW, MANY = Case(64, 1.0), Case(1000, 1.0), Case(100_000, 1.0)


def main() -> int:
    """Measure all cases; exit code 0 if all limits are kept, else 1."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"), help="folder for sweep.csv")
    options = parser.parse_args()
    rows = [measure(case) for case in (FIRST, SCALE, SHORT_FIRST, FEW, MANY)]
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "sweep.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Measurement._fields)
        writer.writerows(rows)
    _, scale, _, few, many = rows
    checks = (
        ("wall time of the large sweep [s]", scale.wall_s, LONGEST),
        ("its peak memory [MB]", scale.peak_memory_mb, LARGEST),
        ("peak memory of 100,000 samples over that of 1,000", many.peak_memory_mb / few.peak_memory_mb, MORE),
    )
    for what, value, limit in checks:
        print(f"{what:50} {value:8.2f}, to be at most {limit:g}: {'kept' if value <= limit else 'MISSED'}")
    return int(any(value > limit for _, value, limit in checks))


def measure(case: Case) -> Measurement:
    """Run one sweep in a process of its own, report included."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "uncertainty.toml").write_text(UNCERTAINTY)
        command = [sys.executable, "-c", "from coopmm_jax.cli import main; raise SystemExit(main())", "sweep", SCENARIO]
        command += [
            "--uncertainty",
            "uncertainty.toml",
            "--samples",
            str(case.samples),
            "--simulation.duration",
            str(case.duration),
        ]
        begin = time.perf_counter()
        process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, command)
    steps = case.samples * case.duration / load_scenario(SCENARIO).simulation.step
    result = Measurement(*case, steps / 1e6, wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)
    print(" ".join(f"{name} {value:g}" for name, value in result._asdict().items()), flush=True)
    return result


if __name__ == "__main__":
    sys.exit(main())

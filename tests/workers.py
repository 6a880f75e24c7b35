"""Workers: what has to run in a process of its own, for the reason that ``gradient_worker`` gives."""

import os
import subprocess
import sys
from types import ModuleType

import jax


def run_worker(worker: ModuleType, *arguments: object) -> str:
    """What ``python -m worker arguments`` prints, with the tests' compilation cache; its failure is the test's."""
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir}
    command = [sys.executable, "-m", worker.__name__, *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout

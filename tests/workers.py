"""Workers: what has to run in a process of its own, for the reason that ``gradient_worker`` gives."""

import os
import subprocess
import sys
from types import ModuleType

import jax

# Most of what tests run is compiled for a few steps: machine code as it comes, three times slower but compiled in a
# third of the time. ``runs_apart`` compiles whole rollouts as they are shipped.
QUICK_TO_COMPILE = "--xla_backend_optimization_level=0"


def run_worker(worker: ModuleType, *arguments: object) -> str:
    """What ``python -m worker arguments`` prints, with the tests' compilation cache; its failure is the test's."""
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir}
    command = [sys.executable, "-m", worker.__name__, *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout

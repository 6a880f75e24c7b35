"""Workers: what has to run in a process of its own, for the reason that ``gradient_worker`` gives."""

import os
import subprocess
import sys
from types import ModuleType

import jax

from coopmm_jax import runtime

# Most of what tests run is compiled for a few steps: machine code as it comes, three times slower but compiled in a
# third of the time. ``runs_apart`` compiles whole rollouts as they are shipped. Without what only optimisations would
# read, LLVM inlines in half the time; modules split for threads would take these from the other worker.
QUICK_TO_COMPILE = (
    "--xla_backend_optimization_level=0 --xla_cpu_parallel_codegen_split_count=1"
    " --xla_llvm_enable_alias_scope_metadata=false --xla_llvm_enable_noalias_metadata=false"
    " --xla_llvm_enable_invariant_load_metadata=false"
)


def environment(shipped: bool = False) -> dict[str, str]:
    """Of a worker: the tests' compilation cache; ``shipped`` leaves XLA's level to the command line."""
    flags = os.environ["XLA_FLAGS"]
    if shipped:
        flags = flags.replace(QUICK_TO_COMPILE, "").strip()
    return os.environ | {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir, "XLA_FLAGS": flags}


def start_worker() -> None:
    """Set up a worker before anything else."""
    runtime.use_fast_compilation()
    jax.config.update("jax_enable_x64", True)


def run_worker(worker: ModuleType, *arguments: object) -> str:
    """Output of ``python -m worker arguments``; its failure is the test's."""
    command = [sys.executable, "-m", worker.__name__, *map(str, arguments)]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout

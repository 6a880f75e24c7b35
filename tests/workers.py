"""XLA's options of the tests, and workers: what has to run in a process of its own."""

import os

import jax

from coopmm_jax import runtime

# Most of what tests run is compiled for a few steps: machine code as it comes, a third as fast but compiled in a
# quarter of the time; test_sweep.py compiles a batch as it is shipped. Without what only optimisations would read, LLVM
# inlines in half the time; modules split for threads would take these from the other worker; kernels that are not made
# through MLIR take half as long, without the analysis in which multi-output fusion can abort. Three passes that only
# make loops faster take a tenth of the time.
QUICK_TO_COMPILE = (
    "--xla_backend_optimization_level=0 --xla_cpu_parallel_codegen_split_count=1 --xla_cpu_use_fusion_emitters=false"
    " --xla_llvm_enable_alias_scope_metadata=false --xla_llvm_enable_noalias_metadata=false"
    " --xla_llvm_enable_invariant_load_metadata=false --xla_disable_hlo_passes=cpu-parallel-task-assigner,"
    "while-loop-invariant-code-motion,while-loop-constant-sinking"
)


def compile_quickly() -> None:
    """Set XLA's options for this process and those that it starts, which then share their compiled programs."""
    if QUICK_TO_COMPILE not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {QUICK_TO_COMPILE}".strip()
    runtime.use_fast_compilation(batches=True)


def environment(shipped: bool = False) -> dict[str, str]:
    """Of a worker: the tests' compilation cache; ``shipped`` leaves XLA's options to the command line."""
    own = os.environ | {"JAX_COMPILATION_CACHE_DIR": jax.config.jax_compilation_cache_dir}
    return own | {"XLA_FLAGS": ""} if shipped else own


def start_worker() -> None:
    """Set up a worker before anything else."""
    runtime.use_fast_compilation()
    jax.config.update("jax_enable_x64", True)

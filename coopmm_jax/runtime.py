"""Options with which XLA compiles in this process, and the compilation cache.

XLA reads its options once, when JAX's backend starts (at the first computation), so everything here has to be called
before that. Nothing here imports JAX unless the caller needs it anyway. The options are meant for the CPU; a GPU's
programs have the same bits and speed at optimisation level 1 as at 3.

>>> use_small_while_loops() in (True, False)
True
"""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

_WHILE_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000"
# XLA counts the bytes a loop touches over all iterations; a batch over a long horizon is small only by this measure.
_WHOLE_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000000"
_MULTI_OUTPUT = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true"
# Not an extra option: given as one, XLA ignores it (seen in the generated code's prefer-vector-width attribute).
_VECTOR_WIDTH = "--xla_cpu_prefer_vector_width=512"
# LLVM's higher levels take a fifth longer over a rollout or its gradient and gain at most 3 % (benchmarks.rollout).
_OPTIMISATION = "--xla_backend_optimization_level=1"
# LLVM vectorises a loop only if checking at run time that its arrays do not overlap takes few comparisons (128) and
# little beside the loop's own estimated cost. XLA does not tell it that the outputs of a multi-output fusion are apart,
# so the widest loops of a batch, with a thousand pairs of arrays, stayed scalar and took half of the time.
_MANY_CHECKS = "--xla_backend_extra_options=-vectorize-memory-check-threshold=100000"
_CHECKS_PAY = "--xla_backend_extra_options=-force-target-instruction-cost=100"
_COLLECTIONS = (50_000, 10, 10)
_CACHE = "jax_compilation_cache_dir"
_KEPT = {"jax_persistent_cache_min_compile_time_secs": 0.02, "jax_persistent_cache_min_entry_size_bytes": 0}


def backend_is_up() -> bool:
    """True once JAX has started a backend, after which XLA's options can no longer change."""
    bridge = sys.modules.get("jax._src.xla_bridge")
    return bridge is not None and bridge.backends_are_initialized()


def use_small_while_loops() -> bool:
    """Let XLA run this package's time loops without the overhead of its thunk interpreter; called on import.

    Harmless to other code. Does nothing when a backend is up already, when the user has set the option, or when the
    environment variable COOPMM_NO_XLA_OPTIONS is 1.

    Returns:
        True if XLA will see, or has seen, the option.
    """
    return _add_options(_WHILE_LOOPS)


def use_fast_compilation(batches: bool = False) -> bool:
    """Compile this package's rollouts about twice as fast, to code that is four (one) to ten (a batch) times as fast.

    **Risk**: XLA's multi-output fusion on the CPU can abort the whole process, without a Python exception, while it
    compiles *other* code (seen with jacfwd through jnp.linalg: a failed check in symbolic_map.cc). The command line
    and worker processes, which run only this package, use it. In a notebook, call it before the first computation, and
    only if a restarted kernel would cost you nothing. Also calls ``collect_rarely``.

    Args:
        batches: have LLVM vectorise every loop over the elements of a batch, which pays for sweeps: a batch runs two
            fifths faster and takes a tenth longer to compile; its gradient runs at most a sixth faster and takes
            seven tenths longer.

    Returns:
        True if XLA will see the options: not if COOPMM_NO_XLA_OPTIONS is 1 or XLA_FLAGS names a file.

    Raises:
        RuntimeError: a JAX backend is up, so it is too late.
    """
    collect_rarely()
    options = (_WHOLE_LOOPS, _MULTI_OUTPUT, _VECTOR_WIDTH, _OPTIMISATION)
    if batches:
        options = (*options, _MANY_CHECKS, _CHECKS_PAY)
    flags = os.environ.get("XLA_FLAGS", "").split()
    if not (backend_is_up() or _disabled()) and _WHILE_LOOPS in flags:  # of importing this package
        os.environ["XLA_FLAGS"] = " ".join(_WHOLE_LOOPS if flag == _WHILE_LOOPS else flag for flag in flags)
    if backend_is_up() and _missing(options) and not _disabled():
        raise RuntimeError("use_fast_compilation() comes too late: call it before the first JAX computation")
    return _add_options(*options)


def use_processor() -> None:
    """Leave a GPU alone where JAX_PLATFORMS does not ask for it.

    What takes rollouts one at a time or in small batches is done sooner by the processor: a step takes a GPU 0.2 ms, of
    one rollout as of a thousand, and one core two microseconds. Nothing changes once a backend is up.
    """
    if backend_is_up() or os.environ.get("JAX_PLATFORMS"):
        return
    os.environ["JAX_PLATFORMS"] = "cpu"
    if "jax" in sys.modules:  # which has read the environment
        sys.modules["jax"].config.update("jax_platforms", "cpu")


def collect_rarely() -> bool:
    """Let Python look for unreachable cycles after 50 000 new objects, not 700 as by default.

    Tracing a gradient makes millions of objects that all stay, and looking through them took a quarter of its time.

    Returns:
        True if anything changed: not if collections are rarer still, or off.
    """
    often = gc.isenabled() and 0 < gc.get_threshold()[0] < _COLLECTIONS[0]
    if often:
        gc.set_threshold(*_COLLECTIONS)
    return often


def use_compilation_cache() -> Path:
    """Keep compiled rollouts on disk, so that the next process starts at once.

    The folder is COOPMM_CACHE_DIR, else the one JAX is already set to use, else coopmm_jax in XDG_CACHE_HOME or
    ~/.cache. Everything that takes over 0.02 s to compile is kept: the many small programs add up too.

    Returns:
        Cache folder.

    Raises:
        UserError: COOPMM_CACHE_DIR is no path.
    """
    from coopmm_jax.files import resolve_path

    jax = sys.modules.get("jax")
    set_already = jax.config.values[_CACHE] if jax else os.environ.get(_CACHE.upper())
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    default = set_already or Path(home) / "coopmm_jax"
    folder = resolve_path(os.environ.get("COOPMM_CACHE_DIR") or default, "COOPMM_CACHE_DIR").absolute()
    for name, value in ((_CACHE, str(folder)), *_KEPT.items()):
        if jax:
            jax.config.update(name, value)
        else:  # which reads the environment when it is imported, only once the input has turned out to be usable
            os.environ[name.upper()] = str(value)
    return folder


def xla_options() -> str:
    """XLA's options of this process that a result's last digits can depend on."""
    return " ".join(flag for flag in os.environ.get("XLA_FLAGS", "").split() if "device_count" not in flag)


def _add_options(*options: str) -> bool:
    """Append to XLA_FLAGS what it does not set yet; False if XLA will not see all of the options."""
    missing = _missing(options)
    if not missing:
        return True
    flags = os.environ.get("XLA_FLAGS", "").strip()
    names_a_file = flags != "" and not flags.startswith("--")
    if _disabled() or backend_is_up() or names_a_file:
        return False
    os.environ["XLA_FLAGS"] = " ".join([flags, *missing]).strip()  # XLA merges repeated --xla_backend_extra_options
    return True


def _missing(options: tuple[str, ...]) -> list[str]:
    """Options whose name, "name" of ``--[...=]name=value``, does not appear in XLA_FLAGS."""
    flags = os.environ.get("XLA_FLAGS", "")
    return [option for option in options if option.split("=")[-2].lstrip("-") not in flags]


def _disabled() -> bool:
    return os.environ.get("COOPMM_NO_XLA_OPTIONS") == "1"

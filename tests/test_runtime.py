"""XLA's options: set before the backend starts, merged with the user's, never behind anyone's back."""

import gc
import json
import os
import subprocess
import sys
from types import SimpleNamespace

import jax
import pytest

from coopmm_jax import runtime
from coopmm_jax.errors import UserError

WHILE_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000"
WHOLE_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000000"
MULTI_OUTPUT = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true"


def in_new_process(code: str, **environment: str) -> str:
    """Output of ``code`` in a Python of its own, without this process's XLA options."""
    clean = {name: value for name, value in os.environ.items() if name not in ("XLA_FLAGS", "COOPMM_NO_XLA_OPTIONS")}
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, env=clean | environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


FLAGS_AFTER_IMPORT = "import os, coopmm_jax; print(os.environ.get('XLA_FLAGS', ''))"


def test_import_adds_one_option_and_no_jax():
    code = "import os, sys, coopmm_jax; assert 'jax' not in sys.modules; print(os.environ['XLA_FLAGS'])"
    assert in_new_process(code) == WHILE_LOOPS


def test_import_keeps_what_the_user_has_set():
    mine = "--xla_cpu_enable_fast_math=false --xla_backend_extra_options=mine=1"
    assert in_new_process(FLAGS_AFTER_IMPORT, XLA_FLAGS=mine) == f"{mine} {WHILE_LOOPS}"
    other_value = WHILE_LOOPS.replace("1000000", "5")
    assert in_new_process(FLAGS_AFTER_IMPORT, XLA_FLAGS=other_value) == other_value


def test_import_leaves_a_file_of_flags_alone():
    assert in_new_process(FLAGS_AFTER_IMPORT, XLA_FLAGS="flags.txt") == "flags.txt"


def test_environment_variable_turns_options_off():
    code = f"{FLAGS_AFTER_IMPORT}; print(coopmm_jax.runtime.use_fast_compilation())"
    assert in_new_process(code, COOPMM_NO_XLA_OPTIONS="1") == "False"


def test_jax_and_xla_accept_what_is_set_before_they_are_imported(tmp_path):
    code = """
import os, sys
from coopmm_jax import runtime
runtime.use_processor()
assert runtime.use_fast_compilation()
print(os.environ["XLA_FLAGS"])
assert runtime.use_fast_compilation(batches=True)
print(os.environ["XLA_FLAGS"].split()[-2:])
print(runtime.use_compilation_cache())
assert "jax" not in sys.modules
import jax
kept = jax.config.jax_persistent_cache_min_compile_time_secs, jax.config.jax_persistent_cache_min_entry_size_bytes
print(jax.config.jax_platforms, jax.config.jax_compilation_cache_dir, *kept)
with jax.enable_x64(True):
    print(jax.jit(lambda x: jax.lax.fori_loop(0, 3, lambda _, y: y * 1.5, x))(2.0))
assert runtime.use_fast_compilation()
"""
    extra = "--xla_backend_extra_options=-"
    assert in_new_process(code, JAX_PLATFORMS="", COOPMM_CACHE_DIR=f"{tmp_path}").splitlines() == [
        f"{WHOLE_LOOPS} {MULTI_OUTPUT} --xla_cpu_prefer_vector_width=512 --xla_backend_optimization_level=1",
        f"['{extra}vectorize-memory-check-threshold=100000', '{extra}force-target-instruction-cost=100']",
        f"{tmp_path}",
        f"cpu {tmp_path} 0.02 0",
        "6.75",
    ]


def test_a_process_that_another_starts_has_the_same_options():
    code = "import os, coopmm_jax; coopmm_jax.runtime.use_fast_compilation(); print(os.environ['XLA_FLAGS'])"
    once = in_new_process(code)
    assert in_new_process(code, XLA_FLAGS=once) == once


def test_fast_compilation_after_the_first_computation_is_refused(monkeypatch):
    jax.numpy.zeros(1)
    assert runtime.backend_is_up()
    monkeypatch.setenv("XLA_FLAGS", WHILE_LOOPS)
    monkeypatch.delenv("COOPMM_NO_XLA_OPTIONS", raising=False)
    with pytest.raises(RuntimeError, match="before the first JAX computation"):
        runtime.use_fast_compilation()
    assert os.environ["XLA_FLAGS"] == WHILE_LOOPS


@pytest.mark.parametrize(
    ("before", "after"),
    [((700, 10, 10), (50_000, 10, 10)), ((60_000, 5, 5), (60_000, 5, 5)), ((0, 10, 10), (0, 10, 10))],
)
def test_collections_become_rarer_never_more_frequent(before, after):
    usual = gc.get_threshold()
    try:
        gc.set_threshold(*before)
        assert runtime.collect_rarely() == (before != after)
        assert gc.get_threshold() == after
    finally:
        gc.set_threshold(*usual)


CACHES = """
import json, os, sys, jax
jax.numpy.zeros(1)
from coopmm_jax import runtime
from jax.experimental.compilation_cache import compilation_cache
print("options:", *os.environ.get("XLA_FLAGS", "").split())
for environment in json.loads(os.environ["ENVIRONMENTS"]):
    os.environ.update(environment)
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])  # as JAX does on import
    print(runtime.use_compilation_cache())
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    compilation_cache.reset_cache()
    jax.jit(lambda x: x * 3)(1.0)
"""


def test_import_after_the_first_computation_sets_no_option_and_the_cache_is_filled(tmp_path):
    home, jaxs = {"HOME": f"{tmp_path}"}, f"{tmp_path}/jax"
    environments = {
        "mine": {"COOPMM_CACHE_DIR": f"{tmp_path}/mine", "JAX_COMPILATION_CACHE_DIR": jaxs},
        "own": home | {"COOPMM_CACHE_DIR": "~/own"},
        "jax": {"COOPMM_CACHE_DIR": "", "XDG_CACHE_HOME": f"{tmp_path}"},
        "coopmm_jax": {"JAX_COMPILATION_CACHE_DIR": ""},
        ".cache/coopmm_jax": home | {"XDG_CACHE_HOME": ""},
    }
    options, *folders = in_new_process(CACHES, ENVIRONMENTS=json.dumps(list(environments.values()))).splitlines()
    assert options == "options:"
    assert folders == [str(tmp_path / name) for name in environments]
    assert all(any((tmp_path / name).glob("*lambda*")) for name in environments)


def test_a_folder_for_the_cache_that_cannot_be_is_told(monkeypatch):
    monkeypatch.setenv("COOPMM_CACHE_DIR", "~nobody-of-this-name")
    told = r"^COOPMM_CACHE_DIR: must be a path of an existing user's folder, was ~nobody-of-this-name$"
    with pytest.raises(UserError, match=told):
        runtime.use_compilation_cache()


@pytest.mark.parametrize(("asked_for", "used"), [("", "cpu"), ("cuda", "cuda")])
def test_commands_that_do_not_sweep_leave_a_gpu_alone(monkeypatch, asked_for, used):
    code = "import os; from coopmm_jax import runtime; runtime.use_processor(); print(os.environ['JAX_PLATFORMS'])"
    assert in_new_process(code, JAX_PLATFORMS=asked_for) == used
    config = SimpleNamespace(jax_platforms=asked_for, update=lambda name, value: setattr(config, name, value))
    monkeypatch.setitem(sys.modules, "jax", SimpleNamespace(config=config))  # imported, with no backend yet
    monkeypatch.setattr(runtime, "backend_is_up", lambda: False)
    monkeypatch.setenv("JAX_PLATFORMS", asked_for)
    runtime.use_processor()
    assert (os.environ["JAX_PLATFORMS"], config.jax_platforms) == (used, used)
